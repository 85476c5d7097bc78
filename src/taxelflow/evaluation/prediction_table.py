"""What `score real` shows in a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console

from taxelflow.publish.quiet import quiet_table

if TYPE_CHECKING:
    from typing import Any


def show_real(scored: Any) -> None:
    """Prediction errors, then turns, a block per recording."""
    console = Console(markup=False, highlight=False)
    for name in dict.fromkeys(row.recording for row in scored.predictions):
        console.print(name, style="bold")
        table = quiet_table("pad:", "scans", "forecast", "no motion", "registered", "centroid", "noise", "lost")
        for row in scored.predictions:
            if row.recording == name:
                errors = (row.forecast_percent, row.no_motion_percent, row.registered_percent, row.centroid_percent)
                numbers = [f"{error:.1f}" for error in (*errors, row.noise_percent)]
                table.add_row(row.pad, str(row.scans), *numbers, str(row.lost))
        console.print(table)
        turns = [turn for turn in scored.turns if turn.recording == name]
        if turns:
            table = quiet_table("pad:", "from s", "scans", "template deg", "axis deg", "apart deg", "ok %")
            for turn in turns:
                angles = (turn.template_deg, turn.axis_deg)
                table.add_row(
                    turn.pad,
                    f"{turn.from_s:.2f}",
                    str(turn.scans),
                    *(f"{angle:+.1f}" for angle in angles),
                    f"{turn.apart_deg:.1f}",
                    f"{turn.ok_percent:.0f}",
                )
            console.print(table)
        console.print()
    if not scored.predictions:
        console.print("no contact is long enough to predict a scan of it")
    console.print(
        "Errors of the next scan, RMS, in % of its readings. forecast: the template,\n"
        "causal, moved on at its last velocity. no motion: the last scan again.\n"
        "registered: the template at the pose of that scan. centroid: the last scan,\n"
        "moved as far as the centroid did. noise: the sensor's own. Turns: the longest\n"
        "contact that shows one, while it has a quarter of its load or more; the template\n"
        "as a batch.",
        style="dim",
    )
