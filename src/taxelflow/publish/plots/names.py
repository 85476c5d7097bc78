"""Names of pads beside their taxels, where they cover neither taxels nor other names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.publish.plots.sizes import NAMES
from taxelflow.publish.plots.style import INK

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from taxelflow.messages import Floats

_AROUND = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, 1), (1, -1), (-1, -1))
"""Places of a name around its pad, the most wanted one first."""


@dataclass(frozen=True, slots=True)
class Name:
    """A name, its centre in the axis' 2-D data coordinates, and what it covers: 0 if it is free and on the axis."""

    text: str
    at: tuple[float, float]
    covers: int


def finger(name: str) -> str:
    """What a pad's name begins with: `index` of `index_tip`."""
    return name.rsplit("_", 1)[0]


def free_places(
    axis: Axes, shapes: Sequence[Floats], names: Sequence[str], size: float, others: Floats | None = None
) -> list[Name]:
    """Where names of this size in points fit, one after the other. The figure must be laid out.

    shapes: of each pad the points (n, 2) that it covers, in the axis' 2-D data coordinates; others: of other marks.
    """
    to_points = 72.0 / axis.figure.dpi
    drawn = [to_points * axis.transData.transform(shape) for shape in shapes]
    marks = [] if others is None or not len(others) else [to_points * axis.transData.transform(others)]
    everything = np.concatenate([*drawn, *marks])
    room = to_points * axis.get_window_extent().get_points()
    boxes: list[Floats] = []
    found = []
    for own, name in zip(drawn, names, strict=True):
        half = np.array([NAMES.wide * len(name), NAMES.tall]) * size / 2
        low, high = own.min(axis=0), own.max(axis=0)
        tried = [(low + high) / 2 + np.array(way) * ((high - low) / 2 + half + NAMES.gap) for way in _AROUND]
        covers = [_covered(at, half, everything, boxes) + _outside(at, half, room) for at in tried]
        best = int(np.argmin(covers))
        boxes.append(np.stack([tried[best] - half, tried[best] + half]))
        x, y = axis.transData.inverted().transform(tried[best] / to_points)
        found.append(Name(name, (float(x), float(y)), covers[best]))
    return found


def write_names(axis: Axes, names: Sequence[Name], size: float) -> None:
    """Write names where they have room."""
    for name in names:
        look: dict[str, Any] = {"fontsize": size, "color": INK, "ha": "center", "va": "center", "zorder": 6}
        axis.annotate(name.text, name.at, annotation_clip=False, **look)


def _outside(at: Floats, half: Floats, room: Floats) -> int:
    return 0 if (at - half >= room[0]).all() and (at + half <= room[1]).all() else 5


def _covered(at: Floats, half: Floats, points: Floats, boxes: list[Floats]) -> int:
    inside = (np.abs(points - at) < half).all(axis=1).sum()
    met = sum(bool((np.abs(box.mean(axis=0) - at) < half + np.ptp(box, axis=0) / 2).all()) for box in boxes)
    return int(inside) + 10 * met
