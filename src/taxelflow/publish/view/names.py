"""Names of pads, beside their lights."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.publish.view.camera import Axes
    from taxelflow.publish.view.placement import Placement
    from taxelflow.sensors.layout import Layout

_FEW = 8
"""Pads in space that have names: those of more would cover the taxels. Of more pads laid flat they are smaller."""
_FONT, _SMALL = 0.95, 0.8


class Names:
    """Labels. crowded: there are so many pads in space that none has a name."""

    def __init__(self, server: Any, layout: Layout, placement: Placement, radius_m: float) -> None:
        self._radius = radius_m
        few = layout.pad_count <= _FEW
        self.crowded = placement.spatial and not few
        named = () if self.crowded else layout.pads[: layout.pad_count]
        self._labels = [
            server.scene.add_label(f"/names/{pad}", name, font_screen_scale=_FONT if few else _SMALL)
            for pad, name in enumerate(named)
        ]

    def move(self, spots: Floats, anchors: list[str], axes: Axes) -> None:
        """Put them beside lights at spots (pads, 3), anchored as told, in a picture with these axes."""
        for label, spot, anchor in zip(self._labels, spots, anchors, strict=False):
            sideways = {"center-left": 1.6, "center-right": -1.6}.get(anchor)
            away = -1.6 * axes.up if sideways is None else sideways * axes.right
            if label.anchor != anchor:
                label.anchor = anchor
            label.position = tuple(spot + self._radius * away)
