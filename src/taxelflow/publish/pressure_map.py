"""Pads as digits on colour: the most that each taxel has read, and which taxels are faulty."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from rich.columns import Columns
from rich.text import Text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType

_RAMP = ("#30123b", "#4145ab", "#4675ed", "#39a2fc", "#1bcfd4", "#24eca6", "#61fc6c", "#a4fc3c", "#d1e834", "#f3c63a")
"""Ten steps of a colour map, dark to light."""
_DARK = 4
"""Steps of the scale of colours on which digits are white."""
_WIDE = 40
"""Columns up to which there is a space between two taxels."""
MEANINGS = {".": "never loaded", "F": "full scale", "!": "faulty", "x": "masked"}


class PadPicture(Protocol):
    """A pad with the largest reading of each place of its picture, and a mark or a space for each."""

    @property
    def name(self) -> str:
        """Of the pad."""
        ...

    @property
    def cols(self) -> int:
        """Columns of the picture."""
        ...

    @property
    def picture(self) -> Sequence[Sequence[float | None]]:
        """(rows, cols), in the sensor's unit; None where no taxel is."""
        ...

    @property
    def marks(self) -> Sequence[str]:
        """A letter per place, row by row."""
        ...


def pressure_maps(pads: Sequence[PadPicture], unit: str) -> tuple[RenderableType, str]:
    """Pads of a `Checkup` side by side, and what their digits and letters mean."""
    largest = max((value for pad in pads for row in pad.picture for value in row if value is not None), default=0.0)
    maps = Columns([_map(pad, largest) for pad in pads], padding=(1, 3))
    marks = "".join(row for pad in pads for row in pad.marks)
    used = [f"{mark} {meaning}" for mark, meaning in MEANINGS.items() if mark in marks]
    return maps, "; ".join([f"digits: the most ever read, in tenths of {largest:.4g} {unit}", *used])


def _map(pad: PadPicture, largest: float) -> Text:
    text = Text(pad.name, style="bold")
    gap = " " if pad.cols <= _WIDE else ""
    for marks, values in zip(pad.marks, pad.picture, strict=True):
        text.append("\n")
        for mark, value in zip(marks, values, strict=True):
            if mark == " ":
                text.append(" " + gap, style="not bold")
            elif mark in "!xF":
                text.append(mark + gap, style="bold white on red" if mark != "x" else "dim not bold")
            elif mark == "." or value is None:
                text.append("." + gap, style="dim not bold")
            else:
                step = min(max(int(10.0 * value / largest), 0), 9)
                text.append(f"{step}{gap}", style=f"not bold {'white' if step < _DARK else 'black'} on {_RAMP[step]}")
    return text
