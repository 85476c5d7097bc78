"""A folder with one file per pad: each pad's file is found by a glob, in the sensor file or by --columns.pads."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow.acquire.base import Reading, Recording
from taxelflow.acquire.columns import Columns
from taxelflow.acquire.csv import open_csv
from taxelflow.acquire.limits import scans_per_block
from taxelflow.acquire.npy import open_npy
from taxelflow.errors import NameUnknown, ParameterInvalid, RecordingCorrupt, RecordingTruncated, SensorNeeded
from taxelflow.messages import Floats, RawScans, cut, joined
from taxelflow.sensors.catalogue import builtin_sensors
from taxelflow.sensors.sensor import Sensor

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_OPENERS = {".csv": open_csv, ".tsv": open_csv, ".txt": open_csv, ".npy": open_npy}
_REMEDY = "give each pad `files`, a glob of its one file, in the sensor file, or --columns.pads PAD=GLOB ..."
_MOST_APART = 0.5
"""Largest difference between the times of a scan in two files, in scan periods."""


def open_pads(path: Path, sensor: Sensor | None, columns: Columns | None = None) -> Recording:
    """Open a folder. Raises SensorNeeded, RecordingCorrupt, NameUnknown, and what opening a file raises."""
    asked = (columns or Columns()).resolved()
    if sensor is None:
        raise SensorNeeded(path, builtin_sensors())
    globs = _globs(asked.pads, sensor)
    plain = replace(asked, pads=())
    parts = []
    for pad, place in zip(sensor.pads, _places(sensor), strict=True):
        file = _file(path, pad.name, globs[pad.name])
        width = (place.stop - place.start) // sensor.axes
        part = msgspec.structs.replace(
            sensor, pads=(msgspec.structs.replace(pad, start=None),), groups=(), channels=width, delay_s=(), gain=(),
            offset=0.0,
        )  # fmt: skip
        parts.append(_Part(pad.name, place, _OPENERS[file.suffix.lower()](file, part, plain)))
    reader = _Pads(path, sensor, parts)
    notes = tuple(dict.fromkeys(note for part in parts for note in part.recording.notes))
    return Recording(path, f"{len(parts)} files, one per pad", sensor, reader.blocks, notes=notes)


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """The file of one pad, and the numbers of a scan that it gives."""

    pad: str
    place: slice
    recording: Recording


def _globs(given: tuple[str, ...], sensor: Sensor) -> dict[str, str]:
    names = [pad.name for pad in sensor.pads]
    globs = {pad.name: pad.files for pad in sensor.pads}
    for one in given:
        name, equals, glob = one.partition("=")
        if not equals or not glob:
            raise ParameterInvalid("columns.pads", one, "be PAD=GLOB, as in palm=palm_*.csv")
        if name not in names:
            raise NameUnknown("pad", name, names)
        globs[name] = glob
    return globs


def _file(path: Path, pad: str, glob: str) -> Path:
    """The one file of a pad. Raises RecordingCorrupt."""
    if not glob:
        raise RecordingCorrupt(path, f"no file is named for pad {pad}", _REMEDY)
    if glob.startswith("/") or ".." in glob.split("/"):
        raise RecordingCorrupt(path, f"{glob!r} of pad {pad} leads out of the folder", _REMEDY)
    found = sorted(file for file in path.glob(glob) if file.is_file())
    if len(found) != 1:
        names = ", ".join(file.name for file in found[:5])
        raise RecordingCorrupt(path, f"{len(found)} files match {glob!r} of pad {pad}: {names or 'none'}", _REMEDY)
    if found[0].suffix.lower() not in _OPENERS:
        raise RecordingCorrupt(path, f"{found[0].name} of pad {pad} is none of {', '.join(_OPENERS)}", _REMEDY)
    return found[0]


def _places(sensor: Sensor) -> list[slice]:
    """Numbers of a scan that each pad takes: as in one file, after the previous pad or at its `start`."""
    places, end = [], 0
    for pad in sensor.pads:
        begin = end if pad.start is None else pad.start
        end = begin + (pad.channels or pad.count)
        places.append(slice(begin * sensor.axes, end * sensor.axes))
    return places


@dataclass(frozen=True, slots=True, eq=False)
class _Pads:
    """Reads the files side by side. The first pad's times are those of the scans."""

    path: Path
    sensor: Sensor
    parts: list[_Part]

    def blocks(self) -> Iterator[RawScans]:
        """Blocks from the start. Raises RecordingCorrupt if the files' times differ by half a period."""
        most = scans_per_block(self.sensor)
        columns = [_Column(part) for part in self.parts]
        done, period_s = 0, 0.0
        while True:
            for column in columns:
                column.fill(most)
            count = min(most, *(len(column) for column in columns))
            if not count:
                break
            taken = [column.take(count) for column in columns]
            t_s = taken[0].t_s
            period_s = period_s or (float(np.median(np.diff(t_s))) if count > 1 else 0.0)
            values = np.zeros((count, self.sensor.channel_map.columns))
            for part, block in zip(self.parts, taken, strict=True):
                self._check(t_s, block.t_s, part.pad, period_s, done)
                values[:, part.place] = block.values
            yield RawScans(t_s, values)
            done += count
        longer = [column.part.pad for column in columns if len(column)]
        lost = [column for column in columns if not len(column)]
        if longer or any(column.reading.loss for column in columns):
            raise RecordingTruncated(self.path, done, None, f"the file of pad {lost[0].part.pad} ends before others")

    def _check(self, t_s: Floats, own_s: Floats, pad: str, period_s: float, done: int) -> None:
        apart = np.abs(own_s - t_s) > _MOST_APART * period_s
        if period_s and apart.any():
            k = int(apart.argmax())  # the first of them
            seen = f"scan {done + k} is at {t_s[k]:.6f} s for pad {self.parts[0].pad} and at {own_s[k]:.6f} s for {pad}"
            raise RecordingCorrupt(self.path, seen, "resample the files to common times: their scans must correspond")


class _Column:
    """Scans of one file that were read and not yet taken."""

    def __init__(self, part: _Part) -> None:
        self.part = part
        self.reading: Reading = part.recording.source_blocks()
        self._held: list[RawScans] = []

    def __len__(self) -> int:
        return sum(map(len, self._held))

    def fill(self, count: int) -> None:
        """Read until `count` scans are held, or the file ends."""
        while len(self) < count and (block := next(self.reading, None)) is not None:
            self._held.append(block)

    def take(self, count: int) -> RawScans:
        """The next `count` scans."""
        block = joined(self._held)
        self._held = [cut(block, count, len(block))]
        return cut(block, 0, count)
