"""Picture of a sensor: every pad with its taxels' numbers, the hand laid flat, curved skin in space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.numerics.geometry import se3_of, transform
from taxelflow.publish.plots.marks import draw_arrow, draw_scale, draw_taxels, show_box
from taxelflow.publish.plots.names import free_places, write_names
from taxelflow.publish.plots.outlines import outlines
from taxelflow.publish.plots.packing import packed
from taxelflow.publish.plots.sizes import NAMES, PAPER, TAXELS
from taxelflow.publish.plots.solid import draw_faces, faces, frame
from taxelflow.publish.plots.style import BLUE, GREY, INK, TINTS, VERMILION, caption, caption_lines, pale, tick_step
from taxelflow.sensors.pad_geometry import geometry_of
from taxelflow.sensors.triangulation import nearest_m

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taxelflow.messages import Floats
    from taxelflow.publish.plots.marks import Box
    from taxelflow.sensors.layout import Layout
    from taxelflow.sensors.sensor import Sensor


@dataclass(frozen=True, slots=True, eq=False)
class _Flat:
    """What lies where on the flat hand. T: (pads, 3), shapes: outlines (taxels, corners, 2) of each pad, mm.

    placed: whether the hand's frame is known. bounds: left, right, low, high in mm. size: in inches.
    """

    sensor: Sensor
    T: Floats
    shapes: list[Floats]
    placed: bool
    curved: bool
    bounds: Box
    size: tuple[float, float]


def sensor_figure(sensor: Sensor) -> Figure:
    """The flattened hand if all pads have their place on it, else pads in rows; and in space where it is curved.

    Where names would cover taxels, they stand on a second drawing of the hand.
    """
    import matplotlib.pyplot as plt

    flat = _flat(sensor)
    tints = [""] * len(flat.shapes)
    figure, axis = _drawn(flat, tints)
    if len(flat.shapes) > 1:
        names = free_places(
            axis, [_points(shape) for shape in flat.shapes], sensor.layout.pads[: len(flat.shapes)], NAMES.points
        )
        if any(name.covers for name in names):
            plt.close(figure)
            tints = [TINTS[pad % len(TINTS)] for pad in range(len(tints))]
            figure, axis = _drawn(flat, tints)
        else:
            write_names(axis, names, NAMES.points)
    if sensor.layout.taxels <= TAXELS.numbered:
        for pad in range(len(flat.shapes)):
            _number(axis, flat, pad, _colours(flat, pad, tints[pad]))
    return figure


def _flat(sensor: Sensor) -> _Flat:
    layout = sensor.layout
    placed = bool(np.isfinite(layout.T_hand[: layout.pad_count]).all())
    T = layout.T_hand[: layout.pad_count] if placed else packed(layout)
    shapes = [1e3 * transform(T[pad], outlines(layout, pad)) for pad in range(layout.pad_count)]
    corners = np.concatenate([shape.reshape(-1, 2) for shape in shapes])
    extent = np.ptp(corners, axis=0)
    scale = min(
        PAPER.size_in[0] / extent[0], PAPER.size_in[1] / extent[1], PAPER.pitch_in / (1e3 * float(layout.pitch_m.max()))
    )
    margin = 0.15 / scale
    head = 0.2 / scale if layout.pad_count > 1 else 0.0
    (left, low), (right, high) = corners.min(axis=0) - margin, corners.max(axis=0) + margin
    below = 0.0 if placed else 0.1 / scale + 0.04 * (high + head - low)  # where the bar of length stands
    bounds = float(left), float(right), float(low - below), float(high + head)
    size = scale * (bounds[1] - bounds[0]), scale * (bounds[3] - bounds[2])
    return _Flat(sensor, T, shapes, placed, _is_curved(layout), bounds, size)


def _drawn(flat: _Flat, tints: list[str]) -> tuple[Figure, Axes]:
    """The figure, laid out, and the axis for the taxels' numbers. tints: of pads whose names get their own drawing."""
    import matplotlib.pyplot as plt

    layout, (wide, tall), crowded = flat.sensor.layout, flat.size, bool(tints[0])
    side = float(np.clip(tall, 4.0, 6.0))
    beside = flat.curved and not crowded
    width = max(wide + 0.8 + (side if beside else 0.0), 5.5)
    words = _words(flat, crowded)
    below = (side if flat.curved else 0.6 * tall) if crowded else 0.0
    height = max(tall, side if beside else 0.0) + below + 1.0 + 0.15 * len(caption_lines(words, width))
    figure = plt.figure(figsize=(width, height), layout="constrained")
    ratios: dict[str, Any] = {"height_ratios": [tall, below]} if crowded else {}
    if beside:
        ratios["width_ratios"] = [wide, side]
    grid = figure.add_gridspec(1 + crowded, 1 + flat.curved, **ratios)
    axis = figure.add_subplot(grid[0, :] if crowded else grid[0, 0])
    _frame(axis, flat)
    for pad in range(len(flat.shapes)):
        _draw(axis, flat, pad, tints[pad])
        _arrows(axis, flat, pad)
    if crowded:
        second = figure.add_subplot(grid[1, 0])
        _draw_names(second, flat, tints, 72.0 * 0.5 * width / (flat.bounds[1] - flat.bounds[0]))
    if flat.curved:
        _draw_space(figure.add_subplot(grid[-1, -1], projection="3d"), flat.sensor, tints)
    title = f"{flat.sensor.name}: {layout.taxels} taxels in {layout.pad_count} pad{'s' if layout.pad_count > 1 else ''}"
    figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
    caption(figure, words)
    figure.draw_without_rendering()  # lays it out: now a mm has a length on paper
    return figure, axis


def _words(flat: _Flat, crowded: bool) -> str:
    note = flat.sensor.note.rstrip(".")
    parts = [f"{note[:1] if note[1:2].isupper() else note[:1].upper()}{note[1:]}."] if note else []
    parts.append(f"Arrows: {'each' if len(flat.shapes) > 1 else 'the'} pad's frame, x orange, y blue.")
    if not crowded:
        parts.append("Blue taxels lie at a border.")
    elif common := _common(flat.sensor.layout.pads):
        parts.append(f"Names of pads begin with {common}.")
    if not flat.placed:
        parts.append("Pads stand in rows, at one scale.")
    if flat.curved:
        parts.append("In space, faces turned away are pale.")
    return " ".join(parts)


def _is_curved(layout: Layout) -> bool:
    normal = layout.normal[: layout.taxels]
    return bool(np.isfinite(normal).all() and np.abs(normal - normal[:1]).max() > 1e-3)


def _points(shape: Floats) -> Floats:
    """Corners, centres and places between them, (n, 2), of taxels: what a name must not cover."""
    middle = shape.mean(axis=1, keepdims=True)
    return np.concatenate([shape, middle, (shape + middle) / 2], axis=1).reshape(-1, 2)


def _frame(axis: Axes, flat: _Flat) -> None:
    from matplotlib.ticker import MultipleLocator

    left, right, low, high = flat.bounds
    show_box(axis, flat.bounds)
    if flat.placed:
        for one, name, extent in ((axis.xaxis, "x", right - left), (axis.yaxis, "y", high - low)):
            few = max(8 * extent / max(right - left, high - low), 3)
            one.set_major_locator(MultipleLocator(tick_step(extent, few)))
            one.set_label_text(f"{name} in mm")
        return
    axis.axis("off")
    draw_scale(axis, flat.bounds)


def _draw(axis: Axes, flat: _Flat, pad: int, tint: str) -> None:
    """Outlines of a pad's taxels."""
    draw_taxels(axis, flat.shapes[pad], facecolor=_colours(flat, pad, tint), edgecolor=GREY)


def _colours(flat: _Flat, pad: int, tint: str) -> list[Any]:
    """Of a pad's taxels: a pale tint of the pad; without one, those at a border are darker."""
    own = flat.sensor.layout.of_pad(pad)
    if tint:
        return [pale(tint)] * (own.stop - own.start)
    return list(np.where(flat.sensor.layout.border[own].any(axis=1), "#dfe8f3", "#f4f6f8"))


def _arrows(axis: Axes, flat: _Flat, pad: int) -> None:
    """The pad's frame: x in orange, y in blue, beneath the numbers, and as long as leaves both tips uncovered."""
    x, y, turn = flat.T[pad]
    origin, centres = 1e3 * np.array([x, y]), flat.shapes[pad].mean(axis=1)
    ways = np.array([[np.cos(angle), np.sin(angle)] for angle in (turn, turn + np.pi / 2)])
    lengths = 1e3 * flat.sensor.layout.pitch_m[pad].max() * np.array([0.9, 0.75, 1.05, 0.65])
    tips = origin + lengths[:, np.newaxis, np.newaxis] * ways
    clear = np.linalg.norm(tips[:, :, np.newaxis] - centres, axis=3).min(axis=(1, 2))
    for tip, colour in zip(tips[int(np.argmax(clear))], (VERMILION, BLUE), strict=True):
        draw_arrow(axis, origin, tip, colour, 1.0, zorder=1.5)


def _number(axis: Axes, flat: _Flat, pad: int, colours: list[Any]) -> None:
    """Numbers of a pad's taxels, as large as the closest leave room for, at most 9 points; too small to read, none.

    colours: of the taxels, behind the numbers that an arrow may cross.
    """
    layout = flat.sensor.layout
    own = layout.of_pad(pad)
    at = 1e3 * transform(flat.T[pad], np.stack([layout.x_m[own], layout.y_m[own]], axis=1))
    left, right = axis.get_xlim()
    points_per_mm = 72.0 / axis.figure.dpi * axis.get_window_extent().width / (right - left)
    apart = nearest_m(at) if len(at) > 1 else 1e3 * layout.pitch_m[pad]
    room = float(np.quantile(apart, 0.05))
    size = min(9.0, 1.05 * room * points_per_mm / len(str(layout.taxels - 1)))
    if size <= 1.5:
        return
    near = np.linalg.norm(at - 1e3 * flat.T[pad, :2], axis=1) < 1.5e3 * layout.pitch_m[pad].max()
    for number, (x, y), colour, crossed in zip(range(own.start, own.stop), at, colours, near, strict=True):
        behind = {"boxstyle": "square,pad=0.05", "facecolor": colour, "linewidth": 0} if crossed else None
        axis.text(x, y, str(number), ha="center", va="center", color=INK, fontsize=size, bbox=behind)


def _draw_names(axis: Axes, flat: _Flat, tints: list[str], points_per_mm: float) -> None:
    """The flat hand again, on each pad its name without what all begin with."""
    _frame(axis, flat)
    names = flat.sensor.layout.pads
    common = len(_common(names))
    for pad, shape in enumerate(flat.shapes):
        _draw(axis, flat, pad, tints[pad])
        name, wide = names[pad][common:], float(np.ptp(shape[..., 0]))
        size = min(9.0, 0.9 * wide * points_per_mm / (NAMES.wide * len(name)))
        look: dict[str, Any] = {"fontsize": size, "fontweight": "bold", "color": INK, "ha": "center", "va": "center"}
        axis.annotate(name, shape.mean(axis=(0, 1)).tolist(), **look)
    axis.set_title("pads")


def _common(names: tuple[str, ...]) -> str:
    """What all names begin with, and go on from with something."""
    first, last = min(names), max(names)  # what these two share, all share
    same = next((k for k, (one, other) in enumerate(zip(first, last, strict=False)) if one != other), len(first))
    common = first[:same].rstrip("0123456789")
    return common if all(len(name) > len(common) for name in names) else ""


def _draw_space(axis: Any, sensor: Sensor, tints: list[str]) -> None:
    """Faces of all taxels in the hand's 3-D frame, seen from where most of them face."""
    layout = sensor.layout
    normals = layout.normal[: layout.taxels]
    corners: list[Floats] = []
    for number, pad in enumerate(sensor.pads):
        own = geometry_of(pad if pad.pose is None else _unplaced(pad))
        T = np.eye(4) if pad.pose is None else se3_of(np.array(pad.pose[:3]), np.array(pad.pose[3:]))
        corners += list(faces(layout, number, own) @ T[:3, :3].T + T[:3, 3])
    outwards = normals.mean(axis=0)
    frame(axis, np.concatenate(corners), float(np.degrees(np.arctan2(outwards[1], outwards[0]))) + 30.0, 25.0)
    own_tint = [
        tints[pad] or BLUE for pad in range(len(tints)) for _ in range(*layout.of_pad(pad).indices(layout.taxels))
    ]
    draw_faces(axis, corners, normals, own_tint, numbered=layout.taxels <= TAXELS.numbered_in_space)
    axis.set_title("in space")


def _unplaced(pad: Any) -> Any:
    import msgspec

    return msgspec.structs.replace(pad, pose=None)
