"""Colours and round numbers of the view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Rgb = tuple[int, int, int]

_STOPS = (
    (0.25, (0, 92, 170)),
    (0.45, (0, 140, 130)),
    (0.65, (120, 175, 20)),
    (0.82, (255, 165, 0)),
    (1.00, (255, 240, 130)),
)
"""Pressure up to the top of the scale, from the colour of an idle taxel on: lightness grows, so that
a grey print can be read, too."""


def ramp(idle: Rgb) -> NDArray[np.uint8]:
    """(256, 3), colours of pressure. idle: that of a taxel without any."""
    at, colours = zip((0.0, idle), *_STOPS, strict=True)
    level = np.linspace(0.0, 1.0, 256)
    channels = [np.interp(level, at, channel) for channel in zip(*colours, strict=True)]
    return np.stack(channels, axis=1).round().astype(np.uint8)


VERMILION: Rgb = (235, 70, 0)
MAGENTA: Rgb = (225, 40, 170)
GREEN: Rgb = (0, 150, 95)
GREY: Rgb = (128, 134, 146)


@dataclass(frozen=True)
class Theme:
    """Colours of the surroundings. line: of slip vectors; second: of those of a second method. ring: of their rings.
    idle: taxels without pressure. words: of names and scales.
    """

    dark: bool
    background: Rgb
    plate: Rgb
    idle: Rgb
    line: Rgb
    ring: Rgb
    second: Rgb
    words: Rgb
    link: Rgb

    @property
    def body(self) -> Rgb:
        """Of what is inside a closed skin."""
        red, green, blue = (round(0.5 * (own + far)) for own, far in zip(self.plate, self.background, strict=True))
        return red, green, blue

    @property
    def glow(self) -> Rgb:
        """Of the plate under a pad that slips."""
        red, green, blue = (round(0.45 * own + 0.55 * hot) for own, hot in zip(self.plate, VERMILION, strict=True))
        return red, green, blue


DARK = Theme(
    dark=True,
    background=(17, 19, 25),
    plate=(50, 56, 71),
    idle=(72, 79, 97),
    line=(255, 255, 255),
    ring=(128, 134, 148),
    second=(90, 215, 255),
    words=(196, 201, 212),
    link=(104, 113, 132),
)
LIGHT = Theme(
    dark=False,
    background=(250, 250, 252),
    plate=(205, 209, 218),
    idle=(176, 183, 197),
    line=(20, 22, 28),
    ring=(90, 96, 110),
    second=(0, 120, 190),
    words=(66, 71, 84),
    link=(150, 158, 174),
)


_ROUND = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
"""Round numbers, so near to each other that a scale is used to two thirds at least."""


def round_up(value: float) -> float:
    """The next of 1, 1.5, 2, 3, 4, 5, 6, 8, 10, 15, ... that is not smaller; 1 for a value that is not above 0."""
    if not (value > 0 and np.isfinite(value)):
        return 1.0
    power = 10.0 ** np.floor(np.log10(value) + 1e-12)
    return float(next(step * power for step in _ROUND if step * power >= value * (1 - 1e-9)))


def number(value: float) -> str:
    """A round number in words: 0.5, 7.5, 20, 4000, 100 000."""
    if value < 100:
        return f"{value:.3g}"
    return f"{value:,.0f}".replace(",", " ") if value >= 1e4 else f"{value:.0f}"
