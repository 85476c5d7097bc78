"""Position against time, with regression lines where strokes are known: the paper's Fig. 9."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.publish.plots.style import GREY, INK, look, plain

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taxelflow.messages import Floats
    from taxelflow.publish.results import Track

_FEWEST = 3
_CROWDED = 400
_MOST_NUMBERS = 8
"""Strokes that still leave room for their slopes as numbers."""
_BESIDE = {"o": (34, 14), "^": (42, -14)}
"""Where a line's slope stands, in points from its middle, by the method's marker; no leader crosses another's."""


def position_figure(
    tracks: Sequence[Track], truth: tuple[Floats, Floats] | None = None, strokes: Sequence[tuple[float, float]] = ()
) -> Figure:
    """Tracks of one pad by several methods.

    truth: times (n,) and positions (n, 2), on the tracks' clock. strokes: (from, to) in s on the same clock; through
    each a regression line is drawn per method, along the axis of most motion, with its slope if they are few.
    """
    import matplotlib.pyplot as plt

    start_s = min(float(track.numbers["t_s"][0]) for track in tracks)
    figure, axes = plt.subplots(2, 1, sharex=True, figsize=(7.2, 4.6), height_ratios=(2, 1), layout="constrained")
    main = _main_axis(tracks)
    for axis, component in zip(axes, (main, 1 - main), strict=True):
        if truth is not None:
            _draw_truth(axis, truth[0] - start_s, 1e3 * truth[1][:, component], tracks, start_s)
        for track in tracks:
            style = look(track.method)
            t_s, at_mm = track.t_s - start_s, 1e3 * track.position_m[:, component]
            size = 2.0 if np.isfinite(at_mm).sum() > _CROWDED else 4.0
            axis.plot(t_s, at_mm, linestyle="none", markersize=size, markeredgewidth=0, alpha=0.85, **style)
        axis.set_ylabel(f"{'xy'[component]} in mm")
    for track in tracks:
        _draw_lines(axes[0], track, main, start_s, strokes)
    axes[0].set_title(plain(f"Object on {tracks[0].pad}"))
    axes[0].legend(loc="upper center", bbox_to_anchor=(0.5, 1.0), ncols=4, columnspacing=1.2, handlelength=1.4)
    low, high = axes[0].get_ylim()
    axes[0].set_ylim(low, high + 0.18 * (high - low))
    low, high = axes[1].get_ylim()
    least = 0.12 * np.ptp(axes[0].get_ylim())  # so that a small drift does not look like a large one
    grow = max(0.0, least - (high - low)) / 2
    axes[1].set_ylim(low - grow, high + grow)
    axes[1].set_xlabel("time in s")
    return figure


def _main_axis(tracks: Sequence[Track]) -> int:
    reach = np.nanmax([np.ptp(_known(track), axis=0) for track in tracks], axis=0)
    return int(np.argmax(reach))


def _known(track: Track) -> Floats:
    known = track.position_m[np.isfinite(track.position_m).all(axis=1)]
    return known if len(known) else np.zeros((1, 2))


def _draw_truth(axis: Axes, t_s: Floats, at_mm: Floats, tracks: Sequence[Track], start_s: float) -> None:
    """The truth, where some method saw the object on the pad."""
    seen = np.zeros(len(t_s), dtype=np.bool_)
    for track in tracks:
        touching = np.interp(t_s, track.numbers["t_s"] - start_s, track.flags["contact"].astype(np.float64))
        seen |= touching > 0.5
    axis.plot(t_s, np.where(seen, at_mm, np.nan), color=INK, linewidth=1.0, label="truth", zorder=1)


def _draw_lines(
    axis: Axes, track: Track, component: int, start_s: float, strokes: Sequence[tuple[float, float]]
) -> None:
    style = look(track.method)
    for first, last in strokes:
        t_s, at_mm = track.t_s, 1e3 * track.position_m[:, component]
        used = np.isfinite(at_mm) & (t_s >= first) & (t_s <= last)
        if used.sum() < _FEWEST:
            continue
        slope, offset = np.polyfit(t_s[used] - start_s, at_mm[used], 1)
        ends = np.array([t_s[used][0], t_s[used][-1]]) - start_s
        axis.plot(ends, slope * ends + offset, color=style["color"], linewidth=1.2, linestyle=(0, (4, 2)))
        if len(strokes) > _MOST_NUMBERS:
            continue
        up = style["marker"] == "o"
        aside, above = _BESIDE.get(style["marker"], (16, -36))
        axis.annotate(
            f"{slope:+.1f} mm/s",
            (float(ends.mean()), float(slope * ends.mean() + offset)),
            xytext=(aside if (slope < 0) == up else -aside, above),
            textcoords="offset points",
            ha="center",
            va="center",
            color=style["color"],
            arrowprops={"arrowstyle": "-", "color": GREY, "linewidth": 0.6},
        )
