"""A sensor as its user knows it: every pad with its taxels' numbers, the hand laid flat, curved skin in space."""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.numerics.geometry import transform
from taxelflow.publish.plots.outlines import extent_mm, outlines
from taxelflow.publish.plots.style import BLUE, GREY, INK, MAGENTA, VERMILION, caption, plain
from taxelflow.sensors.triangulation import nearest_m

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taxelflow.messages import Floats
    from taxelflow.sensors.layout import Layout
    from taxelflow.sensors.sensor import Sensor

_SIZE = 7.0
_COLS = 5
_CROWDED = 10
_NUMBERED = 1100


def sensor_figure(sensor: Sensor) -> Figure:
    """The flattened hand if all pads have their place on it, else pad beside pad; and in space where it is curved."""
    layout = sensor.layout
    together = bool(np.isfinite(layout.T_hand[: layout.pad_count, 0]).all())
    if together:
        figure, flat = _hand(layout)
        homes = [(flat, layout.T_hand[pad]) for pad in range(layout.pad_count)]
    else:
        figure, axes = _side_by_side(layout)
        homes = [(axis, np.zeros(3)) for axis in axes]
    for pad, (axis, pose) in enumerate(homes):
        _draw(axis, layout, pad, pose)
    title = f"{sensor.name}: {layout.taxels} taxels in {layout.pad_count} pad{'s' if layout.pad_count > 1 else ''}"
    figure.suptitle(plain(title), x=0.01, ha="left", fontweight="bold")
    caption(figure, plain(sensor.note), int(14.5 * figure.get_size_inches()[0]))
    if layout.taxels <= _NUMBERED:
        figure.draw_without_rendering()  # lays it out: now a mm has a length on paper
        for pad, (axis, pose) in enumerate(homes):
            _number(axis, layout, pad, pose)
    return figure


def _hand(layout: Layout) -> tuple[Figure, Axes]:
    figure, flat = _one(layout, _is_curved(layout))
    _frame(flat, *_bounds(layout))
    _names(flat, layout)
    if _is_curved(layout):
        _draw_space(figure.add_subplot(1, 2, 2, projection="3d"), layout)
    return figure, flat


def _side_by_side(layout: Layout) -> tuple[Figure, list[Axes]]:
    import matplotlib.pyplot as plt

    rows = ceil(layout.pad_count / _COLS)
    figure, axes = plt.subplots(
        rows, min(_COLS, layout.pad_count), figsize=(11.0, 2.5 * rows + 0.6), layout="constrained", squeeze=False
    )
    for axis in axes.flat[layout.pad_count :]:
        axis.axis("off")
    used = list(axes.flat[: layout.pad_count])
    for pad, axis in enumerate(used):
        _frame(axis, *extent_mm(layout, pad))
        axis.set_title(plain(layout.pads[pad]))
    return figure, used


def _is_curved(layout: Layout) -> bool:
    normal = layout.normal[: layout.taxels]
    return bool(np.isfinite(normal).all() and np.abs(normal - normal[:1]).max() > 1e-3)


def _one(layout: Layout, space: bool) -> tuple[Figure, Axes]:
    """A figure with room for the flat hand, left of a view in space if there is one."""
    import matplotlib.pyplot as plt

    left, right, low, high = _bounds(layout)
    ratio = (high - low) / (right - left)
    wide, tall = (_SIZE, _SIZE * ratio) if ratio < 1.0 else (_SIZE / ratio, _SIZE)
    wide, tall = max(wide, 5.0), max(tall, 3.0)
    figure = plt.figure(figsize=(wide + (tall if space else 0.0) + 0.8, tall + 1.2), layout="constrained")
    return figure, figure.add_subplot(1, 2 if space else 1, 1)


def _bounds(layout: Layout) -> tuple[float, float, float, float]:
    corners = np.concatenate([_on_hand(layout, pad).reshape(-1, 2) for pad in range(layout.pad_count)])
    margin = 0.08 * float(np.ptp(corners, axis=0).max())
    (left, low), (right, high) = corners.min(axis=0) - margin, corners.max(axis=0) + margin
    return float(left), float(right), float(low), float(high)


def _on_hand(layout: Layout, pad: int) -> Floats:
    return 1e3 * transform(layout.T_hand[pad], outlines(layout, pad))


def _draw(axis: Axes, layout: Layout, pad: int, pose: Floats) -> None:
    """Outlines of a pad's taxels, those at a border darker."""
    from matplotlib.collections import PolyCollection

    shapes = 1e3 * transform(pose, outlines(layout, pad))
    faces = np.where(layout.border[layout.of_pad(pad)].any(axis=1), "#dfe8f3", "#f4f6f8")
    axis.add_collection(PolyCollection(list(shapes), facecolor=faces.tolist(), edgecolor=GREY, linewidth=0.5))


def _number(axis: Axes, layout: Layout, pad: int, pose: Floats) -> None:
    """Numbers of a pad's taxels, as large as the closest leave room for, at most 9 points; too small to read, none."""
    own = layout.of_pad(pad)
    at = 1e3 * transform(pose, np.stack([layout.x_m[own], layout.y_m[own]], axis=1))
    left, right = axis.get_xlim()
    points_per_mm = 72.0 / axis.figure.dpi * axis.get_window_extent().width / (right - left)
    room = float(np.quantile(nearest_m(at), 0.05))
    size = min(9.0, 1.2 * room * points_per_mm / len(str(layout.taxels - 1)))
    if size > 1.5:
        for number, (x, y) in enumerate(at, own.start):
            axis.text(x, y, str(number), ha="center", va="center", color=INK, fontsize=size)


def _frame(axis: Axes, left: float, right: float, low: float, high: float) -> None:
    axis.set_xlim(left, right)
    axis.set_ylim(low, high)
    axis.set_aspect("equal")
    axis.grid(visible=False)
    axis.set_xlabel("x in mm")
    axis.set_ylabel("y in mm")


def _names(axis: Axes, layout: Layout) -> None:
    """Each pad's name, and its frame: x in red, y in blue."""
    for pad in range(layout.pad_count):
        x, y, turn = layout.T_hand[pad]
        length = 0.9 * 1e3 * layout.pitch_m[pad].max()
        for angle, colour in ((turn, VERMILION), (turn + np.pi / 2, BLUE)):
            tip = (1e3 * x + length * np.cos(angle), 1e3 * y + length * np.sin(angle))
            arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0, "alpha": 0.7}
            axis.annotate("", xy=tip, xytext=(1e3 * x, 1e3 * y), arrowprops=arrow, zorder=1.5)
        if layout.pad_count > 1:
            shape = _on_hand(layout, pad).reshape(-1, 2)
            at = ((shape[:, 0].min() + shape[:, 0].max()) / 2, shape[:, 1].max())
            crowded = layout.pad_count > _CROWDED
            look: dict[str, Any] = {"fontsize": 4.5 if crowded else 7, "color": MAGENTA if crowded else INK}
            name = plain(layout.pads[pad])
            axis.annotate(name, at, (0, 1), textcoords="offset points", ha="center", va="bottom", zorder=5, **look)


def _draw_space(axis: Axes, layout: Layout) -> None:
    """Taxels and their normals in the hand's 3-D frame."""
    at, normal = 1e3 * layout.place_m[: layout.taxels], layout.normal[: layout.taxels]
    length = 0.7 * 1e3 * float(layout.pitch_m.min())
    axis.scatter(at[:, 0], at[:, 1], at[:, 2], s=10, color=BLUE, depthshade=False)  # type: ignore[misc]
    axis.quiver(*at.T, *(length * normal.T), color=VERMILION, linewidth=0.7, arrow_length_ratio=0.3)
    for set_label, name in zip((axis.set_xlabel, axis.set_ylabel, axis.set_zlabel), "xyz", strict=True):  # type: ignore[attr-defined]
        set_label(f"{name} in mm")
    axis.set_aspect("equal")
    outwards = normal.mean(axis=0)
    axis.view_init(elev=25, azim=float(np.degrees(np.arctan2(outwards[1], outwards[0]))) + 30)  # type: ignore[attr-defined]
    axis.set_title("in space, with normals")
