"""The object's way over each pad, drawn on the pad's taxels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.publish.plots.outlines import extent_mm, outlines
from taxelflow.publish.plots.style import GREY, INK, plain

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taxelflow.publish.results import Track
    from taxelflow.sensors.layout import Layout


def path_figure(tracks: Sequence[Track], layout: Layout) -> Figure:
    """Tracks of one method, each on its own pad; colour is time, larger dots are slip."""
    import matplotlib.pyplot as plt

    boxes = [_box_mm(layout, track) for track in tracks]
    ratios = [(right - left) / (high - low) for left, right, low, high in boxes]
    height = min(4.4, 8.0 / sum(ratios))
    figure, axes = plt.subplots(
        1,
        len(tracks),
        squeeze=False,
        figsize=(1.9 + height * sum(ratios) + 0.5 * len(tracks), height + 0.9),
        width_ratios=ratios,
        layout="constrained",
    )
    start_s = min(float(track.numbers["t_s"][0]) for track in tracks)
    end_s = max(float(track.numbers["t_s"][-1]) for track in tracks) - start_s
    dots = None
    for axis, track, (left, right, low, high) in zip(axes[0], tracks, boxes, strict=True):
        draw_pad(axis, layout, layout.pads.index(track.pad))
        axis.set_xlim(left, right)
        axis.set_ylim(low, high)
        at_mm, slipping = 1e3 * track.position_m, track.flags["slipping"]
        axis.plot(at_mm[:, 0], at_mm[:, 1], color=GREY, linewidth=0.5, zorder=2)
        dots = axis.scatter(
            at_mm[:, 0],
            at_mm[:, 1],
            c=track.t_s - start_s,
            s=np.where(slipping, 16.0, 4.0),
            cmap="viridis",
            vmin=0.0,
            vmax=end_s,
            linewidths=0,
            zorder=3,
        )
        axis.set_title(plain(track.pad))
        axis.set_xlabel("x in mm")
    axes[0, 0].set_ylabel("y in mm")
    if dots is not None:
        figure.colorbar(dots, ax=axes[0, -1], label="time in s", shrink=0.8)
    return figure


def _box_mm(layout: Layout, track: Track) -> tuple[float, float, float, float]:
    """left, right, low, high of the pad and the way, which may lead half a pad beyond it and is cut there."""
    left, right, low, high = extent_mm(layout, layout.pads.index(track.pad))
    wide, tall = (right - left) / 2, (high - low) / 2
    at_mm = 1e3 * track.position_m[np.isfinite(track.position_m).all(axis=1)]
    if not len(at_mm):
        return left, right, low, high
    margin = 0.02 * max(wide, tall)
    x = np.clip([at_mm[:, 0].min() - margin, at_mm[:, 0].max() + margin], left - wide, right + wide)
    y = np.clip([at_mm[:, 1].min() - margin, at_mm[:, 1].max() + margin], low - tall, high + tall)
    return min(left, float(x[0])), max(right, float(x[1])), min(low, float(y[0])), max(high, float(y[1]))


def draw_pad(axis: Axes, layout: Layout, pad: int) -> None:
    """Taxels of a pad, faint, in mm, row 0 on top."""
    from matplotlib.collections import PolyCollection

    shapes = list(1e3 * outlines(layout, pad))
    axis.add_collection(PolyCollection(shapes, facecolor="#f1f3f4", edgecolor="#dadce0", linewidth=0.6, zorder=1))
    left, right, low, high = extent_mm(layout, pad)
    axis.set_xlim(left, right)
    axis.set_ylim(low, high)
    axis.set_aspect("equal")
    axis.grid(visible=False)
    axis.tick_params(colors=INK)
