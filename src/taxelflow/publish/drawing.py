"""A sensor drawn in the terminal: its pads with the numbers of their taxels, its groups, its channels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.text import Text

from taxelflow.errors import ExtraMissing
from taxelflow.sensors.kinematics import PadKinematics

if TYPE_CHECKING:
    from taxelflow.sensors.layout import Layout
    from taxelflow.sensors.pads import Pad
    from taxelflow.sensors.sensor import Sensor


@dataclass(frozen=True, slots=True)
class _Grid:
    """Characters of a drawing."""

    cell: int = 5
    """Characters of a number."""
    widest: int = 110
    """Characters of a line at most."""
    lines: float = 0.5
    """A character is about twice as high as wide."""


_GRID = _Grid()


def draw_sensor(sensor: Sensor) -> None:
    """Each pad as its taxels' numbers where they lie, row 0 on top; a dot where a grid has none. Then the groups.

    Raises HandModelInvalid.
    """
    console, layout = Console(markup=False, highlight=False), sensor.layout
    pads = f"{len(sensor.pads)} pad{'s' if len(sensor.pads) > 1 else ''}"
    console.print(f"{sensor.name}  {layout.taxels} taxels in {pads}, {sensor.unit}", style="bold")
    if sensor.note:
        console.print(sensor.note)
    for described in filter(None, (_channels(sensor), _hand(sensor))):
        console.print(described)
    for index, pad in enumerate(sensor.pads):
        console.print(f"\n{pad.name}  {_size(pad, layout, index)}", style="bold")
        if pad.origin_m is not None:
            x, y = (1e3 * place for place in pad.origin_m)
            console.print(f"at ({x:g}, {y:g}) mm on the flattened hand, turned {np.degrees(pad.angle_rad):.0f} deg")
        if pad.note:
            console.print(pad.note, style="yellow")
        for line in _scattered(layout, index) if pad.is_table else _rows(layout, index):
            console.print(Text(line, style="cyan"), soft_wrap=True)
    for index, group in enumerate(sensor.groups, layout.pad_count):
        members = ", ".join(dict.fromkeys(patch.pad for patch in group.patches))
        taxels = layout.source[layout.of_pad(index)]
        console.print(f"\n{group.name}  group of {len(taxels)} taxels of {members}", style="bold")
        console.print(Text(" ".join(map(str, taxels)), style="cyan"))
    console.print("\nx to the right, y up; a grid has row 0 on top and its origin at its centre", style="dim")


def _size(pad: Pad, layout: Layout, index: int) -> str:
    pitch = "x".join(f"{1e3 * p:.3g}" for p in layout.pitch_m[index])
    if not pad.is_table:
        return f"{pad.rows} rows x {pad.cols} cols, pitch {pitch} mm"
    curved = f"; laid flat, neighbours within {100 * layout.stretch[index]:.1f} %" if len(pad.taxels[0]) > 2 else ""
    return f"{pad.count} taxels, {1e3 * layout.pitch_m[index, 0]:.3g} mm apart{curved}"


def _hand(sensor: Sensor) -> str:
    """The joints that place its pads. Raises HandModelInvalid."""
    if sensor.hand is None or all(pad.link is None for pad in sensor.pads):
        return ""
    try:
        joints = PadKinematics(sensor).joints
    except ExtraMissing as error:
        return f"the hand's model is not checked: {error}"
    return f"pads on links of a hand with the joints {', '.join(joints)}" if joints else "pads on links without joints"


def _channels(sensor: Sensor) -> str:
    """What the source sends, where it is not the readings as they stand."""
    channels = sensor.channel_map
    if channels.identity:
        return ""
    parts = [f"the source sends {channels.columns} numbers a scan"]
    if sensor.axes > 1:
        parts.append(f"{sensor.axes} per taxel, of which {sensor.normal} is normal to the skin")
    offset = channels.offset
    if offset.any() or sensor.polarity < 0:
        idle = f"{offset:g}" if offset.ndim == 0 else f"{offset.min():g} to {offset.max():g}"
        parts.append(f"{idle} without load, {'less' if sensor.polarity < 0 else 'more'} under load")
    if bool(np.any(np.diff(channels.column) < 0)):
        parts.append("in an order of its own")
    if sensor.gain:
        parts.append("with a gain for each taxel")
    return ", ".join(parts)


def _rows(layout: Layout, pad: int) -> list[str]:
    numbers = np.arange(layout.taxels, dtype=np.float64)
    image = layout.grid(pad, numbers)
    return ["".join(f"{n:{_GRID.cell}.0f}" if np.isfinite(n) else "·".rjust(_GRID.cell) for n in row) for row in image]


def _scattered(layout: Layout, pad: int) -> list[str]:
    """Numbers where the taxels lie, drawn as large as they need not to run into each other; else a list of places."""
    own = layout.of_pad(pad)
    x, y = layout.x_m[own] - layout.x_m[own].min(), layout.y_m[own].max() - layout.y_m[own]
    scale = _GRID.cell / layout.pitch_m[pad, 0]
    while scale * float(x.max()) + _GRID.cell <= _GRID.widest:
        col = np.round(scale * x).astype(int)
        line = np.round(_GRID.lines * scale * y).astype(int)
        if _clear(line, col):
            return _canvas(line, col, own.start)
        scale *= 1.1
    return [
        f"{own.start + k}: ({1e3 * a:.1f}, {1e3 * b:.1f}) mm"
        for k, (a, b) in enumerate(zip(layout.x_m[own], layout.y_m[own], strict=True))
    ]


def _clear(line: np.ndarray, col: np.ndarray) -> bool:
    """Whether no two numbers touch."""
    order = np.lexsort((col, line))
    same = np.diff(line[order]) == 0
    return not bool((same & (np.diff(col[order]) < _GRID.cell)).any())


def _canvas(line: np.ndarray, col: np.ndarray, first: int) -> list[str]:
    canvas = [[" "] * (int(col.max()) + _GRID.cell) for _ in range(int(line.max()) + 1)]
    for number, (row, begin) in enumerate(zip(line.tolist(), col.tolist(), strict=True), first):
        canvas[row][begin : begin + _GRID.cell] = f"{number:{_GRID.cell}d}"
    return ["".join(row).rstrip() for row in canvas]
