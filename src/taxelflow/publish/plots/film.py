"""Frames of a film: pressure on the hand, slip vectors, load against time, and events as they come."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taxelflow.numerics.spans import spans
from taxelflow.publish.plots.hand import draw_hand
from taxelflow.publish.plots.marks import draw_arrow, draw_scale, draw_taxels, show_box
from taxelflow.publish.plots.names import free_places, write_names
from taxelflow.publish.plots.outlines import box_mm, extent_mm, on_hand_mm
from taxelflow.publish.plots.sizes import FILM, NAMES
from taxelflow.publish.plots.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    MAGENTA,
    SLIP,
    VERMILION,
    pressure_unit,
    three_digits,
    tick_step,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taxelflow.messages import Bools, Event, Floats
    from taxelflow.sensors.layout import Layout

Frame = NDArray[np.uint8]
"""(height, width, 3), RGB."""


_COLOURS = (BLUE, VERMILION, GREEN, MAGENTA)


@dataclass(frozen=True, slots=True, eq=False)
class Film:
    """What is shown, on the clock of the recording, scan by scan.

    t_s: (n,). pressure: (n, taxels). places, vectors: (n, pads, 2) in the hand frame of `layout`, m and m/s, NaN where
    there is no slip vector. slipping: (n, pads). load: (n, pads). events: all of these times. frames_s: times of the
    frames; zero_s: the time that is shown as 0. darkest, heaviest: pressure that is drawn darkest, and load that is
    100 %, by the contacts of the whole recording. unit: of the pressure.
    """

    title: str
    layout: Layout
    t_s: Floats
    pressure: Floats
    places: Floats
    vectors: Floats
    slipping: Bools
    load: Floats
    events: list[Event]
    frames_s: Floats
    zero_s: float
    darkest: float
    heaviest: float
    unit: str = "Pa"


def on_one_plane(layout: Layout) -> Layout:
    """The layout itself if all its pads have a place on the hand laid flat, else with its pads in a row."""
    if np.isfinite(layout.T_hand[: layout.pad_count]).all():
        return layout
    T_row, right = np.full_like(layout.T_hand, np.nan), 0.0
    for pad in range(layout.pad_count):
        left, end, low, top = extent_mm(layout, pad)
        T_row[pad] = 1e-3 * (right - left), -1e-3 * (low + top) / 2, 0.0
        right += end - left + FILM.gap_mm
    for pad in range(layout.pad_count, len(layout.pads)):
        own = layout.source[layout.of_pad(pad)]
        home = np.unique(np.searchsorted(layout.starts[: layout.pad_count + 1], own, side="right") - 1)
        if len(home) == 1:  # the frame of a group within one pad, and of a contact, is the pad's
            T_row[pad] = T_row[home[0]]
    return replace(layout, T_hand=T_row)


def film_frames(film: Film, times_s: Iterable[float]) -> Iterator[Frame]:
    """The frames at these times, one by one. What never changes is drawn once. Call within `styled()`."""
    import matplotlib.pyplot as plt
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure, hand, load, words = _sheet(film)
    canvas: Any = FigureCanvasAgg(figure)  # its copying of pixels has no types
    moving = _Moving(film, hand, load, words)
    canvas.draw()
    still = canvas.copy_from_bbox(figure.bbox)
    for t_s in times_s:
        canvas.restore_region(still)
        for axis, artist in moving.at(t_s):
            axis.draw_artist(artist)
        yield np.asarray(canvas.buffer_rgba())[..., :3].copy()
    plt.close(figure)


def _sheet(film: Film) -> tuple[Figure, Axes, Axes, Axes]:
    """The figure with all that never changes, and its axes: hand, load, words."""
    import matplotlib.pyplot as plt

    box = box_mm(film.layout)
    ratio = (box[3] - box[2]) / (box[1] - box[0])
    wide = 7.0 if ratio < 0.8 else 4.8
    high = float(np.clip(wide * ratio, 2.0, 6.5))
    width, height = (
        FILM.multiple * round(FILM.dpi * size / FILM.multiple) / FILM.dpi for size in (wide + 2.9, high + 2.3)
    )
    figure = plt.figure(figsize=(width, height), dpi=FILM.dpi)
    hand = figure.add_axes((0.02, 1.85 / height, wide / width, high / height))
    words = figure.add_axes(((wide + 0.25) / width, 1.85 / height, 2.5 / width, high / height))
    load = figure.add_axes((0.75 / width, 0.5 / height, 1 - 1.0 / width, 1.15 / height))
    figure.text(0.02, 1 - 0.12 / height, film.title, fontweight="bold", ha="left", va="top")
    draw_hand(hand, film.layout, None)
    show_box(hand, box)
    for axis in (hand, words):
        axis.axis("off")
    words.set_xlim(0, 1)
    words.set_ylim(0, 1)
    draw_scale(hand, box)
    draw_load(load, film)
    return figure, hand, load, words


def draw_load(axis: Axes, film: Film) -> None:
    """Load of the busiest pads against time, in % of the recording's largest, over the slips of all pads."""
    pads = np.arange(film.layout.pad_count)
    busiest = sorted(pads, key=lambda pad: -float(np.nanmax(film.load[:, pad], initial=0.0)))[: FILM.lines]
    touched = {event.pad for event in film.events}
    t_s = film.t_s - film.zero_s
    for first, stop in spans(np.logical_or.reduce(film.slipping, axis=1)):
        axis.axvspan(t_s[max(first - 1, 0)], t_s[stop - 1], color=SLIP, linewidth=0, zorder=0)
    for pad, colour in zip(busiest, _COLOURS, strict=False):
        name, share = film.layout.pads[pad], film.load[:, pad] / film.heaviest
        if name in touched or np.nanmax(share, initial=0.0) > FILM.idle:
            axis.plot(t_s, 100 * share, color=colour, linewidth=1.0, label=name)
    axis.set_xlim(film.frames_s[0] - film.zero_s, max(film.frames_s[-1], film.frames_s[0] + 1e-3) - film.zero_s)
    axis.set_ylim(-4, 108)
    axis.set_ylabel("load in %")
    axis.set_xlabel("time in s; shaded: slip", labelpad=1)
    if axis.lines:
        axis.legend(loc="lower left", bbox_to_anchor=(0.0, 0.98), ncols=FILM.lines, fontsize=7, borderaxespad=0.1)


class _Moving:
    """What changes from frame to frame."""

    def __init__(self, film: Film, hand: Axes, load: Axes, words: Axes) -> None:
        from matplotlib.collections import LineCollection, PolyCollection

        self._film, self._axes = film, (hand, load, words)
        layout = film.layout
        placed = [pad for pad in range(layout.pad_count) if np.isfinite(layout.T_hand[pad]).all()]
        shapes = [shape for pad in placed for shape in on_hand_mm(layout, pad)]
        self._taxels = draw_taxels(hand, shapes, cmap="Blues", animated=True)
        self._taxels.set_clim(-0.08, 1.3)
        self._shafts, self._heads = LineCollection([], linewidths=2.0), PolyCollection([])
        for arrows in (self._shafts, self._heads):
            arrows.set_animated(True)
            arrows.set_clip_on(False)
            hand.add_collection(arrows, autolim=False)
        left, right = hand.get_xlim()
        self._wide_mm = right - left
        speed = np.hypot(*film.vectors[film.slipping].T) if film.slipping.any() else np.zeros(0)
        speed = speed[np.isfinite(speed)]
        self._fastest = float(np.quantile(speed, FILM.typical)) if len(speed) else 0.05
        self._fastest = max(self._fastest, 1e-4)
        self._now = load.axvline(0.0, color=INK, linewidth=1.0, animated=True)
        self._clock = words.text(0, 0.98, "", fontsize=15, va="top", family="monospace", animated=True)
        self._seen = words.text(0, 0.80, "", fontsize=8, va="top", color=INK, linespacing=1.5, animated=True)
        self._draw_key(hand, words)
        _name_pads(hand, film.layout, placed)

    def _draw_key(self, hand: Axes, words: Axes) -> None:
        """An arrow of a round speed beside the scale of length, and what the colours mean."""
        speed = tick_step(1e3 * self._fastest, 2)
        left, low = hand.get_xlim()[0], hand.get_ylim()[0]
        x, y = left + 0.3 * self._wide_mm, low + 0.02 * self._wide_mm
        tip = (x + 1e-3 * speed * FILM.longest * self._wide_mm / self._fastest, y)
        draw_arrow(hand, (x, y), tip, VERMILION, 2.0)
        hand.annotate(f"{speed:g} mm/s", (x, y), (0, 4), textcoords="offset points", fontsize=7)
        scale, unit = pressure_unit(self._film.unit, self._film.darkest)
        shade = f"pressure: darkest at {three_digits(self._film.darkest / scale)} {unit} or more"
        seen = "arrows: orange where the pad slips, else grey"
        words.text(0, 0.0, f"{shade}\n{seen}", fontsize=7, color=INK, linespacing=1.4)

    def at(self, t_s: float) -> list[tuple[Axes, Any]]:
        """Axes and artists to draw at a time."""
        film, (hand, load, words) = self._film, self._axes
        k = max(int(np.searchsorted(film.t_s, t_s, side="right")) - 1, 0)
        self._taxels.set_array(np.clip(film.pressure[k] / film.darkest, 0.0, 1.0))
        self._set_arrows(k)
        self._now.set_xdata([t_s - film.zero_s])
        self._clock.set_text(f"{t_s - film.zero_s:7.2f} s")
        past = [event for event in film.events if event.t_s <= t_s][-2 * FILM.lines :]
        self._seen.set_text("\n".join(_words(event, film.zero_s) for event in reversed(past)))
        drawn: list[tuple[Axes, Any]] = [(hand, self._taxels), (hand, self._shafts), (hand, self._heads)]
        return [*drawn, (load, self._now), (words, self._clock), (words, self._seen)]

    def _set_arrows(self, k: int) -> None:
        film = self._film
        known = np.isfinite(film.vectors[k]).all(axis=1) & np.isfinite(film.places[k]).all(axis=1)
        tail, vector = (
            1e3 * film.places[k][known],
            film.vectors[k][known] * FILM.longest * self._wide_mm / self._fastest,
        )
        length = np.hypot(*vector.T)[:, np.newaxis]
        vector *= np.minimum(1.0, 2.0 * FILM.longest * self._wide_mm / np.maximum(length, 1e-9))
        along = vector / np.maximum(np.hypot(*vector.T)[:, np.newaxis], 1e-9)
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        head = np.minimum(FILM.head * self._wide_mm, np.hypot(*vector.T))[:, np.newaxis]
        tip, neck = tail + vector, tail + vector - head * along
        corners = np.stack([tip, neck + 0.4 * head * across, neck - 0.4 * head * across], axis=1)
        colours = [VERMILION if slips else GREY for slips in film.slipping[k][known]]
        self._shafts.set_segments(list(np.stack([tail, neck], axis=1)))
        self._shafts.set_color(colours)
        self._heads.set_verts(list(corners))
        self._heads.set_color(colours)


def _name_pads(axis: Axes, layout: Layout, pads: Sequence[int]) -> None:
    """Names beside the pads, if all of them have room there."""
    shapes = [on_hand_mm(layout, pad).reshape(-1, 2) for pad in pads]
    names = free_places(axis, shapes, [layout.pads[pad] for pad in pads], NAMES.points)
    if not any(name.covers for name in names):
        write_names(axis, names, NAMES.points)


def _words(event: Event, zero_s: float) -> str:
    speed = f"  {1e3 * event.speed_m_s:.0f} mm/s" if np.isfinite(event.speed_m_s) else ""
    return f"{event.t_s - zero_s:7.2f} s  {event.pad}\n{'':12}{event.event.replace('_', ' ')}{speed}"
