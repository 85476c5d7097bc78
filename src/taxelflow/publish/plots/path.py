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

    from taxelflow.layout import Layout
    from taxelflow.publish.results import Track


def path_figure(tracks: Sequence[Track], layout: Layout) -> Figure:
    """Tracks of one method, each on its own pad; colour is time, larger dots are slip."""
    import matplotlib.pyplot as plt

    spans = [_span_mm(layout, track) for track in tracks]
    ratios = [width / height for width, height in spans]
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
    for axis, track in zip(axes[0], tracks, strict=True):
        draw_pad(axis, layout, layout.pads.index(track.pad))
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


def _span_mm(layout: Layout, track: Track) -> tuple[float, float]:
    left, right, low, high = extent_mm(layout, layout.pads.index(track.pad))
    return right - left, high - low


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
