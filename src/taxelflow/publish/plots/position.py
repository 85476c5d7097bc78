"""Position with its standard deviation, load, contact and slip against time.

Regression lines stand where strokes are known: the paper's Fig. 9.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.rounding import LINE_POINTS
from taxelflow.numerics.spans import spans
from taxelflow.publish.plots.lanes import draw_lanes
from taxelflow.publish.plots.sizes import POSITION
from taxelflow.publish.plots.style import GREY, INK, SLIP, looks

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taxelflow.messages import Event, Floats
    from taxelflow.publish.results import Track

_MARKED = (("slip_start", "▶ its onset"), ("slip_suspected", "◆ suspected"))
"""Kinds of events whose marks are explained, and the words."""
_BESIDE = {"o": (34, 14), "^": (42, -14), "D": (58, -56), "v": (-44, 40), "P": (-38, 64), "X": (100, -34)}
"""Where a line's slope stands, in points from its middle, by the method's marker; no leader crosses another's."""


def position_figure(
    tracks: Sequence[Track],
    truth: tuple[Floats, Floats] | None = None,
    strokes: Sequence[tuple[float, float]] = (),
    events: Sequence[Sequence[Event]] = (),
    styles: Sequence[dict[str, Any]] = (),
) -> Figure:
    """Tracks of one pad by several methods: position along both axes, load, and a lane of contact and slip per method.

    truth: times (n,) and positions (n, 2), on the tracks' clock. strokes: (from, to) in s on the same clock; through
    each a regression line is drawn per method, along the axis of most motion, with its slope if they are few. events:
    those of the pad, by track. styles: of the tracks, where they are not all results that are drawn together.
    """
    import matplotlib.pyplot as plt

    styles = styles or looks([track.method for track in tracks])

    start_s = min(float(track.numbers["t_s"][0]) for track in tracks)
    lanes = 0.35 + 0.22 * len(tracks)
    heights = (2.6, 1.2, 0.9, lanes)
    figure, axes = plt.subplots(
        4, 1, sharex=True, figsize=(7.6, sum(heights) + 0.9), height_ratios=heights, layout="constrained"
    )
    main = _main_axis(tracks)
    for axis, component in zip(axes, (main, 1 - main), strict=False):
        if truth is not None:
            _draw_truth(axis, truth[0] - start_s, 1e3 * truth[1][:, component], tracks, start_s)
        for track, style in zip(tracks, styles, strict=True):
            t_s, at_mm = track.t_s - start_s, 1e3 * track.position_m[:, component]
            size = 2.0 if np.isfinite(at_mm).sum() > POSITION.small_above else 4.0
            ok, doubted = track.flags["ok"], style | {"label": "_doubted"}
            for shown, alpha, look in ((~ok, POSITION.doubted, doubted), (ok, 0.85, style)):
                own_s, own_mm = t_s[shown], at_mm[shown]
                axis.plot(own_s, own_mm, linestyle="none", markersize=size, markeredgewidth=0, alpha=alpha, **look)
        axis.set_ylabel(f"{'xy'[component]} in mm")
    for track, style in zip(tracks, styles, strict=True):
        _draw_lines(axes[0], track, style, main, start_s, strokes)
    _shade_slips(axes[:3], tracks, start_s)
    axes[0].set_title(f"Object on {tracks[0].pad}")
    axes[0].legend(loc="upper center", bbox_to_anchor=(0.5, 1.0), ncols=4, columnspacing=1.2, handlelength=1.4)
    low, high = axes[0].get_ylim()
    axes[0].set_ylim(low, high + 0.18 * (high - low))
    low, high = axes[1].get_ylim()
    least = 0.12 * np.ptp(axes[0].get_ylim())  # so that a small drift does not look like a large one
    grow = max(0.0, least - (high - low)) / 2
    axes[1].set_ylim(low - grow, high + grow)
    for axis, component in zip(axes, (main, 1 - main), strict=False):
        _draw_std(axis, tracks, styles, component, start_s)
    _draw_load(axes[2], tracks[0], start_s)
    marked = draw_lanes(axes[3], tracks, styles, events, start_s)
    seen = ["bands: ± 1 standard deviation", "shaded: slip", *(words for kind, words in _MARKED if kind in marked)]
    if any((np.isfinite(track.position_m[:, 0]) & ~track.flags["ok"]).any() for track in tracks):
        seen.append("faint: quality not ok")
    axes[0].set_title("; ".join(seen), loc="right", fontsize=7, fontweight="normal")
    figure.align_ylabels(axes[:3])
    axes[3].set_xlabel("time in s")
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


def _shade_slips(axes: Sequence[Axes], tracks: Sequence[Track], start_s: float) -> None:
    """Shade what any method reports as slip."""
    for track in tracks:
        t_s = track.numbers["t_s"] - start_s
        for first, stop in spans(track.flags["slipping"]):
            for axis in axes:
                axis.axvspan(t_s[max(first - 1, 0)], t_s[stop - 1], color=SLIP, linewidth=0, zorder=0)


def _draw_std(
    axis: Axes, tracks: Sequence[Track], styles: Sequence[dict[str, Any]], component: int, start_s: float
) -> None:
    """Bands of one standard deviation, which do not change the axis: where a direction is unknown they are wide."""
    limits = axis.get_ylim()
    for track, style in zip(tracks, styles, strict=True):
        if f"std_{'xy'[component]}_m" in track.numbers:
            at_mm, std_mm = (1e3 * track.numbers[name.format("xy"[component])] for name in ("{}_m", "std_{}_m"))
            axis.fill_between(
                track.t_s - start_s,
                at_mm - std_mm,
                at_mm + std_mm,
                color=style["color"],
                alpha=0.22,
                linewidth=0,
                zorder=1,
            )
    axis.set_ylim(limits)


def _draw_load(axis: Axes, track: Track, start_s: float) -> None:
    """The load that all methods of a recording see, as a share of its largest."""
    load = track.numbers.get("load_pa", np.full(len(track.numbers["t_s"]), np.nan))
    most = float(np.nanmax(load, initial=0.0))
    axis.plot(track.numbers["t_s"] - start_s, 100.0 * load / (most or 1.0), color=INK, linewidth=0.8)
    axis.set_ylabel("load in %\nof largest")
    axis.set_ylim(-4.0, 108.0)


def _draw_lines(
    axis: Axes,
    track: Track,
    style: dict[str, Any],
    component: int,
    start_s: float,
    strokes: Sequence[tuple[float, float]],
) -> None:
    for first, last in strokes:
        t_s, at_mm = track.t_s, 1e3 * track.position_m[:, component]
        used = np.isfinite(at_mm) & (t_s >= first) & (t_s <= last)
        if used.sum() < LINE_POINTS:
            continue
        slope, offset = np.polyfit(t_s[used] - start_s, at_mm[used], 1)
        ends = np.array([t_s[used][0], t_s[used][-1]]) - start_s
        axis.plot(ends, slope * ends + offset, color=style["color"], linewidth=1.2, linestyle=(0, (4, 2)))
        if len(strokes) > POSITION.slopes:
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
