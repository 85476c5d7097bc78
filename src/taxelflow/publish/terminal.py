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
