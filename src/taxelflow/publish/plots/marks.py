"""Marks that several pictures share: arrows, a bar of a round length, taxels in one colour."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from taxelflow.publish.plots.style import EDGE, INK, tick_step

if TYPE_CHECKING:
    from collections.abc import Iterable

    from matplotlib.axes import Axes

    from taxelflow.messages import Floats

    Place = tuple[float, float] | Floats

Box = tuple[float, float, float, float]
"""left, right, low, high, mm."""


def show_box(axis: Axes, box: Box) -> None:
    """Show this part of a plane in mm, with equal scales and no grid."""
    axis.set_xlim(box[0], box[1])
    axis.set_ylim(box[2], box[3])
    axis.set_aspect("equal")
    axis.grid(visible=False)


def draw_arrow(axis: Axes, tail: Place, tip: Place, colour: str, width: float = 1.6, zorder: float = 4.0) -> None:
    """An arrow between two places (2,) in the axis' coordinates. width: of its line, points."""
    look = {"arrowstyle": "-|>", "color": colour, "linewidth": width, "shrinkA": 0, "shrinkB": 0}
    axis.annotate("", xy=(tip[0], tip[1]), xytext=(tail[0], tail[1]), arrowprops=look, zorder=zorder)


def draw_scale(axis: Axes, box: Box, colour: str = INK) -> None:
    """A bar of a round length in the lower left corner of a plane in mm."""
    wide = box[1] - box[0]
    length = tick_step(wide, 8)
    x, y = box[0] + 0.03 * wide, box[2] + 0.03 * (box[3] - box[2])
    axis.plot([x, x + length], [y, y], color=colour, linewidth=2.0, solid_capstyle="butt", zorder=6)
    place: Any = {"textcoords": "offset points", "ha": "center", "va": "bottom", "zorder": 6}
    axis.annotate(f"{length:g} mm", (x + length / 2, y), (0, 3), color=colour, fontsize=7, **place)


def draw_taxels(axis: Axes, shapes: Iterable[Floats], **look: Any) -> Any:
    """Outlines (corners, 2) of taxels in mm; the collection. look: what a `PolyCollection` takes, such as its face."""
    from matplotlib.collections import PolyCollection

    usual: dict[str, Any] = {"edgecolor": EDGE, "linewidth": 0.5, "zorder": 1}
    taxels = PolyCollection(list(shapes), **usual | look)
    axis.add_collection(taxels)
    return taxels
