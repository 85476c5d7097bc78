"""Slip vectors of one method as arrows, with the paper's concentric rings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.publish.view import shapes
from taxelflow.publish.view.batch import add_batch, put

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats
    from taxelflow.publish.view.vectors import Vectors

RING = 0.03
"""Radius of the first ring, as a share of the hand's size."""
RINGS = 2
_LONGEST = 3.2
"""Length of the longest arrow, in rings; a faster slip is drawn as long as this."""
_THICK, _HEAD = 0.0095, 0.036
"""Width of a shaft and length of a head, as shares of the hand's size."""


class Arrows:
    """Arrows of `count` pads, groups and contacts. wide: width of the arrows, relative. rings: whether they have."""

    def __init__(self, server: Any, name: str, count: int, size_m: float, *, wide: float = 1.0, rings: bool) -> None:
        self._size, self._wide = size_m, wide
        self._shafts = add_batch(server, f"{name}/shafts", shapes.disc(), count)
        self._heads = add_batch(server, f"{name}/heads", shapes.cone(), count)
        self._rings = None
        if rings:
            shape = shapes.ring(0.965)
            self._rings = add_batch(server, f"{name}/rings", shape, RINGS * count, side="double", opacity=0.75)

    def tint(self, ring: Any) -> None:
        """Colour of the rings, (3,)."""
        if self._rings is not None:
            self._rings.batched_colors = np.tile(ring, (len(self._rings.batched_positions), 1))

    def draw(self, vectors: Vectors, colours: Any, per_speed_s: float, raised_m: float) -> None:
        """colours: (count, 3). per_speed_s: length over speed. raised_m: above the skin."""
        size = self._size
        known: Bools = np.logical_and.reduce(np.isfinite(vectors.velocity), axis=1)
        ring = RING * size
        start = np.where(known[:, np.newaxis], vectors.start, 0.0) + raised_m * vectors.normal
        arrow = np.where(known[:, np.newaxis], vectors.velocity, 0.0) * per_speed_s
        length = np.linalg.norm(arrow, axis=1)
        arrow *= np.minimum(1.0, _LONGEST * ring / np.maximum(length, 1e-12))[:, np.newaxis]
        length = np.minimum(length, _LONGEST * ring)
        thick, head = self._wide * _THICK * size, np.minimum(_HEAD * size, 0.6 * length)
        shaft = np.maximum(length - head, 0.0) * known
        turned, ends = shapes.standing(arrow), arrow / np.maximum(length, 1e-12)[:, np.newaxis]
        for handle, at, high, width in (
            (self._shafts, start, shaft, np.full(len(length), thick)),
            (self._heads, start + ends * shaft[:, np.newaxis], head, 0.75 * self._wide * head),
        ):
            shown = np.where(known & (length > 0), width, 0.0)
            scales = np.column_stack([shown, shown, np.where(known, high, 0.0)]) + shapes.NONE
            put(handle, batched_positions=at, batched_wxyzs=turned, batched_colors=colours, batched_scales=scales)
        if self._rings is not None:
            self._draw_rings(start, vectors.normal, np.where(known, ring, 0.0))

    def _draw_rings(self, start: Floats, normal: Floats, radius: Floats) -> None:
        each = np.repeat(radius, RINGS) * np.tile(np.arange(RINGS) + 1, len(radius)) + shapes.NONE
        put(
            self._rings,
            batched_positions=np.repeat(start, RINGS, axis=0),
            batched_wxyzs=np.repeat(shapes.standing(normal), RINGS, axis=0),
            batched_scales=np.repeat(each[:, np.newaxis], 3, axis=1),
        )
