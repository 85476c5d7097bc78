"""Terminal output: progress, tables, drawings of pads."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from operator import length_hint
from threading import Timer
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.text import Text

from taxelflow.publish.contact_table import contact_table
from taxelflow.publish.quiet import quiet_table
from taxelflow.runtime.complaint import as_far_as_read

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sized
    from pathlib import Path

    from taxelflow.publish.summary import Summary
    from taxelflow.sensors.calibration import Calibration
    from taxelflow.sensors.sensor import Sensor

    Block = TypeVar("Block", bound=Sized)
    Item = TypeVar("Item")

_PATIENCE_S = 2.0
"""What lasts longer shows a bar."""


def progress(blocks: Iterable[Block], scans: int | None, what: str) -> Iterator[Block]:
    """Pass blocks on, with a bar on stderr if it lasts and somebody watches."""
    with _bar(what, scans, "scans") as advance:
        for block in blocks:
            yield block
            advance(len(block))


def counted(items: Iterable[Item], what: str, count: int | None = None) -> Iterator[Item]:
    """Pass items on, with a bar on stderr if it lasts and somebody watches. count: of items that have no length."""
    with _bar("running", count or length_hint(items) or None, what) as advance:
        for item in items:
            yield item
            advance(1)


@contextmanager
def _bar(what: str, total: int | None, unit: str) -> Iterator[Callable[[int], None]]:
    """A bar with the time left on stderr, from `_PATIENCE_S` on; none where stderr is not a terminal."""
    if not sys.stderr.isatty():
        yield lambda _count: None
        return
    done = f"{{task.completed:.0f}} of {total} {unit}" if total is not None else f"{{task.completed:.0f}} {unit}"
    columns = (TextColumn(what), BarColumn(), TextColumn(done), TimeElapsedColumn(), TextColumn("left:"))
    bar = Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True), transient=True)
    task = bar.add_task(what, total=total)
    begin = Timer(_PATIENCE_S, bar.start)
    if _PATIENCE_S:
        begin.start()
    else:
        bar.start()
    try:
        yield lambda count: bar.advance(task, count)
    finally:
        if begin.is_alive():
            begin.cancel()
            begin.join()
        bar.stop()


def print_summary(summary: Summary, directory: Path) -> None:
    """A finished run in a few lines; what was lost or odd goes to stderr."""
    console = Console(markup=False)
    with as_far_as_read():
        if summary.contact:
            contacts = contact_table(summary)
            caption = f"{contacts.hidden} more contacts: see summary.json" if contacts.hidden else None
            title = f"{summary.method}, {summary.scans} scans of {summary.sensor}"
            table = quiet_table(*contacts.headings, title=title, caption=caption)
            for row in contacts.rows:
                table.add_row(*map(Text, row))
            console.print(table)
        console.print(f"results in {directory}", highlight=False, soft_wrap=True)
    note_on_stderr(summary)


def note_on_stderr(summary: Summary) -> None:
    """What was lost or odd, a line each."""
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
