"""Colours and round numbers of the view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Rgb = tuple[int, int, int]


def rgb(code: str) -> Rgb:
    """A colour from its code in CSS, such as #eb4600."""
    red, green, blue = bytes.fromhex(code.removeprefix("#"))
    return red, green, blue


_STOPS = (
    (0.25, rgb("#005caa")),
    (0.45, rgb("#008c82")),
    (0.65, rgb("#78af14")),
    (0.82, rgb("#ffa500")),
    (1.00, rgb("#fff082")),
)
"""Pressure up to the top of the scale, from the colour of an idle taxel on: lightness grows, so that
a grey print can be read, too."""


def ramp(idle: Rgb) -> NDArray[np.uint8]:
    """(256, 3), colours of pressure. idle: that of a taxel without any."""
    at, colours = zip((0.0, idle), *_STOPS, strict=True)
    level = np.linspace(0.0, 1.0, 256)
    channels = [np.interp(level, at, channel) for channel in zip(*colours, strict=True)]
    return np.stack(channels, axis=1).round().astype(np.uint8)


VERMILION: Rgb = rgb("#eb4600")
MAGENTA: Rgb = rgb("#e128aa")
GREEN: Rgb = rgb("#00965f")
GREY: Rgb = rgb("#808692")


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
    background=rgb("#111319"),
    plate=rgb("#323847"),
    idle=rgb("#484f61"),
    line=rgb("#ffffff"),
    ring=rgb("#808694"),
    second=rgb("#5ad7ff"),
    words=rgb("#c4c9d4"),
    link=rgb("#687184"),
)
LIGHT = Theme(
    dark=False,
    background=rgb("#fafafc"),
    plate=rgb("#cdd1da"),
    idle=rgb("#b0b7c5"),
    line=rgb("#14161c"),
    ring=rgb("#5a606e"),
    second=rgb("#0078be"),
    words=rgb("#424754"),
    link=rgb("#969eae"),
)


def round_up(value: float) -> float:
    """The next of 1, 1.5, 2, 3, 4, 5, 6, 8, 10, 15, ... that is not smaller; 1 for a value that is not above 0.

    Of a scale that ends there, two thirds at least are used.
    """
    if not (value > 0 and np.isfinite(value)):
        return 1.0
    power = 10.0 ** np.floor(np.log10(value) + 1e-12)
    return float(
        next(
            step * power
            for step in (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
            if step * power >= value * (1 - 1e-9)
        )
    )


def number(value: float) -> str:
    """A round number in words: 0.5, 7.5, 20, 4000, 100 000."""
    if value < 100:
        return f"{value:.3g}"
    return f"{value:,.0f}".replace(",", " ") if value >= 1e4 else f"{value:.0f}"
