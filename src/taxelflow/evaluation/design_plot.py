"""The picture of a design sweep."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from taxelflow.publish.plots.style import BLUE, GREEN, GREY, INK, VERMILION, caption, log_ticks, save, styled, widened

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from taxelflow.evaluation.design import DesignRow

_QUANTITIES = (("translation", "mm", "bound_mm", "error_mm"), ("turn", "deg", "bound_deg", "error_deg"))
_MARKS = (("square", BLUE, "s"), ("hexagonal", VERMILION, "h"), ("triangular", GREEN, "^"))
_GUIDELINE = 10.0
"""Object over taxel, of the paper."""


@dataclass(frozen=True, slots=True)
class _LeastSpan:
    """Ends of the axes, over each other: with fewer taxels swept, points that lie side by side would look far apart."""

    x: float = 2.0
    y: float = 5.0


_LEAST_SPAN = _LeastSpan()


def draw_design(rows: Sequence[DesignRow], path: Path) -> Path:
    """Errors against object over taxel, a colour per layout, of the first shape, size, noise and rate of the sweep.

    Raises ExtraMissing.
    """
    first = rows[0]
    same = [row for row in rows if _kind(row) == _kind(first)]
    shown = [quantity for quantity in _QUANTITIES if getattr(first, quantity[2]) is not None]
    with styled():
        import matplotlib.pyplot as plt

        figure, axes = plt.subplots(
            1, len(shown), figsize=(4.75 * len(shown), 4.4), layout="constrained", squeeze=False
        )
        for axis, (title, unit, bound, error) in zip(axes[0], shown, strict=True):
            _draw(axis, same, bound, error)
            axis.set_title(f"Error of the {title}")
            axis.set_ylabel(unit)
        handles, names = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, [f"{name} taxels" for name in names], loc="outside upper center", ncols=len(names))
        kinds = len({_kind(row) for row in rows})
        seen = (f"The first of {kinds} combinations of object, noise and rate. " if kinds > 1 else "") + (
            f"Object: {first.shape}, {first.size_mm:g} mm; noise {first.noise_percent:g} % of the largest pressure. "
            "Lines: Cramér-Rao bound of one scan, pattern known. "
            f"Points: RMS error of maximum-likelihood fits, {first.trials} random poses each."
        )
        caption(figure, seen)
        return save(figure, path)


def _kind(row: DesignRow) -> tuple[str, float, float, float]:
    return row.shape, row.size_mm, row.noise_percent, row.rate_hz


def _draw(axis: Any, rows: Sequence[DesignRow], bound: str, error: str) -> None:
    swept_layouts = {row.layout for row in rows}
    shown = [(layout, colour, mark) for layout, colour, mark in _MARKS if layout in swept_layouts]
    for number, (layout, colour, mark) in enumerate(shown):
        own = sorted((row for row in rows if row.layout == layout), key=lambda row: row.ratio)
        ratio = [row.ratio for row in own]
        aside = 0.015 * (number - 0.5 * (len(shown) - 1))  # points of two layouts are seen apart
        beside = [(1.0 + aside) * one for one in ratio]
        alone = "_" if len(own) == 1 else None  # a line of one point would not be drawn
        bounds = [getattr(row, bound) for row in own]
        axis.plot(ratio, bounds, color=colour, linewidth=1.2, marker=alone, markersize=14)
        axis.plot(beside, [getattr(row, error) for row in own], mark, color=colour, markersize=5, label=layout)
    axis.set_xscale("log")
    axis.set_yscale("log")
    swept = sorted({row.ratio for row in rows})
    log_ticks(axis.xaxis, swept if len(swept) <= 8 else ())
    log_ticks(axis.yaxis)
    axis.axvline(_GUIDELINE, color=GREY, linestyle=":", linewidth=1.0)
    axis.annotate(
        "the paper's guideline", (_GUIDELINE, 0.98), (-3, 0), xycoords=("data", "axes fraction"),
        textcoords="offset points", rotation=90, ha="right", va="top", fontsize=7, color=INK,
    )  # fmt: skip
    axis.set_xlabel("length of the object / taxel pitch")
    axis.set_xlim(widened(axis.get_xlim(), _LEAST_SPAN.x))
    axis.set_ylim(widened(axis.get_ylim(), _LEAST_SPAN.y))
