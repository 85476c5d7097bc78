"""Geometry of one pad: positions, normals and areas of its taxels, from a grid or a table, in the pad's frame.

Pad frame of a grid: origin at the grid's centre, x to the right along the columns, y up towards row 0, z out of the
skin. Taxels are numbered row by row from the top left, missing ones left out. Pad frame of a table: the table's own if
it has no normals; else the plane on which `flattening` maps it, with its origin at the mean of the taxels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from taxelflow.messages import Bools, Floats
from taxelflow.numerics.geometry import rotate
from taxelflow.sensors import triangulation
from taxelflow.sensors.flattening import flatten

if TYPE_CHECKING:
    from collections.abc import Iterable

    from taxelflow.sensors.pads import Pad, Patch

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class _Distinct:
    """Taxels that are too close to be two."""

    share: float = 1e-3
    """Of two taxels, as a share of the pad's extent: closer ones are a mistake in the table."""
    extent_m: float = 1e-3
    """Extent that is assumed of smaller pads for that check."""


_DISTINCT = _Distinct()


@dataclass(frozen=True, slots=True, eq=False)
class PadGeometry:
    """Taxels of one pad.

    row, col: (taxels,), cell in the grid, or in a raster that shows a table; shape: rows and columns of that raster.
    xy: (taxels, 2), position in the pad's frame, m. pitch_m: along x and y. area_m2: (taxels,).
    place_m, normal: (taxels, 3), position and outward unit normal in space, m: in the hand's 3-D frame if the pad's
    `pose` is known, else in that of the table or grid.
    table: whether the taxels are given as a table. stretch: largest relative error of a distance between neighbours
    that flattening causes.
    """

    row: Indices
    col: Indices
    shape: tuple[int, int]
    xy: Floats
    pitch_m: tuple[float, float]
    area_m2: Floats
    place_m: Floats
    normal: Floats
    table: bool = False
    stretch: float = 0.0


@cache
def geometry_of(pad: Pad) -> PadGeometry:
    """Geometry of a pad. Raises ValueError, with the cause and after a colon the remedy, if its table is invalid."""
    geometry = _of_table(pad) if pad.is_table else _of_grid(pad)
    if pad.pose is None:
        return geometry
    pose = np.array(pad.pose)
    positions, normal = rotate(pose[3:], geometry.place_m) + pose[:3], rotate(pose[3:], geometry.normal)
    return replace(geometry, place_m=positions, normal=normal)


def _of_grid(pad: Pad) -> PadGeometry:
    if pad.pitch_m is None:
        raise ValueError("a grid needs its pitch")
    row, col = np.nonzero(present_taxels(pad.rows, pad.cols, pad.missing))
    x = (col - (pad.cols - 1) / 2) * pad.pitch_m[0]
    y = ((pad.rows - 1) / 2 - row) * pad.pitch_m[1]
    xy = np.stack([x, y], axis=1)
    positions, normal = _in_plane(xy)
    return PadGeometry(row, col, (pad.rows, pad.cols), xy, pad.pitch_m, _areas(pad, pad.pitch_m), positions, normal)


def _of_table(pad: Pad) -> PadGeometry:
    table = np.array(pad.taxels, dtype=np.float64)
    if table.shape[1] == 2:
        xy, stretch = table, 0.0
        positions, normal = _in_plane(xy)
    else:
        positions, normal = table[:, :3], table[:, 3:]
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        flattened = flatten(positions, normal)
        xy, stretch = flattened.xy, flattened.stretch
    if len(xy) == 1 and pad.pitch_m is None:
        raise ValueError("the pitch of a single taxel cannot be computed: give pitch_m = [x, y]")
    if triangulation.closest_m(xy) < _DISTINCT.share * max(float(np.ptp(xy, axis=0).max()), _DISTINCT.extent_m):
        raise ValueError("two taxels are closer than a thousandth of the pad: correct their positions in the table")
    pitch = pad.pitch_m or (triangulation.spacing_m(xy),) * 2
    row, col, shape = triangulation.raster(xy)
    return PadGeometry(row, col, shape, xy, pitch, _areas(pad, pitch), positions, normal, table=True, stretch=stretch)


def _in_plane(xy: Floats) -> tuple[Floats, Floats]:
    """Positions and normals (taxels, 3) of taxels at (taxels, 2) in the plane z = 0."""
    normal: Floats = np.tile([0.0, 0.0, 1.0], (len(xy), 1))
    return np.column_stack([xy, np.zeros(len(xy))]), normal


def _areas(pad: Pad, pitch_m: tuple[float, float]) -> Floats:
    area = pad.area_m2 if pad.area_m2 is not None else pitch_m[0] * pitch_m[1]
    return np.broadcast_to(np.asarray(area, dtype=np.float64), pad.count)


def present_taxels(rows: int, cols: int, missing: Iterable[tuple[int, int]]) -> Bools:
    """(rows, cols) of a grid, True where it has a taxel."""
    present = np.ones((rows, cols), dtype=np.bool_)
    for row, col in missing:
        present[row, col] = False
    return present


def patch_taxels(patch: Patch, pad: Pad) -> Indices:
    """(taxels,): numbers, within the pad, of a patch's taxels."""
    if patch.taxels:
        return np.array(patch.taxels, dtype=np.int64)
    if pad.is_table:
        return np.arange(pad.count)
    row, col = np.nonzero(present_taxels(pad.rows, pad.cols, pad.missing))
    rows, cols = patch.rows or (0, pad.rows - 1), patch.cols or (0, pad.cols - 1)
    inside = (row >= rows[0]) & (row <= rows[1]) & (col >= cols[0]) & (col <= cols[1])
    return np.flatnonzero(inside)
