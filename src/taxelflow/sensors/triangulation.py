"""Taxels scattered over a plane: their spacing, Delaunay edges, adjacent taxels, and a raster for display."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from taxelflow.numerics.rounding import REACH

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class _Spacings:
    """Distances of taxels, in spacings."""

    adjacent: float = 1.4
    """Largest distance in spacings of an adjacent taxel: below the diagonal of a square grid (1.41)."""
    cell: float = 0.999
    """Cell of the raster over the largest one in which no two taxels can be."""


_SPACINGS = _Spacings()
_CONE = np.cos(np.radians(46.0))
"""Cosine of the largest angle between an axis and the direction to an adjacent taxel: every direction has one."""
_NARROW = np.cos(np.arctan(REACH.second_slope))
"""Likewise for one of the second ring."""


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

    Fewer than four taxels, and taxels on a line, have no triangulation: then all pairs closer than that.
    """
    from scipy.spatial import Delaunay, QhullError, cKDTree

    close: Indices = (
        cKDTree(xy).query_pairs(REACH.neighbour * spacing, output_type="ndarray").reshape(-1, 2).astype(np.int64)
    )
    if len(xy) < 4:
        return close
    try:
        corners = Delaunay(xy).simplices
    except QhullError:
        return close
    edges = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [0, 2]]]), axis=1)
    edges = np.unique(edges, axis=0).astype(np.int64)
    short: Indices = edges[np.linalg.norm(xy[edges[:, 0]] - xy[edges[:, 1]], axis=1) < REACH.neighbour * spacing]
    return short


def adjacent(xy: Floats, spacing: float) -> Indices:
    """(taxels, 2, 2): number of the nearest of the taxels (taxels, 2) to the left, right (x), below, above (y), or -1.

    A taxel is adjacent within 1.4 spacings and 46 degrees of that direction: in a square grid the next one of the row
    or column, in a hexagonal grid any of the six around it. So is one within 1.8 spacings and 31 degrees: triangular
    taxels have but three around them.
    """
    from scipy.spatial import cKDTree

    pairs = cKDTree(xy).query_pairs(REACH.second_ring * spacing, output_type="ndarray").reshape(-1, 2)
    both = np.concatenate([pairs, pairs[:, ::-1]])
    vector = xy[both[:, 1]] - xy[both[:, 0]]
    distance = np.linalg.norm(vector, axis=1)
    far_first = np.argsort(-distance, kind="stable")  # nearer ones overwrite farther ones below
    both, vector, distance = both[far_first], vector[far_first], distance[far_first]
    found = np.full((len(xy), 2, 2), -1)
    cone = np.where(distance < _SPACINGS.adjacent * spacing, _CONE, _NARROW) * distance
    for axis in range(2):
        for side, sign in enumerate((-1.0, 1.0)):
            inside = sign * vector[:, axis] >= cone
            found[both[inside, 0], axis, side] = both[inside, 1]
    return found


def raster_cell_m(xy: Floats) -> float:
    """Side of a cell of `raster`: its diagonal is just shorter than the smallest distance of two taxels."""
    return _SPACINGS.cell * closest_m(xy) / sqrt(2.0)


def raster(xy: Floats) -> tuple[Indices, Indices, tuple[int, int]]:
    """row, col (taxels,) and shape of a raster that shows taxels (taxels, 2), no two in one cell, row 0 on top."""
    if len(xy) == 1:
        return np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64), (1, 1)
    cell = raster_cell_m(xy)
    col = np.floor((xy[:, 0] - xy[:, 0].min()) / cell).astype(np.int64)
    row = np.floor((xy[:, 1].max() - xy[:, 1]) / cell).astype(np.int64)
    return row, col, (int(row.max()) + 1, int(col.max()) + 1)
