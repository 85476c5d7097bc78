"""What `score contacts` shows in a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console

from taxelflow.publish.quiet import quiet_table

if TYPE_CHECKING:
    from typing import Any


def show_contacts(scored: Any) -> None:
    """Errors and consistency of each object, by how its contact was seen."""
    console = Console(markup=False)
    for scenario, mode in dict.fromkeys((row.scenario, row.mode) for row in scored.rows):
        title = f"{scenario}, {mode}, {scored.seeds} seeds from {scored.seed}"
        spans = ("1", "20", "100")
        table = quiet_table("method:", "object:", "seen:", "known", "ok", "mm", "deg", *spans, title=title)
        own = [row for row in scored.rows if (row.scenario, row.mode) == (scenario, mode)]
        for row in own:
            table.add_row(
                row.method,
                row.object,
                row.seen,
                f"{row.known:.0%}",
                f"{row.ok:.0%}",
                _number(row.rms_mm, 3),
                _number(row.rms_deg, 2),
                *(_number(found.nees, 1) for found in row.consistency),
            )
        console.print(table)
        console.print()
    for scenario, share in scored.noted.items():
        console.print(f"{scenario}, as one: {share:.0%} of runs note that contacts move apart", highlight=False)
    console.print(
        "alone: the other object is not there. told apart: --contacts 2. as one: without.\n"
        "known: share of the contact's scans with a pose that is not lost; ok: with\n"
        "quality ok. mm, deg: RMS of place and turn, each contact's best constant offset\n"
        "taken off. 1, 20, 100: NEES a degree of freedom over so many scans; 1: honest.",
        style="dim",
        highlight=False,
    )


def _number(value: float | None, digits: int) -> str:
    if value is None:
        return "-"
    return f"{value:.{digits}f}" if value < 1e3 else f"{value:.0e}"
