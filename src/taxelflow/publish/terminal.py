"""What people see in a terminal: progress, tables, drawings of pads."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn, track
from rich.text import Text

from taxelflow.publish.pressure_map import pressure_maps
from taxelflow.publish.quiet import quiet_table

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sized
    from pathlib import Path
    from typing import Any

    from rich.table import Table

    from taxelflow.publish.summary import Summary
    from taxelflow.sensors.calibration import Calibration
    from taxelflow.sensors.sensor import Sensor

    Block = TypeVar("Block", bound=Sized)
    Item = TypeVar("Item")

_LONG_SCANS = 5000


def progress(blocks: Iterable[Block], scans: int | None, what: str) -> Iterator[Block]:
    """Pass blocks on, with a bar on stderr if there are many scans and somebody watches."""
    if not sys.stderr.isatty() or (scans is not None and scans < _LONG_SCANS):
        yield from blocks
        return
    columns = (TextColumn(f"{what} {{task.completed:.0f}} scans"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=scans)
        for block in blocks:
            yield block
            bar.advance(task, len(block))


def counted(items: Iterable[Item], what: str) -> Iterator[Item]:
    """Pass items on, with a bar on stderr if somebody watches."""
    console = Console(stderr=True)
    yield from track(items, description=what, console=console, transient=True, disable=not console.is_terminal)


def say(summary: Summary, directory: Path) -> None:
    """A finished run in a few lines; what was lost or odd goes to stderr."""
    title = f"{summary.method}, {summary.scans} scans of {summary.sensor}"
    table = quiet_table("pad:", "contact scans", "slips", "net x mm", "net y mm", "at border", title=title)
    for name, pad in summary.pads.items():
        if pad.contact_scans:
            net = ["-" if m is None else f"{1e3 * m:+.1f}" for m in pad.net_m]
            table.add_row(name, str(pad.contact_scans), str(pad.slips), *net, f"{100 * pad.border_share:.0f} %")
    console = Console(markup=False)
    if summary.contact:
        console.print(table)
    console.print(f"results in {directory}", highlight=False, soft_wrap=True)
    for note in (*summary.notes, *([summary.loss] if summary.loss else [])):
        print(f"taxelflow: {note}", file=sys.stderr)  # noqa: T201


def show_checkup(checkup: Any) -> None:
    """A `Checkup`: the recording in lines, the pads in a table and in pictures, then what is not well."""
    console = Console(markup=False, highlight=False)
    promised = "" if checkup.scans_promised in (None, checkup.scans) else f" of {checkup.scans_promised} promised"
    console.print(f"{checkup.file} ({checkup.format})", style="bold", soft_wrap=True)
    console.print(f"sensor  {checkup.sensor}, values in {checkup.unit}")
    stamps = f", {checkup.repeated_scans} repeated stamps dropped" if checkup.repeated_scans else ""
    console.print(f"scans   {checkup.scans}{promised} in {checkup.duration_s:.2f} s{stamps}")
    if checkup.rate_hz:
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
    for finding in (finding for pad in checkup.pads for finding in pad.findings):
        console.print(f"not well: {finding.words}", style="yellow", soft_wrap=True)


def _pads_table(checkup: Any) -> tuple[Table, str]:
    """One row a pad, with the columns that have something to say, and what they mean."""
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
    told = [column for column in columns if column[0] not in _OPTIONAL or set(column[1]) - {"0", "-"}]
    table = quiet_table("pad:", *(heading for heading, _, _ in told))
    for pad, *cells in zip(pads, *(column[1] for column in told), strict=True):
        table.add_row(pad.name, *cells)
    return table, "; ".join(meaning for _, _, meaning in told if meaning)


_OPTIONAL = ("drift", "load N", "full", "masked", "missing")


def _short(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _doubtful(value: float | None, std: float | None) -> str:
    """A value that may be nothing: 0 within four of its standard errors."""
    if value is None or std is None:
        return "-"
    return f"{value:+.3g}" if abs(value) > 4 * std else "0"


def _range(lowest: float | None, highest: float | None) -> str:
    return "-" if lowest is None or highest is None else f"{lowest:.4g}..{highest:.4g}"


def list_sensors(sensors: list[tuple[str, Sensor]]) -> None:
    """A table of sensors by the name to ask for."""
    table = quiet_table("name:", "pads", "taxels", "unit:", "note:")
    for name, sensor in sensors:
        taxels = sum(pad.count for pad in sensor.pads)  # the layout takes time
        table.add_row(Text(name), str(len(sensor.pads)), str(taxels), sensor.unit, Text(sensor.note))
    console = Console(markup=False)
    console.print(table)
    console.print(
        "also: plain grids by rows, cols and pitch, such as grid:16x16@4mm; your own in a TOML file", style="dim"
    )


def show_calibration(calibration: Calibration, path: Path) -> None:
    """Gains with standard errors, the mm they amount to, and the frames and clocks found."""
    console = Console(markup=False, highlight=False, soft_wrap=True)
    table = quiet_table(
        "pad:",
        "axis:",
        "gain",
        "±",
        "mm per index",
        "scans",
        "interior",
        title=f"{calibration.method}, {calibration.sensor}",
    )
    for pad in calibration.pads:
        for axis, gain, std, mm in (
            ("x", pad.gain_x, pad.std_x, pad.mm_per_index_x),
            ("y", pad.gain_y, pad.std_y, pad.mm_per_index_y),
        ):
            sure = "assumed" if std is None else f"{std:.4f}"
            table.add_row(pad.name, axis, f"{gain:.4f}", sure, f"{mm:.3f}", str(pad.scans), str(pad.interior_scans))
    console.print(table)
    for pad in calibration.pads:
        (x, y, turn), (std_x, std_y, std_turn) = pad.T_pad_robot, pad.std_pad_robot
        console.print(
            f"{pad.name}: robot's frame at x {1e3 * x:.2f} ± {1e3 * std_x:.2f} mm, "
            f"y {1e3 * y:.2f} ± {1e3 * std_y:.2f} mm, "
            f"turned by {np.degrees(turn):.2f} ± {np.degrees(std_turn):.2f} deg; robot's clock ahead by "
            f"{1e3 * pad.time_offset_s:.1f} ± {1e3 * pad.std_time_offset_s:.1f} ms; residual {pad.residual_mm:.3f} mm"
        )
        if pad.note:
            console.print(f"{pad.name}: {pad.note}")
    console.print(f"written to {path}")


def show_bench(figures: Any) -> None:
    """Tables of a `Bench`."""
    console = Console(markup=False)
    title = "one step of a whole hand, every pad loaded"
    steps = quiet_table("sensor:", "what:", "p50 us", "p99 us", "x literal", title=title)
    for row in figures.latencies:
        steps.add_row(row.sensor, row.what, f"{row.p50_us:.1f}", f"{row.p99_us:.1f}", f"{row.times_faster:.1f}")
    console.print(steps)
    console.print()
    if figures.peers.skipped:
        console.print(f"other software is not timed: {figures.peers.skipped}", style="dim")
    else:
        rivals = quiet_table(
            "what:", "p50 us", "p99 us", "x p50", "x p99", title="one streaming step of the 162-taxel hand"
        )
        for row in figures.peers.rows:
            times = (f"{row.p50_us:.1f}", f"{row.p99_us:.1f}", f"{row.p50_over_peer:.2f}", f"{row.p99_over_peer:.2f}")
            rivals.add_row(row.what, *times)
        console.print(rivals)
    console.print()
    batch = quiet_table("array:", "what:", "GB/s", "x read", "Mscans/s", title="many scans at once, one core")
    for row in figures.throughputs:
        rates = (f"{row.gb_per_s:.1f}", f"{row.share_of_read:.2f}", f"{row.million_scans_per_s:.2f}")
        batch.add_row(row.array, row.what, *rates)
    console.print(batch)
    console.print()
    title = f"estimate, {figures.scans} scans of {figures.recording}"
    shares = quiet_table("stage:", "ms", "share", title=title)
    for row in figures.shares:
        shares.add_row(row.stage, f"{1e3 * row.seconds:.0f}", f"{100 * row.share:.1f} %")
    console.print(shares)
    console.print()
    title = f"reading, the same {figures.scans} scans in each format"
    readings = quiet_table("format:", "MB", "scans/s", "MB/s", "plain library:", "scans/s", "x library", title=title)
    for row in figures.readings:
        ours = (f"{row.megabytes:.1f}", f"{row.scans_per_s:.0f}", f"{row.mb_per_s:.0f}")
        readings.add_row(row.format, *ours, row.library, f"{row.library_scans_per_s:.0f}", f"{row.ratio:.2f}")
    console.print(readings)
    console.print()
    starts = quiet_table("command:", "ms", "x import numpy", title="start of a process")
    for row in figures.starts:
        starts.add_row(row.command, f"{1e3 * row.seconds:.0f}", f"{row.over_import_numpy:.2f}")
    console.print(starts)
