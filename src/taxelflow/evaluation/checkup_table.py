"""What `taxelflow info` shows in a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console

from taxelflow.publish.pressure_map import pressure_maps
from taxelflow.publish.quiet import quiet_table

if TYPE_CHECKING:
    from rich.table import Table

    from taxelflow.evaluation.checkup import Checkup

_OPTIONAL = ("drift", "load N", "full", "masked", "missing")
"""Columns that are left out where they hold nothing."""


def show_checkup(checkup: Checkup) -> None:
    """The recording in lines, the pads in a table and in pictures, then the faulty taxels."""
    console = Console(markup=False, highlight=False)
    promised = "" if checkup.scans_promised in (None, checkup.scans) else f" of {checkup.scans_promised} promised"
    console.print(f"{checkup.file} ({checkup.format})", style="bold", soft_wrap=True)
    console.print(f"sensor  {checkup.sensor}, values in {checkup.unit}")
    stamps = f", {checkup.repeated_scans} repeated stamps dropped" if checkup.repeated_scans else ""
    console.print(f"scans   {checkup.scans}{promised} in {checkup.duration_s:.2f} s{stamps}")
    if checkup.rate_hz is not None and checkup.jitter_s is not None:
        gaps = f"{checkup.gaps} gaps, the longest {checkup.longest_gap_s:.3f} s" if checkup.gaps else "no gaps"
        console.print(f"rate    {checkup.rate_hz:.2f} Hz, jitter {1e3 * checkup.jitter_s:.1f} ms, {gaps}")
    if checkup.repeated_values:
        console.print(
            f"repeats {checkup.repeated_values} scans are the one before again, bit for bit: "
            f"{checkup.new_rate_hz:.2f} Hz are new",
            style="yellow",
        )
    table, meanings = _pads_table(checkup)
    console.print(table)
    if any(pad.contact_scans or pad.findings for pad in checkup.pads):
        touched = [pad for pad in checkup.pads if pad.contact_scans or pad.findings]
        maps, digits = pressure_maps(touched, checkup.unit)
        console.print()
        console.print(maps)
        meanings = f"{meanings}\n{digits}"
    console.print(meanings, style="dim")
    for fault in (fault for pad in checkup.pads for fault in pad.faults):
        console.print(f"faulty: {fault}", style="yellow", soft_wrap=True)


def _pads_table(checkup: Checkup) -> tuple[Table, str]:
    """One row a pad, without columns that hold nothing, and what the columns mean."""
    pads = checkup.pads
    columns: list[tuple[str, list[str], str]] = [
        ("grid", [str(pad.taxels) if pad.table else f"{pad.rows}x{pad.cols}" for pad in pads], ""),
        ("range", [_range(pad.lowest, pad.highest) for pad in pads], ""),
        ("noise", [_short(pad.noise) for pad in pads], ""),
        (
            "drift",
            [_doubtful(pad.idle_drift, pad.idle_drift_std) for pad in pads],
            "drift: of the idle pad's mean, start to end",
        ),
        ("load N", [_short(pad.load_n) for pad in pads], ""),
        ("contact", [str(pad.contact_scans) for pad in pads], "contact: scans"),
        ("taxels", [str(pad.taxels) for pad in pads], ""),
        ("idle", [str(len(pad.idle_taxels)) for pad in pads], "idle: taxels never loaded"),
        ("full", [str(len(pad.saturated_taxels)) for pad in pads], "full: taxels that reached full scale"),
        ("masked", [str(pad.masked) for pad in pads], "masked: taxels"),
        ("missing", [str(pad.missing_readings) for pad in pads], "missing: readings"),
    ]
    shown = [column for column in columns if column[0] not in _OPTIONAL or set(column[1]) - {"0", "-"}]
    table = quiet_table("pad:", *(heading for heading, _, _ in shown))
    for pad, *cells in zip(pads, *(column[1] for column in shown), strict=True):
        table.add_row(pad.name, *cells)
    return table, "; ".join(meaning for _, _, meaning in shown if meaning)


def _short(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _doubtful(value: float | None, std: float | None) -> str:
    """A value with its sign; 0 within four of its standard errors."""
    if value is None or std is None:
        return "-"
    return f"{value:+.3g}" if abs(value) > 4 * std else "0"


def _range(lowest: float | None, highest: float | None) -> str:
    return "-" if lowest is None or highest is None else f"{lowest:.4g}..{highest:.4g}"
