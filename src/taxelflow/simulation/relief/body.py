"""The rigid object: its height map on a fine raster, looked up at points of the pad."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from taxelflow.simulation.relief.shapes import DEEPEST, height_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Floats
    from taxelflow.simulation.relief.parameters import Object


@dataclass(frozen=True, slots=True)
class _Raster:
    """Raster of the height map."""

    cells: int = 360
    """Cells of the raster along each axis."""
    half: float = 1.3
    """Half its side over half the object's size: beyond it the object is too deep to touch."""
    touchable: float = 0.9
    """Share of the deepest height below which nothing touches."""
    touches: float = 0.8
    """Depth, in heights of the relief, down to which the area's centroid defines the body's origin."""


_RASTER = _Raster()


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A relief in the frame of its load point.

    height_m: (cells, cells), v along the first axis, u along the second, at the nodes of a square raster from -half_m
    to half_m about `centre_m`. centre_m: (2,), the raster's centre in body coordinates. reach_m: distance from the load
    point of the farthest part that can touch. lowest_m: height outside the raster.
    """

    height_m: Floats
    half_m: float
    centre_m: Floats
    reach_m: float
    lowest_m: float

    def height(self, u_m: Floats, v_m: Floats) -> Floats:
        """Height (...) at body coordinates (...), m; bilinear between the raster's nodes, `lowest_m` outside."""
        scale = (len(self.height_m) - 1) / (2 * self.half_m)
        at = [(v_m - self.centre_m[1] + self.half_m) * scale, (u_m - self.centre_m[0] + self.half_m) * scale]
        found: Floats = map_coordinates(self.height_m, at, order=1, mode="constant", cval=self.lowest_m)
        return found

    def near(self, x_m: Floats, y_m: Floats, at_m: Floats) -> NDArray[np.int64]:
        """Numbers of the points (points,) of the pad that the relief can touch from one of the places at_m (n, 2)."""
        if not len(at_m):
            return np.zeros(0, dtype=np.int64)
        away, _ = cKDTree(at_m).query(np.stack([x_m, y_m], axis=1))
        return np.flatnonzero(away <= self.reach_m)


def body_of(thing: Object) -> Body:
    """The object's raster. The load point is the centroid of the area near its top, so that it can stand."""
    nodes = np.linspace(-_RASTER.half, _RASTER.half, _RASTER.cells)
    s, t = np.meshgrid(nodes, nodes)
    height = height_of(thing.shape, s, t, thing.seed)
    height = height - height.max()
    near = np.maximum(height + _RASTER.touches, 0.0)
    centroid = np.array([np.sum(near * s), np.sum(near * t)]) / near.sum()
    touching = height > -_RASTER.touchable * DEEPEST
    away = np.hypot(s[touching] - centroid[0], t[touching] - centroid[1])
    half_m = thing.size_m / 2
    return Body(
        height_m=thing.relief_m * np.maximum(height, -DEEPEST),
        half_m=_RASTER.half * half_m,
        centre_m=-centroid * half_m,
        lowest_m=-DEEPEST * thing.relief_m,
        reach_m=half_m * (float(away.max()) + nodes[1] - nodes[0]),
    )
