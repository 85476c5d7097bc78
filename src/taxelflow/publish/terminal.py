"""What people see in a terminal: progress, tables, drawings of pads."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sized
    from pathlib import Path
    from typing import Any

    from taxelflow.layout import Sensor
    from taxelflow.publish.summary import Summary

    Block = TypeVar("Block", bound=Sized)

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


def say(summary: Summary, directory: Path) -> None:
    """A finished run in a few lines; what was lost or odd goes to stderr."""
    table = Table(title=f"{summary.method}, {summary.scans} scans of {summary.sensor}", title_justify="left")
    for heading in ("pad", "contact scans", "slips", "net x mm", "net y mm", "at border"):
        table.add_column(heading, justify="left" if heading == "pad" else "right")
    for name, pad in summary.pads.items():
        if pad.contact_scans:
            net = [f"{1e3 * m:+.1f}" for m in pad.net_m]
            table.add_row(name, str(pad.contact_scans), str(pad.slips), *net, f"{100 * pad.border_share:.0f} %")
    console = Console()
    if summary.contact:
        console.print(table)
    console.print(f"results in {directory}", highlight=False, soft_wrap=True)
    for note in (*summary.notes, *([summary.loss] if summary.loss else [])):
        print(f"taxelflow: {note}", file=sys.stderr)  # noqa: T201


def show_checkup(checkup: Any) -> None:
    """Tables of a `Checkup`."""
    console = Console()
    promised = "" if checkup.scans_promised in (None, checkup.scans) else f" of {checkup.scans_promised} promised"
    console.print(f"[bold]{checkup.file}[/bold] ({checkup.format})", highlight=False, soft_wrap=True)
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
        ("saturated", [str(len(pad.saturated_taxels)) for pad in checkup.pads]),
    ]
    if any(pad.masked for pad in checkup.pads):
        columns.append(("masked", [str(pad.masked) for pad in checkup.pads]))
    if any(pad.missing_readings for pad in checkup.pads):
        columns.append(("missing", [str(pad.missing_readings) for pad in checkup.pads]))
    table = Table(caption="contact in scans; idle, saturated and masked in taxels", caption_justify="left")
    for heading, _ in columns:
        table.add_column(heading, justify="left" if heading == "pad" else "right")
    for row in zip(*(cells for _, cells in columns), strict=True):
        table.add_row(*row)
    console.print(table)


def _range(lowest: float | None, highest: float | None) -> str:
    return "-" if lowest is None or highest is None else f"{lowest:.4g}..{highest:.4g}"


def list_sensors(sensors: list[Sensor]) -> None:
    """A table of sensors."""
    table = Table()
    for heading in ("name", "pads", "taxels", "unit", "note"):
        table.add_column(heading)
    for sensor in sensors:
        table.add_row(sensor.name, str(len(sensor.pads)), str(sensor.layout.taxels), sensor.unit, sensor.note)
    Console().print(table)


def draw_sensor(sensor: Sensor) -> None:
    """Each pad as a grid of its taxels' numbers, row 0 on top; a dot where none is."""
    console, layout = Console(), sensor.layout
    console.print(
        f"[bold]{sensor.name}[/bold]  {layout.taxels} taxels in {len(sensor.pads)} pads, {sensor.unit}", highlight=False
    )
    if sensor.note:
        console.print(sensor.note, highlight=False)
    numbers = np.arange(layout.taxels, dtype=np.float64)
    for index, pad in enumerate(sensor.pads):
        size = "x".join(f"{1e3 * pitch:g}" for pitch in pad.pitch_m)
        console.print(f"\n[bold]{pad.name}[/bold]  {pad.rows} rows x {pad.cols} cols, pitch {size} mm", highlight=False)
        if pad.note:
            console.print(pad.note, style="yellow", highlight=False)
        for row in layout.grid(index, numbers):
            cells = "".join(f"{n:5.0f}" if np.isfinite(n) else "    ·" for n in row)
            console.print(Text(cells, style="cyan"))
    console.print(
        "\nrow 0 is the top row; x to the right, y up, origin at the pad's centre", style="dim", highlight=False
    )
