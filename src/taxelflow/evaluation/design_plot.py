"""The picture of a design sweep."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, get_args

from taxelflow.evaluation.design import Skin
from taxelflow.publish.plots.style import BLUE, GREEN, GREY, VERMILION, caption, save, styled

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from taxelflow.evaluation.design import DesignRow

_QUANTITIES = (("translation in mm", "bound_mm", "error_mm"), ("turn in deg", "bound_deg", "error_deg"))


def draw_design(rows: Sequence[DesignRow], path: Path) -> Path:
    """Errors against object over taxel, a colour per layout, of the first shape, size, noise and rate.

    Raises ExtraMissing.
    """
    first = rows[0]
    same = [row for row in rows if _kind(row) == _kind(first)]
    with styled():
        import matplotlib.pyplot as plt

        figure, axes = plt.subplots(1, 2, figsize=(9.5, 4.4), layout="constrained")
        for axis, (title, bound, error) in zip(axes, _QUANTITIES, strict=True):
            _draw(axis, same, bound, error)
            axis.set_title(title)
        axes[0].legend()
        seen = (
            f"{first.shape} object of {first.size_mm:g} mm, noise {first.noise_percent:g} % of the largest pressure. "
            "Lines: Cramer-Rao bound of one scan; points: maximum-likelihood fits. Dotted: the paper's guideline, 10."
        )
        caption(figure, seen, 125)
        return save(figure, path)


def _kind(row: DesignRow) -> tuple[str, float, float, float]:
    return row.shape, row.size_mm, row.noise_percent, row.rate_hz


def _draw(axis: Any, rows: Sequence[DesignRow], bound: str, error: str) -> None:
    for layout, colour in zip(get_args(Skin), (BLUE, VERMILION, GREEN), strict=True):
        own = sorted((row for row in rows if row.layout == layout), key=lambda row: row.ratio)
        if own and getattr(own[0], bound) is not None:
            ratio = [row.ratio for row in own]
            axis.plot(ratio, [getattr(row, bound) for row in own], color=colour, label=layout)
            axis.plot(ratio, [getattr(row, error) for row in own], "o", color=colour, markersize=4)
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.axvline(10.0, color=GREY, linestyle=":", linewidth=1.0)
    axis.set_xlabel("object over taxel")
