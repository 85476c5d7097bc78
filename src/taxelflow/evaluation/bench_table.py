"""What `taxelflow bench` shows in a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console

from taxelflow.evaluation.cells import shown

if TYPE_CHECKING:
    from rich.table import Table

    from taxelflow.evaluation.bench import Bench


def show_bench(found: Bench) -> None:
    """One step, other software, many scans at once, large pads, shares of a run, reading, start of a process."""
    console = Console(markup=False)
    console.print(_steps(found))
    console.print()
    if found.peers.skipped:
        console.print(f"other software is not timed: {found.peers.skipped}", style="dim")
    else:
        console.print(_peers(found))
    for table in (_throughputs(found), _large(found), _shares(found), _readings(found), _starts(found)):
        console.print()
        console.print(table)


def _steps(found: Bench) -> Table:
    columns = (("sensor:", "sensor"), ("what:", "what"), ("p50 us", "p50_us", 1), ("p99 us", "p99_us", 1))
    title = "one step of a whole hand, every pad loaded"
    return shown(found.latencies, *columns, ("x literal", "times_faster", 1), title=title)


def _peers(found: Bench) -> Table:
    columns = (("what:", "what"), ("p50 us", "p50_us", 1), ("p99 us", "p99_us", 1))
    ratios = (("x p50", "p50_over_peer", 2), ("x p99", "p99_over_peer", 2))
    return shown(found.peers.rows, *columns, *ratios, title="one streaming step of the 162-taxel hand")


def _throughputs(found: Bench) -> Table:
    columns = (("array:", "array"), ("what:", "what"), ("GB/s", "gb_per_s", 1), ("x read", "share_of_read", 2))
    last = ("Mscans/s", "million_scans_per_s", 2)
    return shown(found.throughputs, *columns, last, title="many scans at once, one core")


def _large(found: Bench) -> Table:
    columns = (("pad:", "pad"), ("taxels", "taxels", 0), ("scans", "scans", 0))
    unseen = ("unseen error", lambda row: f"{100 * row.unseen_error:.0f} %")
    title = "batches of template, contacts that cover the pad"
    return shown(found.large, *columns, unseen, ("CPU s", "cpu_s", 1), title=title)


def _shares(found: Bench) -> Table:
    return shown(
        found.shares,
        ("stage:", "stage"),
        ("ms", lambda row: f"{1e3 * row.seconds:.0f}"),
        ("share", lambda row: f"{100 * row.share:.1f} %"),
        title=f"estimate, {found.scans} scans of {found.recording}",
    )


def _readings(found: Bench) -> Table:
    ours = (("MB", "megabytes", 1), ("scans/s", "scans_per_s", 0), ("MB/s", "mb_per_s", 0))
    theirs = (("plain library:", "library"), ("scans/s", "library_scans_per_s", 0), ("x library", "ratio", 2))
    title = f"reading, the same {found.scans} scans in each format"
    return shown(found.readings, ("format:", "format"), *ours, *theirs, title=title)


def _starts(found: Bench) -> Table:
    return shown(
        found.starts,
        ("command:", "command"),
        ("ms", lambda row: f"{1e3 * row.seconds:.0f}"),
        ("x import numpy", "over_import_numpy", 2),
        title="start of a process",
    )
