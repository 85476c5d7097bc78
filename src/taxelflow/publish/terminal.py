"""What people see in a terminal: progress, tables, drawings of pads."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn, track
from rich.text import Text

from taxelflow.publish.quiet import quiet_table

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sized
    from pathlib import Path
    from typing import Any

    from taxelflow.calibration import Calibration
    from taxelflow.layout import Sensor
    from taxelflow.publish.summary import Summary

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
            net = [f"{1e3 * m:+.1f}" for m in pad.net_m]
            table.add_row(name, str(pad.contact_scans), str(pad.slips), *net, f"{100 * pad.border_share:.0f} %")
    console = Console(markup=False)
    if summary.contact:
        console.print(table)
    console.print(f"results in {directory}", highlight=False, soft_wrap=True)
    for note in (*summary.notes, *([summary.loss] if summary.loss else [])):
        print(f"taxelflow: {note}", file=sys.stderr)  # noqa: T201


def show_checkup(checkup: Any) -> None:
    """Tables of a `Checkup`."""
    console = Console(markup=False)
    promised = "" if checkup.scans_promised in (None, checkup.scans) else f" of {checkup.scans_promised} promised"
    console.print(f"{checkup.file} ({checkup.format})", style="bold", highlight=False, soft_wrap=True)
    console.print(f"sensor  {checkup.sensor}, values in {checkup.unit}", highlight=False)
    console.print(
        f"scans   {checkup.scans}{promised} in {checkup.duration_s:.2f} s"
        + (f", {checkup.repeated_scans} repeated stamps dropped" if checkup.repeated_scans else ""),
        highlight=False,
    )
    if checkup.rate_hz:
        gaps = f"{checkup.gaps} gaps, the longest {checkup.longest_gap_s:.3f} s" if checkup.gaps else "no gaps"
        console.print(
            f"rate    {checkup.rate_hz:.2f} Hz, jitter {1e3 * checkup.jitter_s:.1f} ms, {gaps}", highlight=False
        )
    columns: list[tuple[str, list[str]]] = [
        ("pad", [pad.name for pad in checkup.pads]),
        ("grid", [f"{pad.rows}x{pad.cols}" for pad in checkup.pads]),
        ("range", [_range(pad.lowest, pad.highest) for pad in checkup.pads]),
        ("noise", [f"{pad.noise:.3g}" if pad.noise is not None else "-" for pad in checkup.pads]),
        ("contact", [str(pad.contact_scans) for pad in checkup.pads]),
        ("taxels", [str(pad.taxels) for pad in checkup.pads]),
        ("idle", [str(len(pad.idle_taxels)) for pad in checkup.pads]),
        ("full", [str(len(pad.saturated_taxels)) for pad in checkup.pads]),
    ]
    if any(pad.masked for pad in checkup.pads):
        columns.append(("masked", [str(pad.masked) for pad in checkup.pads]))
    if any(pad.missing_readings for pad in checkup.pads):
        columns.append(("missing", [str(pad.missing_readings) for pad in checkup.pads]))
    caption = "contact in scans; idle, full (saturated) and masked in taxels"
    table = quiet_table("pad:", *(heading for heading, _ in columns[1:]), caption=caption)
    for row in zip(*(cells for _, cells in columns), strict=True):
        table.add_row(*row)
    console.print(table)


def _range(lowest: float | None, highest: float | None) -> str:
    return "-" if lowest is None or highest is None else f"{lowest:.4g}..{highest:.4g}"


def list_sensors(sensors: list[Sensor]) -> None:
    """A table of sensors."""
    table = quiet_table("name:", "pads", "taxels", "unit:", "note:")
    for sensor in sensors:
        table.add_row(sensor.name, str(len(sensor.pads)), str(sensor.layout.taxels), sensor.unit, sensor.note)
    Console(markup=False).print(table)


def draw_sensor(sensor: Sensor) -> None:
    """Each pad as a grid of its taxels' numbers, row 0 on top; a dot where none is. Then the groups."""
    console, layout = Console(markup=False, highlight=False), sensor.layout
    console.print(f"{sensor.name}  {layout.taxels} taxels in {len(sensor.pads)} pads, {sensor.unit}", style="bold")
    if sensor.note:
        console.print(sensor.note)
    numbers = np.arange(layout.taxels, dtype=np.float64)
    for index, pad in enumerate(sensor.pads):
        size = "x".join(f"{1e3 * pitch:g}" for pitch in pad.pitch_m)
        console.print(f"\n{pad.name}  {pad.rows} rows x {pad.cols} cols, pitch {size} mm", style="bold")
        if pad.origin_m is not None:
            x, y = (1e3 * place for place in pad.origin_m)
            console.print(f"at ({x:g}, {y:g}) mm on the flattened hand, turned {np.degrees(pad.angle_rad):.0f} deg")
        if pad.note:
            console.print(pad.note, style="yellow")
        for row in layout.grid(index, numbers):
            cells = "".join(f"{n:5.0f}" if np.isfinite(n) else "    ·" for n in row)
            console.print(Text(cells, style="cyan"))
    for index, group in enumerate(sensor.groups, layout.pad_count):
        pads = ", ".join(dict.fromkeys(patch.pad for patch in group.patches))
        taxels = layout.source[layout.of_pad(index)]
        console.print(f"\n{group.name}  group of {len(taxels)} taxels of {pads}", style="bold")
        console.print(Text(" ".join(map(str, taxels)), style="cyan"))
    console.print("\nrow 0 is the top row; x to the right, y up, origin at the pad's centre", style="dim")


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


def show_table1(table: Any) -> None:
    """The paper's Table I, then ours, in its columns."""
    console = Console(markup=False)
    names = {"lnorm": "L norm", "convolution": "flow"}
    paper = quiet_table(
        "mm/s", "method:", "backward", "forward", "RMSE mm/s", "RMSE %", title="Table I as published: one trial"
    )
    for row in table.paper:
        velocities = (f"{row.backward_mm_s:.2f}", f"{row.forward_mm_s:.2f}")
        paper.add_row(
            str(row.nominal_mm_s), names[row.method], *velocities, f"{row.rmse_mm_s:.2f}", f"{row.rmse_percent:.1f}"
        )
    console.print(paper)
    console.print()
    title = f"ours: {table.strokes} strokes a speed, seed {table.seed}"
    ours = quiet_table("mm/s", "method:", "scans:", "factor", "back", "forth", "RMSE", "%", "±", "bias", title=title)
    for row in table.ours:
        ours.add_row(
            str(row.nominal_mm_s),
            names[row.method],
            row.scans,
            "none" if row.factor == 1.0 else f"{row.factor:.4f}({1e4 * row.factor_standard_error:.0f})",
            f"{row.backward_mm_s:.2f}",
            f"{row.forward_mm_s:.2f}",
            f"{row.rmse_mm_s:.2f}",
            f"{row.rmse_percent:.2f}",
            f"{row.standard_error_percent:.2f}",
            f"{row.bias_percent:+.1f}",
            end_section=row.method == "convolution" and row.scans == "interior" and row.factor != 1.0,
        )
    console.print(ours)
    console.print(
        "all: every scan in contact. interior: the object's centre at most 22 mm\n"
        "from the palm's. factor: one per method and set of scans, fitted at 25 mm/s\n"
        "on strokes that are not in the table, in brackets the standard error of its\n"
        "last digits. RMSE in mm/s and %, ± the standard error of the latter; bias in %.",
        style="dim",
        highlight=False,
    )


def show_field(scored: Any) -> None:
    """Errors of translation and rotation by number of slip vectors."""
    console = Console(markup=False)
    for scenario in dict.fromkeys(row.scenario for row in scored.rows):
        title = f"{scenario}, {scored.seeds} seeds"
        table = quiet_table("vectors", "hand:", "direction deg", "speed %", "turn %", "turn bias %", title=title)
        for row in scored.rows:
            if row.scenario == scenario:
                direction = "-" if row.direction_deg is None else f"{row.direction_deg:.1f}"
                speed = "-" if row.speed_percent is None else f"{row.speed_percent:.1f}"
                table.add_row(
                    str(row.vectors),
                    row.cut,
                    direction,
                    speed,
                    f"{row.turn_percent:.1f}",
                    f"{row.turn_bias_percent:+.1f}",
                )
        console.print(table)
        console.print()
    console.print(
        "direction: median; speed and turn: RMSE over the RMS of the true one; at the hand's origin", style="dim"
    )


def show_slip(scored: Any) -> None:
    """Slips found, then alarms of still objects beside the rate that was asked for."""
    console = Console(markup=False)
    title = f"slips: {scored.seeds} recordings of each object, seeds from {scored.first_seed}"
    found = quiet_table(
        "object:", "method:", "n", "F1", "ms", "p90", "max", "miss", "false", "split", "deg", "%", title=title
    )
    for row in scored.slips:
        onsets = [f"{ms:.0f}" for ms in (row.onset_ms, row.onset_p90_ms, row.onset_max_ms)]
        counts = [str(count) for count in (row.missed, row.false, row.split)]
        motion = (f"{row.direction_deg:.0f}", f"{row.speed_percent:.0f}")
        found.add_row(row.object, row.method, str(row.slips), f"{row.f1:.3f}", *onsets, *counts, *motion)
    console.print(found)
    console.print()
    title = f"still objects, {scored.alarms_per_hour:g} false alarms an hour asked for"
    still = quiet_table("scenario:", "method:", "hours", "alarms", "an hour", "95 %:", "scatter", title=title)
    for row in scored.holds:
        rates = [f"{rate:.0f}" if rate >= 100 else f"{rate:.2g}" for rate in (row.per_hour, row.low, row.high)]
        numbers = (f"{row.hours:.2f}", str(row.alarms), rates[0], f"{rates[1]} to {rates[2]}", f"{row.scatter:.2f}")
        still.add_row(row.scenario, row.method, *numbers)
    console.print(still)
    console.print(
        "n: slips. ms, p90, max: from the first slipping scan to the first called so.\n"
        "false: begun while still. split: begun anew within a slip. deg, %: median error\n"
        "of a slip's direction and speed. 95 %: interval of the rate. scatter: learned,\n"
        "over the covariance's. roll and tilt are no slips; pressure alone cannot tell.",
        style="dim",
        highlight=False,
    )


def show_bench(figures: Any) -> None:
    """Tables of a `Bench`."""
    console = Console(markup=False)
    title = "one step of a whole hand, every pad loaded"
    steps = quiet_table("sensor:", "what:", "p50 us", "p99 us", "x literal", title=title)
    for row in figures.latencies:
        steps.add_row(row.sensor, row.what, f"{row.p50_us:.1f}", f"{row.p99_us:.1f}", f"{row.times_faster:.1f}")
    console.print(steps)
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
    starts = quiet_table("command:", "ms", "x import numpy", title="start of a process")
    for row in figures.starts:
        starts.add_row(row.command, f"{1e3 * row.seconds:.0f}", f"{row.over_import_numpy:.2f}")
    console.print(starts)
