"""The skins of a layout's pads, as `numerics.rest_or_slide` compares patterns on them."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.rest_or_slide import compare, overlap
from taxelflow.numerics.slid import Skin

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.sensors.layout import Layout

_MOST = 256
"""Skins that are kept: those of a robot, which several stages read."""


def skin_of(layout: Layout, pad: int) -> Skin:
    """The taxels of a pad, in pitches; those of its contacts are the same."""
    whole = int(layout.contact_of[pad])
    return _skin(layout, whole if whole >= 0 else pad)


@lru_cache(_MOST)
def _skin(layout: Layout, pad: int) -> Skin:
    own = layout.of_pad(pad)
    places_m = np.stack([layout.x_m[own], layout.y_m[own]])
    return Skin.of(places_m / np.sqrt(layout.pitch_m[pad].prod()))


def prepare(layout: Layout) -> None:
    """Make all skins, and load the kernels, so that no comparison of a stream waits for them."""
    for pad in np.flatnonzero(np.diff(layout.starts)).tolist():
        skin = skin_of(layout, pad)
        even = np.ones(skin.places.shape[1])
        compare(skin, even, even, 0.0, np.zeros(3), sinks=True)
        overlap(skin, even, even)


class PadNoise:
    """Median noise of each pad's taxels, computed again only when the estimate of the noise changes."""

    def __init__(self, layout: Layout) -> None:
        self._layout, self._of = layout, np.zeros(0)
        self._median = np.full(len(layout.pads), np.nan)

    def median(self, noise: Floats) -> Floats:
        """(pads,), of standard deviations of a reading (entries,); NaN of a pad without taxels."""
        if noise is not self._of:
            self._of = noise
            own = [noise[self._layout.of_pad(pad)] for pad in range(len(self._median))]
            self._median = np.array([np.median(each) if len(each) else np.nan for each in own])
        return self._median
