"""A learned pattern: one scan as the taxels give it, the pattern beneath it, the object's way and its turn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.numerics.geometry import transform
from taxelflow.publish.plots.marks import draw_scale, draw_taxels, show_box
from taxelflow.publish.plots.outlines import extent_mm, outlines
from taxelflow.publish.plots.path import draw_pad
from taxelflow.publish.plots.sizes import PATTERN
from taxelflow.publish.plots.style import GREY, INK, MAGENTA, UNSEEN, VERMILION, caption, pressure_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taxelflow.messages import Bools, Floats, LearnedPattern
    from taxelflow.publish.plots.marks import Box
    from taxelflow.sensors.layout import Layout

_COLOURS = "inferno"
_WAY = "viridis"
_DARK, _EDGE = "#000004", "#4a4a55"
"""The colour map's own black, and outlines of taxels on it."""


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """A contact of which a pattern was learned, scan by scan, in the pad's frame.

    t_s: (n,). pose, std: (n, 3) in m and rad, NaN where unknown. ok: (n,). shown: number of the scan that is drawn;
    scan: (rows, cols) of its pressure, row 0 on top, NaN where no taxel is, or None. axis_rad: (n,) turn of the
    contact's principal axis, or None. true: (n, 3), or None.
    """

    pattern: LearnedPattern
    unit: str
    t_s: Floats
    pose: Floats
    std: Floats
    ok: Bools
    shown: int
    scan: Floats | None = None
    axis_rad: Floats | None = None
    true: Floats | None = None


def pattern_figure(layout: Layout, contact: Contact, start_s: float) -> Figure:
    """One scan (if the recording is at hand), the pattern at its pose on the same scale, the path on the pad; below,
    the turn against time. start_s: time of the recording that the title counts from.
    """
    import matplotlib.pyplot as plt

    pad = layout.pads.index(contact.pattern.pad)
    box = _box_mm(layout, pad, contact)
    ratio = (box[1] - box[0]) / (box[3] - box[2])
    width = float(np.clip(PATTERN.height_in * ratio, 2.2, 3.4))
    height = width / ratio
    turned = bool(np.isfinite(contact.pose[:, 2]).any())
    below = 2.1 if turned else 0.0
    panels = 3 if contact.scan is not None else 2
    figure = plt.figure(figsize=(panels * width + 1.9, height + 1.1 + below), layout="constrained")
    parts: Any = figure.subfigures(
        2 if turned else 1, 1, height_ratios=(height + 0.9, below)[: 1 + turned], squeeze=False
    )
    upper = parts[0, 0]
    axes = upper.subplots(1, panels)
    scale, unit = pressure_unit(contact.unit, float(np.nanmax(contact.pattern.pressure)))
    top = float(np.nanmax(contact.pattern.pressure)) / scale
    if contact.scan is not None:
        top = max(top, float(np.nanmax(contact.scan)) / scale)
        axes[0].set_facecolor(_DARK)
        axes[0].set_title("one scan")
        _draw_taxels(axes[0], layout, pad, contact.scan / scale, top)
    shades = _draw_pattern(axes[-2], layout, pad, contact, scale, top)
    dots = _draw_way(axes[-1], layout, pad, contact)
    for axis in axes:
        show_box(axis, box)
        axis.set_xticks([])
        axis.set_yticks([])
        axis.spines[:].set_visible(False)
    for axis, colour in ((axes[0], "white"), (axes[-1], INK)):
        draw_scale(axis, box, colour)
    upper.colorbar(shades, ax=axes[-2], label=f"pressure in {unit}", shrink=0.8, pad=0.03).outline.set_visible(False)
    upper.colorbar(dots, ax=axes[-1], label="time of contact in s", shrink=0.8, pad=0.03).outline.set_visible(False)
    figure.suptitle(_title(contact, start_s), x=0.01, ha="left", fontweight="bold", fontsize=11)
    marks = "; marks: direction of the pattern's long axis" if turned else ""
    true = "; black line: true path" if contact.true is not None else ""
    caption(figure, f"Grey: not observed{marks}{true}.")
    if turned:
        _draw_turn(parts[1, 0].subplots(), contact)
    return figure


def _title(contact: Contact, start_s: float) -> str:
    begin, end = max(contact.t_s[0] - start_s, 0.0), contact.t_s[-1] - start_s  # never -0.0
    return f"Pattern of the object on {contact.pattern.pad}, contact of {end - begin:.1f} s from {begin:.1f} s on"


def _box_mm(layout: Layout, pad: int, contact: Contact) -> Box:
    """The pad, the pattern at the pose shown and the way, with a margin, and room for the bar below."""
    left, right, low, high = extent_mm(layout, pad)
    places = _on_pad_mm(contact)
    there = np.nan_to_num(contact.pattern.pressure) > PATTERN.shown * np.nanmax(contact.pattern.pressure)
    way = 1e3 * contact.pose[np.isfinite(contact.pose[:, 0]), :2]
    at = np.concatenate([places[there], way, [[left, low], [right, high]]])
    (left, low), (right, high) = at.min(axis=0), at.max(axis=0)
    margin = 0.06 * max(right - left, high - low)
    return float(left - margin), float(right + margin), float(low - 2 * margin), float(high + margin)


def _on_pad_mm(contact: Contact) -> Floats:
    """Places (ny, nx, 2) of the pattern on the pad, in the scan that is drawn."""
    places = np.stack(np.meshgrid(contact.pattern.x_m, contact.pattern.y_m), axis=-1)
    return 1e3 * transform(np.nan_to_num(contact.pose[contact.shown]), places)


def _draw_taxels(axis: Axes, layout: Layout, pad: int, image: Floats | None, top: float) -> None:
    own = layout.of_pad(pad)
    taxels = draw_taxels(axis, 1e3 * outlines(layout, pad), edgecolor=_EDGE)
    if image is None:
        taxels.set_facecolor("none")
        taxels.set_alpha(0.6)
    else:
        taxels.set_array(np.clip(image[layout.row[own], layout.col[own]], 0.0, None))
        taxels.set_cmap(_COLOURS)
        taxels.set_clim(0.0, top)


def _draw_pattern(axis: Axes, layout: Layout, pad: int, contact: Contact, scale: float, top: float) -> Any:
    axis.set_facecolor(UNSEEN)
    x, y = np.moveaxis(_on_pad_mm(contact), -1, 0)
    level = np.ma.masked_invalid(np.clip(contact.pattern.pressure / scale, 0.0, None))
    shades = axis.pcolormesh(
        x, y, level, cmap=_COLOURS, vmin=0.0, vmax=top, shading="nearest", rasterized=True, antialiased=False
    )
    axis.contour(x, y, level, levels=top * np.array([0.2, 0.4, 0.6, 0.8]), colors="white", linewidths=0.4, alpha=0.7)
    _draw_taxels(axis, layout, pad, None, top)
    axis.set_title(f"pattern from {contact.pattern.scans} scans")
    return shades


def _draw_way(axis: Axes, layout: Layout, pad: int, contact: Contact) -> Any:
    """Positions coloured by time, with marks along the object's long axis where its turn is known."""
    from matplotlib.collections import LineCollection

    axis.set_title("path on the pad")
    draw_pad(axis, layout, pad)
    t_s, at = contact.t_s - contact.t_s[0], 1e3 * contact.pose[:, :2]
    if contact.true is not None:
        axis.plot(*(1e3 * contact.true[:, :2].T), color=INK, linewidth=0.8, zorder=2)
    axis.plot(at[:, 0], at[:, 1], color=GREY, linewidth=0.6, zorder=2)
    dots = axis.scatter(at[:, 0], at[:, 1], c=t_s, s=9.0, cmap=_WAY, linewidths=0, zorder=4)
    theta = contact.pose[:, 2] + _long_axis(contact.pattern)
    known = np.flatnonzero(np.isfinite(theta))
    if len(known):
        marked = known[np.unique(np.linspace(0, len(known) - 1, PATTERN.marks).astype(int))]
        rows, cols = layout.shapes[pad]
        reach = PATTERN.mark_half * 1e3 * float(np.max(layout.pitch_m[pad] * [cols, rows]))
        arm = reach * np.stack([np.cos(theta[marked]), np.sin(theta[marked])], axis=1)
        lines = LineCollection(
            list(np.stack([at[marked] - arm, at[marked] + arm], axis=1)), cmap=_WAY, linewidths=1.6, zorder=3
        )
        lines.set_array(t_s[marked])
        lines.set_clim(float(t_s[0]), float(t_s[-1]))
        lines.set_capstyle("round")
        axis.add_collection(lines)
    return dots


def _long_axis(pattern: LearnedPattern) -> float:
    """Direction of the pattern's long axis in the object's frame."""
    p = np.nan_to_num(np.maximum(pattern.pressure, 0.0))
    x, y = np.meshgrid(pattern.x_m, pattern.y_m)
    total = p.sum() or 1.0
    dx, dy = x - (p * x).sum() / total, y - (p * y).sum() / total
    return 0.5 * float(np.arctan2((2.0 * p * dx * dy).sum(), (p * (dx**2 - dy**2)).sum()))


def _draw_turn(axis: Axes, contact: Contact) -> None:
    """The turn since the first scan in which it is known: the zero of a stream's angles is arbitrary."""
    t_s, zero = contact.t_s - contact.t_s[0], contact.pose[np.isfinite(contact.pose[:, 2]), 2][0]
    theta, std = np.degrees(contact.pose[:, 2] - zero), np.degrees(contact.std[:, 2])
    if contact.true is not None:
        axis.plot(t_s, np.degrees(contact.true[:, 2] - zero), color=INK, linewidth=1.0, label="truth", zorder=2)
    axis_known = contact.axis_rad is not None and np.isfinite(contact.axis_rad).any()
    if contact.axis_rad is not None and axis_known:
        turn = np.degrees(contact.axis_rad - zero)
        axis.plot(t_s, turn, linestyle="none", marker="D", markersize=2.6, color=GREY, label="principal axis", zorder=1)
    axis.fill_between(t_s, theta - std, theta + std, color=VERMILION, alpha=0.25, linewidth=0, label="± 1 sigma")
    axis.plot(t_s, theta, color=VERMILION, linewidth=1.2, label="template", zorder=3)
    poor = ~contact.ok & np.isfinite(theta)
    if poor.any():
        axis.plot(
            t_s[poor],
            theta[poor],
            linestyle="none",
            marker="o",
            markersize=2.6,
            markerfacecolor="white",
            markeredgecolor=MAGENTA,
            markeredgewidth=0.7,
            label="quality not ok",
            zorder=4,
        )
    axis.set_ylabel("turn in deg")
    axis.set_xlabel("time of contact in s")
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=5, fontsize=8, borderaxespad=0.1)
    axis.set_xlim(float(t_s[0]), float(t_s[-1]))
    ends = np.concatenate([theta[np.isfinite(theta)], [0.0]])
    if contact.axis_rad is not None and axis_known:
        ends = np.append(ends, np.degrees(np.nanquantile(contact.axis_rad - zero, [0.02, 0.98])))
    span = float(np.ptp(ends))
    axis.set_ylim(float(ends.min()) - 0.1 * span - 1.0, float(ends.max()) + 0.1 * span + 1.0)
