"""A table as a picture, and error against number of slip vectors."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taxelflow.publish.plots.style import BLUE, EDGE, GREEN, INK, VERMILION, caption

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.figure import Figure


def table_figure(headings: Sequence[str], rows: Sequence[Sequence[str]], seen: str) -> Figure:
    """Text in rows and columns, numbers to the right, a rule under the headings."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(8.6, 0.5 + 0.235 * (len(rows) + 2)), layout="constrained")
    axis.axis("off")
    table = axis.table(cellText=[list(row) for row in rows], colLabels=list(headings), loc="upper center")
    table.auto_set_font_size(False)
    table.set_fontsize(8.5)
    table.scale(1.0, 1.15)
    for (row, _), cell in table.get_celld().items():
        cell.set_edgecolor(EDGE)
        cell.set_linewidth(0.8 if row == 0 else 0.0)
        cell.get_text().set_color(INK)
        if row == 0:
            cell.get_text().set_fontweight("bold")
    caption(figure, seen)
    return figure


def curve_figure(curves: Mapping[str, Sequence[tuple[int, float]]], ylabel: str, seen: str) -> Figure:
    """Error against number of slip vectors, a line per scenario."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
    for (name, points), colour, mark in zip(curves.items(), (BLUE, VERMILION, GREEN), "o^s", strict=False):
        ordered = sorted(points)
        axis.plot([n for n, _ in ordered], [e for _, e in ordered], color=colour, marker=mark, label=name)
    axis.set_xticks(sorted({n for points in curves.values() for n, _ in points}))
    axis.set_xlabel("slip vectors")
    axis.set_ylabel(ylabel)
    axis.set_ylim(0, 1.15 * max(e for points in curves.values() for _, e in points))
    axis.legend()
    caption(figure, seen)
    return figure
