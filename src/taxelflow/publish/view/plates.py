"""The plates under plane pads: rectangles under matrices, rounded outlines under pads of another form."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.publish.view import shapes
from taxelflow.publish.view.batch import add_batch, put
from taxelflow.publish.view.look import PLATES

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.publish.view.placement import Placement
    from taxelflow.publish.view.shapes import Shape
    from taxelflow.sensors.layout import Layout


class Plates:
    """One under each plane pad; a curved pad has none."""

    def __init__(self, server: Any, layout: Layout, placement: Placement, **look: Any) -> None:
        """look: what viser takes, such as opacity."""
        self._layout = layout
        alike: dict[bytes, list[int]] = {}
        outlines = {}
        for pad in range(layout.pad_count):
            if _plane(placement.normal[layout.of_pad(pad)]):
                outline = _outline(layout, pad)
                key = np.round(outline * 1e6).tobytes()
                outlines[key] = outline
                alike.setdefault(key, []).append(pad)
        self._batches = []
        for number, (key, pads) in enumerate(alike.items()):
            shape = _prism(outlines[key], PLATES.thick * float(np.median(layout.pitch_m[pads[0]])))
            scales = np.ones((len(pads), 3))
            name = f"/plates/{number}"
            self._batches.append(
                (pads, add_batch(server, name, shape, len(pads), scales=scales, flat_shading=True, **look))
            )

    def move(self, placement: Placement) -> None:
        """Put them under the pads as they are placed."""
        layout = self._layout
        for pads, batch in self._batches:
            first = [layout.of_pad(pad).start for pad in pads]
            normal, tangent = placement.normal[first], placement.tangent[first]
            local = np.stack([layout.x_m[first], layout.y_m[first]], axis=1)
            below = PLATES.below * np.median(layout.pitch_m[pads], axis=1)[:, np.newaxis]
            origin = placement.place[first] - np.einsum("nij,nj->ni", tangent, local) - below * normal
            put(batch, batched_positions=origin, batched_wxyzs=shapes.along(normal, tangent[:, :, 0]))

    def tint(self, colours: Any) -> None:
        """colours: (pads, 3)."""
        for pads, batch in self._batches:
            put(batch, batched_colors=colours[pads])


def _plane(normal: Floats) -> bool:
    return bool(np.abs(normal - normal[0]).max() <= PLATES.plane)


def _outline(layout: Layout, pad: int) -> Floats:
    """(n, 2), anticlockwise, in the pad's frame."""
    own = layout.of_pad(pad)
    xy, rim = np.stack([layout.x_m[own], layout.y_m[own]], axis=1), PLATES.rim * layout.pitch_m[pad]
    if layout.tables[pad]:
        turn = 2 * np.pi * (np.arange(PLATES.corners) + 0.5) / PLATES.corners
        around = rim * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        return _hull((xy[:, np.newaxis] + around).reshape(-1, 2))
    (left, bottom), (right, top) = xy.min(axis=0) - rim, xy.max(axis=0) + rim
    return np.array([(left, bottom), (right, bottom), (right, top), (left, top)])


def _hull(points: Floats) -> Floats:
    """(n, 2), convex hull of points (m, 2), anticlockwise."""
    from scipy.spatial import ConvexHull

    found: Floats = points[ConvexHull(points).vertices]
    return found


def _prism(outline: Floats, thick_m: float) -> Shape:
    """A plate of this outline (n, 2), whose upper side has z = 0."""
    count = len(outline)
    vertices = np.concatenate([np.column_stack([outline, np.full(count, z)]) for z in (0.0, -thick_m)])
    here = np.arange(count)
    there = (here + 1) % count
    fan = np.stack([np.zeros(count - 2, dtype=int), here[1:-1], there[1:-1]], axis=1)
    sides = np.stack([here, here + count, there + count, here, there + count, there], axis=1).reshape(-1, 3)
    return shapes.Shape(vertices, np.concatenate([fan, fan[:, ::-1] + count, sides]))
