"""Names of pads, beside their lights."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from taxelflow.publish.view.lettering import LEFT, RIGHT, TOP, Label
from taxelflow.publish.view.look import NAMES

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.publish.view.camera import View
    from taxelflow.publish.view.palette import Rgb
    from taxelflow.publish.view.placement import Placement
    from taxelflow.sensors.layout import Layout

_ANCHORS = {"center-left": (1.5, LEFT), "center-right": (-1.5, RIGHT)}


class Names:
    """Labels of pads. crowded: too many pads stand in space for names, and none is drawn."""

    def __init__(self, server: Any, layout: Layout, placement: Placement, radius_m: float) -> None:
        self._radius = radius_m
        few = layout.pad_count <= NAMES.few
        self.crowded = placement.spatial and not few
        named = () if self.crowded else layout.pads[: layout.pad_count]
        self._em = NAMES.large if few else NAMES.small
        self._words = [Label(server, f"/names/{pad}", name) for pad, name in enumerate(named)]

    def tint(self, colour: Rgb) -> None:
        """Write them in a colour."""
        for words in self._words:
            words.tint(colour)

    def move(self, spots: Floats, anchors: list[str], view: View) -> None:
        """Place each label beside its light at spots (pads, 3), on the side of its anchor, in front of the hand."""
        axes, pixel_m = view.axes, self._em * view.wide_m / NAMES.em
        if len(spots):
            pixel_m *= view.nearer(spots.mean(axis=0))[1]  # all are equally large in the picture
        for words, spot, anchor in zip(self._words, spots, anchors, strict=False):
            sideways, own = _ANCHORS.get(anchor, (0.0, TOP))
            away = sideways * axes.right if sideways else -1.3 * axes.up
            place, _ = view.nearer(spot + self._radius * away)
            words.move(place, axes, own, pixel_m)
