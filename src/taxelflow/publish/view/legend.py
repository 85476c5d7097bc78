"""The legend: the scale of pressure with its unit, rings, lights, and the time, below the hand."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from taxelflow.publish.view.lettering import LEFT, RIGHT, Anchor, Label, Plane, font
from taxelflow.publish.view.look import ARROWS, LEGEND
from taxelflow.publish.view.palette import GREEN, MAGENTA, VERMILION, number, ramp

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.publish.view.camera import Axes
    from taxelflow.publish.view.palette import Rgb, Theme


class Scales(NamedTuple):
    """Of pressure, from 0 to `top` in a unit, and speed of the first ring. moves: the object's motion may be drawn."""

    top: float
    unit: str
    ring_m_s: float
    moves: bool


class Legend:
    """Stands below the hand, in the plane of the picture."""

    def __init__(self, server: Any) -> None:
        self._server = server
        self._plane = Plane(server, "/legend")
        self._clock: Label | None = None
        self._end: tuple[Floats, Axes, Anchor, float] | None = None
        self._colour: Rgb = (0, 0, 0)
        self._drawn: tuple[Theme, Scales] | None = None

    def place(self, points: Floats, axes: Axes, wide_m: float) -> Floats:
        """Move it below points (n, 3) as seen along the axes, in a picture so wide; return its own corners (m, 3)."""
        own = points @ np.stack(axes, axis=1)
        low, high = own.min(axis=0), own.max(axis=0)
        depth, pixel_m = float((low[2] + high[2]) / 2), LEGEND.wide * wide_m / LEGEND.size[0]
        wide, tall = pixel_m * np.array(LEGEND.size)
        x, y = (low[0] + high[0]) / 2, low[1] - LEGEND.below * wide_m

        def at(aside: float, below: float) -> Floats:
            found: Floats = (x + aside) * axes.right + (y - below) * axes.up + depth * axes.out
            return found

        self._plane.move(at(-wide / 2, tall / 2), axes, LEFT, pixel_m)
        self._end = at(wide / 2, pixel_m * LEGEND.rows[0]), axes, RIGHT, pixel_m
        self._put_clock()
        return np.stack([at(-wide / 2, tall), at(wide / 2, tall)])

    def show(self, theme: Theme, scales: Scales) -> None:
        """Draw in the colours of a theme."""
        self._colour = theme.words
        if (theme, scales) != self._drawn:
            self._drawn = theme, scales
            self._plane.draw(drawn(theme, scales))
        if self._clock is not None:
            self._clock.tint(theme.words)

    def write(self, words: str) -> None:
        """Write words, such as the time, to the right."""
        if self._clock is None:
            self._clock = Label(self._server, "/clock", words)
            self._put_clock()
        self._clock.words = words
        self._clock.tint(self._colour)

    def _put_clock(self) -> None:
        if self._clock is not None and self._end is not None:
            self._clock.move(*self._end)


def drawn(theme: Theme, scales: Scales) -> Any:
    """(height, width, 4), the legend but for the time."""
    from PIL import Image, ImageDraw

    image = Image.new("RGBA", LEGEND.size, (*theme.words, 0))
    pen = ImageDraw.Draw(image)
    _draw_bar(image, pen, theme, scales)
    x = _draw_rings(pen, theme, scales, LEGEND.bar[2] + 88)
    for row, colour, word in ((LEGEND.rows[0], GREEN, "contact"), (LEGEND.rows[1], VERMILION, "slip")):
        pen.ellipse((x, row - 12, x + 24, row + 12), fill=(*colour, 255))
        _write(pen, theme, x + 38, row, word)
    x += 38 + 152
    _draw_arrow(pen, theme.line, x, LEGEND.rows[0])
    _write(pen, theme, x + 80, LEGEND.rows[0], "slip velocity")
    if scales.moves:
        _draw_arrow(pen, MAGENTA, x, LEGEND.rows[1])
        _write(pen, theme, x + 80, LEGEND.rows[1], "motion of the object")
    return np.asarray(image)


def _draw_bar(image: Any, pen: Any, theme: Theme, scales: Scales) -> None:
    from PIL import Image, ImageDraw

    left, top, right, bottom = LEGEND.bar
    colours = ramp(theme.idle)[np.linspace(0, 255, right - left).astype(int)]
    bar = Image.fromarray(np.repeat(colours[np.newaxis], bottom - top, axis=0))
    mask = Image.new("L", bar.size, 0)
    ImageDraw.Draw(mask).rounded_rectangle((0, 0, *bar.size), radius=6, fill=255)
    image.paste(bar, (left, top), mask)
    end, middle, wide = f"{number(scales.top)} {scales.unit}", number(0.5 * scales.top), right - left
    marks = [(0.0, "0", "lm"), (1.0, end, "rm")]
    if font().getlength(end) + 0.6 * font().getlength(middle) < 0.5 * wide:  # else they would touch
        marks.append((0.5, middle, "mm"))
    for share, words, anchor in marks:
        pen.text((left + share * wide, LEGEND.rows[1]), words, fill=(*theme.words, 255), font=font(), anchor=anchor)


def _draw_rings(pen: Any, theme: Theme, scales: Scales, x: int) -> int:
    """At x; returns where it ends."""
    middle = sum(LEGEND.rows) // 2
    for k in range(ARROWS.rings):
        radius = LEGEND.radius * (k + 1) // ARROWS.rings
        box = (x + LEGEND.radius - radius, middle - radius, x + LEGEND.radius + radius, middle + radius)
        pen.ellipse(box, outline=(*theme.ring, 255), width=3)
    words = ", ".join(number(1e3 * scales.ring_m_s * (k + 1)) for k in range(ARROWS.rings)) + " mm/s"
    _write(pen, theme, x + 106, middle, words)
    return int(x + 106 + font().getlength(words) + 72)


def _draw_arrow(pen: Any, colour: Rgb, x: int, y: int) -> None:
    pen.line((x, y, x + 42, y), fill=(*colour, 255), width=7)
    pen.polygon(((x + 37, y - 14), (x + 64, y), (x + 37, y + 14)), fill=(*colour, 255))


def _write(pen: Any, theme: Theme, x: int, y: int, words: str) -> None:
    pen.text((x, y), words, fill=(*theme.words, 255), font=font(), anchor="lm")
