"""Map from the numbers that a source sends to the readings of taxels: order, axis, offset, polarity and gain.

A source's scan has `channels` places, each of one number or of three (x, y, z), of which the one normal to the skin is
read. A reading is  polarity (number - offset) gain,  in the sensor's unit, and grows with load. The other two of three
are the shear, if the sensor declares where they point: number times factor, in the same unit, from an arbitrary level.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from taxelflow.messages import Floats, RawScans
from taxelflow.sensors.pad_geometry import present_taxels

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.sensors.pads import Pad

Indices = NDArray[np.int64]

_LARGEST = 1e30
"""Largest number that a source may send, in any unit."""
_BEYOND = f"numbers beyond {_LARGEST:g} are taken as missing readings"


@dataclass(frozen=True, slots=True, eq=False)
class ChannelMap:
    """Map between a source's scans and readings.

    columns: numbers in a source's scan. column: (taxels,), the one that a taxel is read from.
    offset (one number, or (taxels,)), polarity, gain (taxels,): as in the equation at the top.
    shear_column: (taxels, 2), of the shear along x (right) and y (up) of the pad; None if it is not read. shear_factor:
    (2,), of its numbers.
    identity: whether a source's scan is the readings without any change.
    """

    columns: int
    column: Indices
    offset: Floats
    polarity: int
    gain: Floats
    shear_column: Indices | None = None
    shear_factor: Floats = field(default_factory=lambda: np.ones(2))
    identity: bool = field(init=False)

    def __post_init__(self) -> None:
        in_order = np.array_equal(self.column, np.arange(self.columns))
        unscaled = bool((self.offset == 0.0).all()) and self.polarity == 1 and bool((self.gain == 1.0).all())
        object.__setattr__(self, "identity", in_order and unscaled)

    def to_readings(self, values: Floats) -> Floats:
        """(scans, columns) as the source sends them -> (scans, taxels) in the order of the layout, load positive."""
        if self.identity:
            return values
        picked = np.take(values, self.column, axis=1)  # scan by scan in memory, as all kernels are compiled for
        readings: Floats = (picked - self.offset) * (self.polarity * self.gain)
        return readings

    def of_source(self, raw: RawScans) -> RawScans:
        """Scans in the source's columns -> readings in the order of the layout, contiguous, with shear if read.

        A number beyond any sensor's, such as a driver's sentinel for a missing one, is NaN.
        """
        sent = plausible(raw.values)
        values = np.ascontiguousarray(self.to_readings(sent))
        if self.shear_column is None:
            return RawScans(raw.t_s, values)
        return RawScans(raw.t_s, values, np.take(sent, self.shear_column, axis=1) * self.shear_factor)

    def arranged(self, images: Floats) -> Floats:
        """(scans, taxels), or (scans, taxels x 3) with x, y, z side by side, a source's numbers in the order of the
        layout -> (scans, columns) in the source's order.

        Columns of no taxel are 0.
        """
        axes = images.shape[1] // len(self.column)
        values = np.zeros((len(images), self.columns))
        values[:, ((self.column - self.column % axes)[:, np.newaxis] + np.arange(axes)).ravel()] = images
        return values

    def to_source(self, readings: Floats, shear: Floats | None = None) -> Floats:
        """Inverse of `to_readings`: (scans, taxels) -> (scans, columns), columns of no taxel at the
        common offset, 0 without one. shear: (scans, taxels, 2) of a sensor that declares it; else those columns are of
        no taxel."""
        if self.identity:
            return readings
        unused = self.offset if self.offset.ndim == 0 else 0.0
        values = np.full((len(readings), self.columns), unused)
        values[:, self.column] = self.offset + self.polarity * readings / self.gain
        if shear is not None:
            values[:, self.shear_column] = shear / self.shear_factor
        return values


def assign_columns(pads: Sequence[Pad], channels: int | None, axes: int, axis: int) -> tuple[int, Indices]:
    """Number of columns of a source's scan, and the column of each taxel (taxels,).

    channels: places in a scan, as many as the pads need if None. axes: numbers per place; axis: the one that is read.
    Raises ValueError, with the cause and after a colon the remedy, if two taxels read one number or one lies outside.
    """
    places, end = [], 0
    for pad in pads:
        begin = end if pad.start is None else pad.start
        own = _places_of(pad)
        size = pad.channels or pad.count
        if own.max(initial=-1) >= size:
            seen = f"a taxel of pad {pad.name} reads number {own.max()} of {size}, counted from 0"
            raise ValueError(f"{seen}: give the pad more channels, or the taxel another index")
        places.append(begin + own)
        end = begin + size
    place = np.concatenate(places)
    total = channels if channels is not None else max(end, int(place.max(initial=-1)) + 1)
    numbers, times = np.unique(place, return_counts=True)
    if times.max(initial=0) > 1:
        seen = f"{times.max()} taxels read number {numbers[times.argmax()]} of the scan"
        raise ValueError(f"{seen}: correct start or index")
    if len(numbers) and numbers[-1] >= total:
        seen = f"a taxel reads number {numbers[-1]} of a scan of {total}, counted from 0"
        raise ValueError(f"{seen}: correct channels, start or index")
    return total * axes, place * axes + axis


def _places_of(pad: Pad) -> Indices:
    """(taxels,): number of each taxel among those that the source sends for the pad."""
    if pad.index:
        return np.array(pad.index, dtype=np.int64)
    if pad.is_table:
        return np.arange(pad.count)
    number = np.arange(pad.rows * pad.cols)
    sent = number.reshape(pad.rows, pad.cols) if pad.order == "row-major" else number.reshape(pad.cols, pad.rows).T
    sent = sent[::-1] if pad.first.startswith("bottom") else sent
    sent = sent[:, ::-1] if pad.first.endswith("right") else sent
    own = sent[present_taxels(pad.rows, pad.cols, pad.missing)]
    if pad.channels is not None and pad.channels > pad.count:
        return own  # the source also sends a number for each missing taxel
    rank: Indices = np.argsort(np.argsort(own))
    return rank


def plausible(sent: Floats) -> Floats:
    """A source's numbers, NaN where one is beyond any sensor's."""
    absurd = np.abs(sent) > _LARGEST
    return np.where(absurd, np.nan, sent) if np.count_nonzero(absurd) else sent


def doubted_numbers(sent: Floats, notes: Sequence[str]) -> list[str]:
    """A note if a source's numbers (scans, columns) are beyond any sensor's, unless `notes` have it. Infinite ones are
    a usual word for missing.
    """
    if any(note.startswith(_BEYOND) for note in notes):
        return []
    large = _absurd(sent)
    return [f"{_BEYOND}, such as {large[0]:.4g}: check how the recording was written"] if large.size else []


def doubted_number(sent: Floats) -> str:
    """The same of a scan (columns,) of a live source, in words; empty if there is nothing to report."""
    large = _absurd(sent)
    return f"{large[0]:.4g}: {_BEYOND}" if large.size else ""


def _absurd(sent: Floats) -> Floats:
    """Finite numbers beyond any sensor's."""
    beyond = np.abs(sent) > _LARGEST
    return sent[beyond & np.isfinite(sent)] if beyond.any() else sent[:0]
