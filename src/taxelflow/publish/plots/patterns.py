"""Learned patterns of all contacts of a result, on one scale of length."""

from __future__ import annotations

import heapq
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.publish.plots.sizes import PATTERN
from taxelflow.publish.plots.style import INK, UNSEEN, caption, pressure_unit, three_digits

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

    from taxelflow.messages import Floats, LearnedPattern


def patterns_figure(
    patterns: Sequence[LearnedPattern], unit: str, start_s: float, most: int = 64, across: int = 8
) -> Figure:
    """A panel per pattern in the order of time, each in the object's frame and in its own scale of pressure.

    start_s: time of the recording that is shown as 0. With more patterns than `most`, those from most scans. across:
    panels in a row.
    """
    import matplotlib.pyplot as plt

    chosen = heapq.nlargest(most, patterns, key=lambda one: one.scans)
    chosen.sort(key=lambda one: one.t_first_s)
    half = max(float(np.ptp(ends)) for one in chosen for ends in _bounds_mm(one)) / 2 * 1.06
    cols = min(across, len(chosen))
    rows = -(-len(chosen) // cols)
    size = min(10.5 / cols, 2.6)
    figure, axes = plt.subplots(
        rows, cols, squeeze=False, figsize=(cols * size, rows * (size + 0.38) + 0.5), layout="constrained"
    )
    for axis in axes.flat:
        axis.set_xticks([])
        axis.set_yticks([])
        axis.spines[:].set_visible(False)
        axis.grid(visible=False)
    for axis, one in zip(axes.flat, chosen, strict=False):
        (left, right), (low, high) = _bounds_mm(one)
        top = float(np.nanmax(one.pressure))
        level = np.ma.masked_invalid(np.clip(one.pressure, 0.0, None))
        axis.set_facecolor(UNSEEN)
        axis.pcolormesh(
            1e3 * one.x_m, 1e3 * one.y_m, level, cmap="inferno", vmin=0.0, vmax=top, shading="nearest", rasterized=True
        )
        axis.set_xlim((left + right) / 2 - half, (left + right) / 2 + half)
        axis.set_ylim((low + high) / 2 - half, (low + high) / 2 + half)
        axis.set_aspect("equal")
        scale, shown = pressure_unit(unit, top)
        axis.set_title(
            f"{one.pad}\n{one.t_first_s - start_s:.1f} s, {one.scans} scans\npeak {three_digits(top / scale)} {shown}",
            fontsize=6.5, fontweight="normal", color=INK, pad=2,
        )  # fmt: skip
    count = f"{len(chosen)} of {len(patterns)}" if len(chosen) < len(patterns) else f"All {len(chosen)}"
    text = f"{count} learned patterns, with start time of the contact, each from 0 (black) to its peak"
    caption(figure, f"{text}; panels are {2 * half:.0f} mm wide. Grey: not observed.")
    return figure


def _bounds_mm(pattern: LearnedPattern) -> Floats:
    """(2, 2), from and to along x and along y where the pattern has pressure."""
    there = np.nan_to_num(pattern.pressure) > PATTERN.shown * np.nanmax(pattern.pressure)
    x, y = 1e3 * pattern.x_m[there.any(axis=0)], 1e3 * pattern.y_m[there.any(axis=1)]
    return np.array([[x[0], x[-1]], [y[0], y[-1]]])
