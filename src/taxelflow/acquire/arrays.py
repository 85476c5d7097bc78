"""Arrays as recordings: scans (scans, ...) in one array, times in another, in a column, in a file, or by the rate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.acquire.base import Recording
from taxelflow.acquire.limits import scans_per_block
from taxelflow.acquire.times import read_times, timed
from taxelflow.errors import RecordingCorrupt, RecordingTruncated, SensorNeeded, TaxelCountWrong
from taxelflow.messages import Floats, RawScans
from taxelflow.sensors.catalogue import builtin_sensors
from taxelflow.sensors.pads import MOST_NUMBERS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from contextlib import AbstractContextManager
    from pathlib import Path

    from taxelflow.acquire.columns import Columns
    from taxelflow.sensors.sensor import Sensor

NO_TIMES = "give the rate by --columns.rate-hz, or a file with the times by --columns.times"


@dataclass(frozen=True, slots=True)
class Stored:
    """Scans in a file. open: gives their array (scans, ...), and that of their times (scans,) or None.

    shape, kind: of the array of the scans. timed: whether it has an array of times.
    """

    path: Path
    format: str
    shape: tuple[int, ...]
    kind: np.dtype[Any]
    timed: bool
    open: Callable[[], AbstractContextManager[tuple[Any, Any]]]


def array_recording(stored: Stored, sensor: Sensor | None, asked: Columns) -> Recording:
    """A recording of stored scans. Raises RecordingCorrupt, SensorNeeded, TaxelCountWrong."""
    path = stored.path
    if len(stored.shape) < 2 or stored.kind.kind not in "fiu":
        seen = f"its scans are {stored.kind} {stored.shape}"
        raise RecordingCorrupt(path, seen, "store numbers of shape (scans, taxels) or (scans, rows, cols)")
    scans, width = stored.shape[0], math.prod(stored.shape[1:])
    if width > MOST_NUMBERS:
        raise RecordingCorrupt(path, f"a scan has {width} numbers", f"it may have {MOST_NUMBERS}")
    elsewhere = stored.timed or asked.rate_hz is not None or asked.times is not None
    if not elsewhere and not asked.time.isdecimal():
        raise RecordingCorrupt(path, "it holds no times", NO_TIMES)
    time, taxels = asked.find(path, [str(number) for number in range(width)], timed=stored.timed)
    if sensor is None:
        raise SensorNeeded(path, builtin_sensors())
    images = stored.shape[1:] in sensor.images and len(taxels) == width
    columns = sensor.channel_map.columns
    if not images and len(taxels) != columns:
        raise TaxelCountWrong(path, len(taxels), sensor.name, columns)
    image = _without_ones(stored.shape[1:])
    side_by_side = sensor.axes == 3 and image == (columns // 3, 3)
    if len(image) > 1 and sensor.images and not side_by_side and image not in map(_without_ones, sensor.images):
        seen = f"its scans have shape {image}, and the grid of sensor {sensor.name} {sensor.layout.full_grid}"
        raise RecordingCorrupt(path, seen, "give (scans, rows, cols) with row 0 on top, or (scans, taxels)")
    arranged = sensor.channel_map.arranged if images else None
    reader = _Reader(stored, asked, time, taxels, scans_per_block(sensor), arranged)
    notes = () if asked.rate_hz is None else (f"times computed from the rate of {asked.rate_hz:g} Hz",)
    return Recording(path, stored.format, sensor, reader.blocks, scans=scans, notes=notes)


def _without_ones(shape: tuple[int, ...]) -> tuple[int, ...]:
    """A shape without axes of length 1."""
    return tuple(size for size in shape if size > 1)


@dataclass(frozen=True, slots=True)
class _Reader:
    """time: column with the times, if any. taxels: columns of the taxels. block: scans of a block. arranged: images as
    rows of the layout -> numbers in the source's order; None where they are in it.
    """

    stored: Stored
    asked: Columns
    time: int | None
    taxels: list[int]
    block: int
    arranged: Callable[[Floats], Floats] | None

    def blocks(self) -> Iterator[RawScans]:
        """Blocks from the start."""
        if self.asked.times is None:
            return self._blocks()
        t_s = read_times(self.asked.times, self.asked.per_second)
        return timed(self._blocks, t_s, self.stored.path, self.asked.times)

    def _blocks(self) -> Iterator[RawScans]:
        scans = self.stored.shape[0]
        start = 0
        try:
            with self.stored.open() as (values, times):
                for start in range(0, scans, self.block):
                    stop = min(start + self.block, scans)
                    rows = np.asarray(values[start:stop], dtype=np.float64).reshape(stop - start, -1)
                    numbers = rows[:, self.taxels] if self.arranged is None else self.arranged(rows)
                    yield RawScans(self._times(rows, times, start, stop), numbers)
        except (OSError, ValueError, RuntimeError) as error:
            raise RecordingTruncated(self.stored.path, start, scans, " ".join(str(error).split())) from error

    def _times(self, rows: Any, times: Any, start: int, stop: int) -> Any:
        if self.time is not None:
            return rows[:, self.time] / self.asked.per_second
        if times is not None and self.asked.rate_hz is None:
            return np.asarray(times[start:stop], dtype=np.float64) / self.asked.per_second
        return np.arange(start, stop) / (self.asked.rate_hz or math.nan)
