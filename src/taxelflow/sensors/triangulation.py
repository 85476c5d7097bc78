"""Taxels scattered over a plane: how far apart they are, which lie side by side, and a raster to show them on."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_NEIGHBOUR, _BESIDE = 1.6, 1.4
_CONE = np.cos(np.radians(46.0))


def spacing_m(xy: Floats) -> float:
    """Median distance of a taxel (taxels, 2), at least two, to the nearest other one."""
    return float(np.median(nearest_m(xy)))


def closest_m(xy: Floats) -> float:
    """Distance of the closest two taxels (taxels, 2); inf for a single one."""
    return float(nearest_m(xy).min())


def nearest_m(xy: Floats) -> Floats:
    """(taxels,): distance of each taxel (taxels, 2) to the nearest other one, inf where there is none."""
    if len(xy) == 1:
        return np.full(1, np.inf)
    from scipy.spatial import cKDTree

    nearest: Floats = np.asarray(cKDTree(xy).query(xy, k=2)[0])[:, 1]
    return nearest


def neighbours(xy: Floats, spacing: float) -> Indices:
    """(pairs, 2): edges of the Delaunay triangulation of (taxels, 2) shorter than 1.6 spacings.

    Of fewer than four taxels, or taxels on a line, which have none: all pairs so close.
    """
    from scipy.spatial import Delaunay, QhullError, cKDTree

    close: Indices = (
        cKDTree(xy).query_pairs(_NEIGHBOUR * spacing, output_type="ndarray").reshape(-1, 2).astype(np.int64)
    )
    if len(xy) < 4:
        return close
    try:
        corners = Delaunay(xy).simplices
    except QhullError:
        return close
    edges = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [0, 2]]]), axis=1)
    edges = np.unique(edges, axis=0).astype(np.int64)
    short: Indices = edges[np.linalg.norm(xy[edges[:, 0]] - xy[edges[:, 1]], axis=1) < _NEIGHBOUR * spacing]
    return short


def beside(xy: Floats, spacing: float) -> Indices:
    """(taxels, 2, 2): the nearest other one of the taxels (taxels, 2) to the left, right (x), below, above (y), or -1.

    To a side means within 1.4 spacings and 46 degrees of that direction: in a square grid the next taxel of the row or
    column, in a hexagonal one those beside it.
    """
    from scipy.spatial import cKDTree

    pairs = cKDTree(xy).query_pairs(_BESIDE * spacing, output_type="ndarray").reshape(-1, 2)
    both = np.concatenate([pairs, pairs[:, ::-1]])
    way = xy[both[:, 1]] - xy[both[:, 0]]
    reach = np.linalg.norm(way, axis=1)
    far_first = np.argsort(-reach, kind="stable")
    both, way, reach = both[far_first], way[far_first], reach[far_first]
    found = np.full((len(xy), 2, 2), -1)
    for axis in range(2):
        for side, sign in enumerate((-1.0, 1.0)):
            there = sign * way[:, axis] >= _CONE * reach
            found[both[there, 0], axis, side] = both[there, 1]
    return found


def raster(xy: Floats) -> tuple[Indices, Indices, tuple[int, int]]:
    """row, col (taxels,) and shape of a raster that shows (taxels, 2), no two in one cell, row 0 on top.

    Cells are as small as the closest two taxels ask for.
    """
    if len(xy) == 1:
        return np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64), (1, 1)
    cell = 0.999 * closest_m(xy) / sqrt(2.0)
    col = np.floor((xy[:, 0] - xy[:, 0].min()) / cell).astype(np.int64)
    row = np.floor((xy[:, 1].max() - xy[:, 1]) / cell).astype(np.int64)
    return row, col, (int(row.max()) + 1, int(col.max()) + 1)
