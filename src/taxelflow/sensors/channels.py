"""From the numbers that a source sends to the readings of taxels: order, axis, zero, polarity and gain, in one place.

A source's scan has `channels` places, each of one number or of three (x, y, z), of which the one normal to the skin is
read. A reading is  polarity (number - offset) gain,  in the sensor's unit, and grows with load.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from taxelflow.messages import Floats
from taxelflow.sensors.layout import present_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.sensors.pads import Pad

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Wiring:
    """How a source's scan becomes readings.

    columns: numbers in a source's scan. column: (taxels,), the one that a taxel is read from. gain: (taxels,). plain:
    whether a source's scan is the readings as they stand.
    """

    columns: int
    column: Indices
    offset: float
    polarity: int
    gain: Floats
    plain: bool = field(init=False)

    def __post_init__(self) -> None:
        straight = np.array_equal(self.column, np.arange(self.columns))
        alike = self.offset == 0.0 and self.polarity == 1 and bool((self.gain == 1.0).all())
        object.__setattr__(self, "plain", straight and alike)

    def readings(self, values: Floats) -> Floats:
        """(scans, columns) as the source sends them -> (scans, taxels) in the order of the layout, load positive."""
        if self.plain:
            return values
        picked: Floats = (values[:, self.column] - self.offset) * (self.polarity * self.gain)
        return picked

    def sent(self, readings: Floats) -> Floats:
        """The inverse of `readings`: (scans, taxels) -> (scans, columns); what no taxel is read from shows no load."""
        if self.plain:
            return readings
        values = np.full((len(readings), self.columns), self.offset)
        values[:, self.column] += self.polarity * readings / self.gain
        return values


def wire(pads: Sequence[Pad], channels: int | None, axes: int, axis: int) -> tuple[int, Indices]:
    """Columns of a source's scan, and the column of each taxel (taxels,).

    Raises ValueError, saying what is wrong, if a number is asked for twice or lies outside the scan.
    """
    places, behind = [], 0
    for pad in pads:
        begin = behind if pad.start is None else pad.start
        own = _places(pad)
        if own.max(initial=-1) >= (pad.channels or pad.count):
            seen = f"pad {pad.name} asks for its number {own.max()} and has {pad.channels or pad.count}, from 0"
            raise ValueError(f"{seen}: give it more channels, or another index")
        places.append(begin + own)
        behind = begin + (pad.channels or pad.count)
    place = np.concatenate(places)
    total = channels if channels is not None else max(behind, int(place.max(initial=-1)) + 1)
    numbers, times = np.unique(place, return_counts=True)
    if times.max(initial=0) > 1:
        raise ValueError(
            f"number {numbers[times.argmax()]} of the scan is read by {times.max()} taxels: mend start, index"
        )
    if len(numbers) and numbers[-1] >= total:
        raise ValueError(
            f"a taxel reads number {numbers[-1]} of a scan of {total}, from 0: mend channels, start, index"
        )
    return total * axes, place * axes + axis


def _places(pad: Pad) -> Indices:
    """(taxels,): which of the pad's numbers each taxel is."""
    if pad.index:
        return np.array(pad.index, dtype=np.int64)
    if pad.is_table:
        return np.arange(pad.count)
    number = np.arange(pad.rows * pad.cols)
    sent = number.reshape(pad.rows, pad.cols) if pad.order == "row-major" else number.reshape(pad.cols, pad.rows).T
    sent = sent[::-1] if pad.first.startswith("bottom") else sent
    sent = sent[:, ::-1] if pad.first.endswith("right") else sent
    own = sent[present_of(pad)]
    if pad.channels is not None and pad.channels > pad.count:
        return own  # missing places are sent too
    rank: Indices = np.argsort(np.argsort(own))
    return rank
