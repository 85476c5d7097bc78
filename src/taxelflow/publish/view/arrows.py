"""Slip vectors of one method as arrows, with the paper's concentric rings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.publish.view import shapes
from taxelflow.publish.view.batch import add_batch, put
from taxelflow.publish.view.look import ARROWS
from taxelflow.publish.view.palette import round_up

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats
    from taxelflow.publish.view.vectors import Vectors


class Arrows:
    """Arrows of `count` pads, groups and contacts. wide: width of the arrows, relative. rings: whether they have."""

    def __init__(self, server: Any, name: str, count: int, size_m: float, *, wide: float = 1.0, rings: bool) -> None:
        self._size, self._wide = size_m, wide
        self._normal = np.zeros((count, 3))  # that the rings stand on
        self.arrows = add_batch(server, f"{name}/arrows", shapes.arrow(ARROWS.head, ARROWS.shaft), count, visible=False)
        self._rings = None
        if rings:
            shape = shapes.ring(0.955, 0.03)
            more = {"side": "double", "opacity": 0.75, "visible": False}
            self._rings = add_batch(server, f"{name}/rings", shape, ARROWS.rings * count, **more)

    def tint(self, ring: Any) -> None:
        """Colour of the rings, (3,)."""
        if self._rings is not None:
            self._rings.batched_colors = np.tile(ring, (len(self._rings.batched_positions), 1))

    def draw(self, vectors: Vectors, colours: Any, per_speed_s: float, raised_m: float) -> None:
        """colours: (count, 3). per_speed_s: length over speed. raised_m: above the skin."""
        size = self._size
        known: Bools = np.logical_and.reduce(np.isfinite(vectors.velocity), axis=1)
        shown = bool(known.any())
        if not shown:
            self._show(shown)
            return
        ring = ARROWS.ring * size
        start = np.where(known[:, np.newaxis], vectors.start, 0.0) + raised_m * vectors.normal
        arrow = np.where(known[:, np.newaxis], vectors.velocity, 0.0) * per_speed_s
        length = np.minimum(np.linalg.norm(arrow, axis=1), ARROWS.longest * ring)
        wide = self._wide * np.minimum(ARROWS.wide * size, ARROWS.slim * length)
        scales = np.column_stack([wide, wide, length]) + shapes.NONE
        turned = shapes.standing(arrow)
        put(self.arrows, batched_positions=start, batched_wxyzs=turned, batched_colors=colours, batched_scales=scales)
        if self._rings is not None:
            self._draw_rings(start, vectors.normal, np.where(known, ring, 0.0))
        self._show(shown)

    def _show(self, shown: bool) -> None:
        self.arrows.visible = shown
        if self._rings is not None:
            self._rings.visible = shown

    def _draw_rings(self, start: Floats, normal: Floats, radius: Floats) -> None:
        each = np.repeat(radius, ARROWS.rings) * np.tile(np.arange(ARROWS.rings) + 1, len(radius)) + shapes.NONE
        put(
            self._rings,
            batched_positions=np.repeat(start, ARROWS.rings, axis=0),
            batched_scales=np.repeat(each[:, np.newaxis], 3, axis=1),
        )
        if not np.array_equal(normal, self._normal):
            self._normal = normal
            put(self._rings, batched_wxyzs=np.repeat(shapes.standing(normal), ARROWS.rings, axis=0))


def speed_of_ring(speeds: Floats) -> float:
    """A round speed for the first ring: typical slips reach the second one."""
    known = speeds[np.isfinite(speeds)]
    return round_up(float(np.quantile(known, 0.8)) / ARROWS.rings) if len(known) else 0.01
