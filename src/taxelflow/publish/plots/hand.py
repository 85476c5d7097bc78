"""The hand laid flat, and the field of slip vectors on it: the paper's Figs. 2, 4, 6 and 7."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.geometry import transform
from taxelflow.publish.plots.marks import draw_arrow, draw_taxels, show_box
from taxelflow.publish.plots.outlines import box_mm, on_hand_mm
from taxelflow.publish.plots.sizes import ARROWS
from taxelflow.publish.plots.style import BLUE, FAINT, GREY, INK, MAGENTA, VERMILION, caption

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taxelflow.messages import Bools, Floats
    from taxelflow.sensors.layout import Layout


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """The field at one time, in the hand frame.

    places, vectors: (pads, 2) in m and m/s, NaN where there is no slip vector. twist: (3,), true: (3,) if known.
    centre: (2,), NaN where there is none. pressure: (entries,) or None, drawn as shade. faint: (pads,), vectors drawn
    in grey: those of pads that do not slip. whole: (pads,), vectors drawn in blue: those that groups stand in for.
    """

    title: str
    places: Floats
    vectors: Floats
    twist: Floats
    centre: Floats
    pressure: Floats | None = None
    true: Floats | None = None
    faint: Bools | None = None
    whole: Bools | None = None


def field_figure(layout: Layout, methods: Mapping[str, Sequence[Moment]], seen: str) -> Figure:
    """A row per method, a panel per moment: taxels, pressure, slip vectors, and the twist that they amount to.

    All methods have the same number of moments; arrows have one scale.
    """
    import matplotlib.pyplot as plt
    from matplotlib.ticker import MaxNLocator

    moments = [moment for row in methods.values() for moment in row]
    across = len(moments) // len(methods)
    box = box_mm(layout)
    fastest = max(float(np.nanmax(np.hypot(*moment.vectors.T), initial=1e-9)) for moment in moments)
    scale = ARROWS.flat * (box[1] - box[0]) / fastest
    tips = np.concatenate([1e3 * moment.places + scale * moment.vectors for moment in moments])
    tips = tips[np.isfinite(tips).all(axis=1)]
    (left, low), (right, high) = np.min(tips, axis=0, initial=np.inf) - 6, np.max(tips, axis=0, initial=-np.inf) + 6
    box = (min(box[0], left), max(box[1], right), min(box[2], low), max(box[3], high))
    ratio = (box[3] - box[2]) / (box[1] - box[0])
    wide = min(10.5 / across, 5.0)
    figure, axes = plt.subplots(
        len(methods),
        across,
        squeeze=False,
        figsize=(across * wide, len(methods) * (wide * ratio + 0.9) + 0.6),
        layout="constrained",
        sharey=True,
    )
    for axis, moment in zip(axes.flat, moments, strict=True):
        draw_hand(axis, layout, moment.pressure)
        _draw_vectors(axis, moment, scale)
        show_box(axis, box)
        axis.set_title(moment.title)
        axis.set_xlabel("x in mm\n" + _numbers(moment))
        axis.xaxis.set_major_locator(MaxNLocator(5, prune="both"))
    for axis, method in zip(axes[:, 0], methods, strict=True):
        axis.set_ylabel(f"{method}\ny in mm" if len(methods) > 1 else "y in mm")
    caption(figure, f"{seen} The longest vector is {1e3 * fastest:.3g} mm/s.")
    return figure


def at_contacts(layout: Layout, pose: Floats, velocity: Floats, pressure: Floats | None) -> tuple[Floats, Floats]:
    """Places and velocities (pads, 2) in the hand frame, of the object's points under the centres of pressure.

    pose, velocity: (pads, 2 or 3) in the pads' frames: a pose's origin may lie far from what the pad touches. Without
    pressure (entries,), those of the poses' own origins.
    """
    place, vector = pose[:, :2].copy(), velocity[:, :2].copy()
    if pressure is not None:
        weight = np.maximum(pressure, 0.0)
        total = np.add.reduceat(weight, layout.starts[:-1])
        sums = np.stack([np.add.reduceat(weight * at, layout.starts[:-1]) for at in (layout.x_m, layout.y_m)], axis=1)
        touched = total > 0
        centre = sums[touched] / total[touched, np.newaxis]
        turn = np.nan_to_num(velocity[touched, 2]) if velocity.shape[1] > 2 else np.zeros(len(centre))
        arm = centre - place[touched]
        vector[touched] += turn[:, np.newaxis] * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
        place[touched] = np.where(np.isfinite(place[touched]), centre, np.nan)
    turned = layout.T_hand.copy()
    turned[:, :2] = 0.0
    return transform(layout.T_hand, place), transform(turned, vector)


def layout_figure(layout: Layout, seen: str, *, numbers: bool) -> Figure:
    """The flattened hand: taxels with their numbers, or pads and groups with their names and frames."""
    import matplotlib.pyplot as plt

    box = box_mm(layout)
    ratio = (box[3] - box[2]) / (box[1] - box[0])
    figure, axis = plt.subplots(figsize=(9.0, 9.0 * ratio + 0.9), layout="constrained")
    draw_hand(axis, layout, None)
    show_box(axis, box)
    if numbers:
        for entry, (x, y) in enumerate(hand_places(layout)[: layout.taxels]):
            axis.annotate(str(entry), (1e3 * x, 1e3 * y), ha="center", va="center", fontsize=4.5, color=INK)
    else:
        _draw_frames(axis, layout)
    axis.set_xlabel("x in mm")
    axis.set_ylabel("y in mm")
    caption(figure, seen)
    return figure


def hand_places(layout: Layout) -> Floats:
    """(entries, 2) places of all taxels in the hand frame, NaN where the pad has none."""
    counts = np.diff(layout.starts)
    return transform(np.repeat(layout.T_hand, counts, axis=0), np.stack([layout.x_m, layout.y_m], axis=1))


def draw_hand(axis: Axes, layout: Layout, pressure: Floats | None) -> None:
    """Taxels, shaded by pressure (entries,) if given."""
    placed = [pad for pad in range(layout.pad_count) if np.isfinite(layout.T_hand[pad]).all()]
    shapes = [shape for pad in placed for shape in on_hand_mm(layout, pad)]
    shown = np.repeat(np.isfinite(layout.T_hand[: layout.pad_count, 0]), np.diff(layout.starts)[: layout.pad_count])
    shades = draw_taxels(axis, shapes)
    if pressure is None:
        shades.set_facecolor(FAINT)
    else:
        level = np.clip(pressure[: layout.taxels][shown] / max(float(pressure.max()), 1e-9), 0.0, 1.0)
        shades.set_array(level)
        shades.set_cmap("Blues")
        shades.set_clim(-0.08, 1.3)


def _draw_vectors(axis: Axes, moment: Moment, scale: float) -> None:
    for pad, ((x, y), (vx, vy)) in enumerate(zip(1e3 * moment.places, moment.vectors, strict=True)):
        if not (np.isfinite(vx) and np.isfinite(x)):
            continue
        colour = VERMILION
        if moment.whole is not None and moment.whole[pad]:
            colour = BLUE
        elif moment.faint is not None and moment.faint[pad]:
            colour = GREY
        draw_arrow(axis, (x, y), (x + scale * vx, y + scale * vy), colour)
        axis.plot([x], [y], marker="o", markersize=2.5, color=colour, zorder=4)  # stays when the arrow is short
    if np.isfinite(moment.centre).all():
        axis.plot(*(1e3 * moment.centre), marker="+", markersize=11, markeredgewidth=2, color=MAGENTA, zorder=5)


def _numbers(moment: Moment) -> str:
    lines = [_twist("estimated", moment.twist)]
    if moment.true is not None:
        lines.append(_twist("true", moment.true))
    return "\n".join(lines)


def _twist(name: str, twist: Floats) -> str:
    vx, vy = 1e3 * twist[:2]
    turn = f"{twist[2]:+z.2f} rad/s" if np.isfinite(twist[2]) else "turn unknown"
    return f"{name}: ({vx:+z.1f}, {vy:+z.1f}) mm/s, {turn}"


def _draw_frames(axis: Axes, layout: Layout) -> None:
    for pad, name in enumerate(layout.pads):
        x, y, theta = layout.T_hand[pad]
        if not np.isfinite(x):
            continue
        group = pad >= layout.pad_count
        own = 1e3 * hand_places(layout)[layout.of_pad(pad)]
        middle = own.mean(axis=0)
        if not group:
            for turn, colour in ((0.0, VERMILION), (np.pi / 2, BLUE)):
                tip = np.array([1e3 * x, 1e3 * y]) + 9 * np.array([np.cos(theta + turn), np.sin(theta + turn)])
                draw_arrow(axis, (1e3 * x, 1e3 * y), tip, colour, 1.2)
        if group:
            at, align = (middle[0], own[:, 1].max() + 8), "center"
        elif np.ptp(own[:, 1]) > np.ptp(own[:, 0]):
            at, align = (own[:, 0].max() + 6, middle[1]), "left"
        else:
            at, align = (middle[0], own[:, 1].min() - 7), "center"
        size, colour = (4.5, MAGENTA) if group else (6.5, INK)
        axis.annotate(name, at, ha=align, va="top", fontsize=size, color=colour)
