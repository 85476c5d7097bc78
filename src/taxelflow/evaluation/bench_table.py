"""What `taxelflow bench` shows in a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console

from taxelflow.publish.quiet import quiet_table

if TYPE_CHECKING:
    from rich.table import Table

    from taxelflow.evaluation.bench import Bench


def show_bench(found: Bench) -> None:
    """One step, other software, many scans at once, shares of a run, reading, start of a process."""
    console = Console(markup=False)
    console.print(_steps(found))
    console.print()
    if found.peers.skipped:
        console.print(f"other software is not timed: {found.peers.skipped}", style="dim")
    else:
        console.print(_peers(found))
    for table in (_throughputs(found), _shares(found), _readings(found), _starts(found)):
        console.print()
        console.print(table)


def _steps(found: Bench) -> Table:
    title = "one step of a whole hand, every pad loaded"
    table = quiet_table("sensor:", "what:", "p50 us", "p99 us", "x literal", title=title)
    for row in found.latencies:
        table.add_row(row.sensor, row.what, f"{row.p50_us:.1f}", f"{row.p99_us:.1f}", f"{row.times_faster:.1f}")
    return table


def _peers(found: Bench) -> Table:
    title = "one streaming step of the 162-taxel hand"
    table = quiet_table("what:", "p50 us", "p99 us", "x p50", "x p99", title=title)
    for row in found.peers.rows:
        times = (f"{row.p50_us:.1f}", f"{row.p99_us:.1f}", f"{row.p50_over_peer:.2f}", f"{row.p99_over_peer:.2f}")
        table.add_row(row.what, *times)
    return table


def _throughputs(found: Bench) -> Table:
    table = quiet_table("array:", "what:", "GB/s", "x read", "Mscans/s", title="many scans at once, one core")
    for row in found.throughputs:
        rates = (f"{row.gb_per_s:.1f}", f"{row.share_of_read:.2f}", f"{row.million_scans_per_s:.2f}")
        table.add_row(row.array, row.what, *rates)
    return table


def _shares(found: Bench) -> Table:
    table = quiet_table("stage:", "ms", "share", title=f"estimate, {found.scans} scans of {found.recording}")
    for row in found.shares:
        table.add_row(row.stage, f"{1e3 * row.seconds:.0f}", f"{100 * row.share:.1f} %")
    return table


def _readings(found: Bench) -> Table:
    title = f"reading, the same {found.scans} scans in each format"
    table = quiet_table("format:", "MB", "scans/s", "MB/s", "plain library:", "scans/s", "x library", title=title)
    for row in found.readings:
        ours = (f"{row.megabytes:.1f}", f"{row.scans_per_s:.0f}", f"{row.mb_per_s:.0f}")
        table.add_row(row.format, *ours, row.library, f"{row.library_scans_per_s:.0f}", f"{row.ratio:.2f}")
    return table


def _starts(found: Bench) -> Table:
    table = quiet_table("command:", "ms", "x import numpy", title="start of a process")
    for row in found.starts:
        table.add_row(row.command, f"{1e3 * row.seconds:.0f}", f"{row.over_import_numpy:.2f}")
    return table
