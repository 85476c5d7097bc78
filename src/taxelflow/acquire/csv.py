"""`.csv`, `.tsv` and `.txt` recordings: time and one number per taxel for each scan, in the structure of `Columns`.

An empty or `nan` field is a missing taxel. Columns named `joint:NAME` hold joint angles in rad.
Units and taxel order are the sensor's.
"""

from __future__ import annotations

import csv
import math
import re
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from typing import IO, TYPE_CHECKING

import numpy as np

from taxelflow.acquire.base import Recording
from taxelflow.acquire.column_pads import check_pads
from taxelflow.acquire.columns import JOINT, Columns
from taxelflow.acquire.joints import joints_of
from taxelflow.acquire.limits import BLOCK_BYTES, BLOCK_SCANS
from taxelflow.acquire.metadata import check_joint_names
from taxelflow.acquire.table_remedies import REMEDY, SHOWN, fewer_taxels, for_field, for_separator
from taxelflow.acquire.times import is_iso, iso_seconds, read_times, timed
from taxelflow.errors import (
    RecordingCorrupt,
    RecordingError,
    RecordingTooLarge,
    RecordingTruncated,
    SensorNeeded,
    TaxelCountWrong,
)
from taxelflow.messages import Floats, Joints, RawScans
from taxelflow.sensors.catalogue import builtin_sensors
from taxelflow.sensors.pads import MOST_NUMBERS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from taxelflow.sensors.sensor import Sensor

_DELIMITERS = {".csv": ",", ".tsv": "\t", ".txt": "space"}
_LONGEST_LINE = 1 << 24
"""Bytes read as one line at most: bounds the memory for a file that is not text."""


def open_csv(path: Path, sensor: Sensor | None, columns: Columns | None = None) -> Recording:
    """Open a text table. Raises RecordingCorrupt, SensorNeeded, TaxelCountWrong, ParameterInvalid."""
    asked = (columns or Columns()).resolved()
    name = asked.delimiter or _DELIMITERS.get(path.suffix.lower(), ",")
    delimiter = {"space": None, "tab": "\t"}.get(name, name)
    records = _records(path, asked, delimiter)
    first = next(records, "")
    if (first.count(delimiter) if delimiter else sum(1 for _ in re.finditer(r"\S+", first))) > MOST_NUMBERS:
        raise RecordingTooLarge(path, f"its first row has more than {MOST_NUMBERS} fields", REMEDY)
    try:
        fields = [field.strip() for field in _split(first, delimiter)]
    except csv.Error as error:
        raise RecordingCorrupt(path, str(error), REMEDY) from error
    names = fields if asked.header else [str(number) for number in range(len(fields))]
    if len(fields) == 1 and sensor is not None and sensor.channel_map.columns > 1:
        _check_separator(path, asked, fields[0])
    time, taxels = asked.find(path, names)
    if sensor is None:
        raise SensorNeeded(path, builtin_sensors())
    if len(taxels) != sensor.channel_map.columns:
        wanted = sensor.channel_map.columns
        raise TaxelCountWrong(path, len(taxels), sensor.name, wanted, fewer_taxels(names, taxels, wanted))
    check_pads(path, [names[number] for number in taxels], asked, sensor)
    row = next(records, "") if asked.header else first
    iso = time is not None and _has_iso_time(row, delimiter, time)
    table = _Table(path, asked, delimiter, names, time, np.array(taxels), iso)
    joints = [number for number, name in enumerate(names) if name.startswith(JOINT)]
    joint_names = [names[number].removeprefix(JOINT) for number in joints]
    check_joint_names(path, joint_names)
    angles = replace(table, taxels=np.array(joints)).joints(joint_names)
    notes = (
        () if asked.rate_hz is None else (f"times computed from the rate of {asked.rate_hz:g} Hz: the log has none",)
    )
    return Recording(path, path.suffix.lower().lstrip("."), sensor, table.blocks, joints=angles, notes=notes)


def _check_separator(path: Path, asked: Columns, row: str) -> None:
    """Raises RecordingCorrupt if a row of one field has another separator, where no search for the time finds it."""
    untimed = asked.rate_hz is not None or asked.times is not None
    if (untimed or not asked.header) and (remedy := for_separator(row)):
        raise RecordingCorrupt(path, f"its first row has one field, {row[:SHOWN]!r}", remedy)


def _has_iso_time(row: str, delimiter: str | None, time: int) -> bool:
    try:
        fields = _split(row, delimiter)
    except csv.Error:  # the row is read again, and refused, with the others
        return False
    return time < len(fields) and is_iso(fields[time])


def _records(path: Path, columns: Columns, delimiter: str | None) -> Iterator[str]:
    """Non-blank lines after the skipped ones, those of one scan joined. The last one may be incomplete."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for _ in range(columns.skip):
            file.readline(_LONGEST_LINE)
        lines = _lines(file)
        if columns.rows_per_scan == 1:
            yield from lines
            return
        while rows := list(islice(lines, columns.rows_per_scan)):
            yield (delimiter or " ").join(row.rstrip("\n") for row in rows) + "\n"


def _lines(file: IO[str]) -> Iterator[str]:
    while line := file.readline(_LONGEST_LINE):
        if not line.isspace():
            yield line


def _split(line: str, delimiter: str | None) -> list[str]:
    return line.split() if delimiter is None else next(csv.reader([line], delimiter=delimiter), [])


class _NoNumber(Exception):
    """A field is no number, or no time."""

    def __init__(self, field: str, column: str, *, timed: bool) -> None:
        what = "time" if timed else "number"
        super().__init__(f"column {column[:SHOWN]!r} holds {field[:SHOWN]!r}, which is no {what}")
        self.remedy = for_field(field, timed=timed)


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """A file of known structure. names: of its columns. time, taxels: numbers of theirs. iso: times are ISO 8601
    dates.
    """

    path: Path
    columns: Columns
    delimiter: str | None
    names: list[str]
    time: int | None
    taxels: NDArray[np.int64]
    iso: bool

    def blocks(self) -> Iterator[RawScans]:
        """Blocks from the start; the scans before an error are delivered before it is raised."""
        if self.columns.times is None:
            return self._blocks()
        t_s = read_times(self.columns.times, self.columns.per_second)
        return timed(self._blocks, t_s, self.path, self.columns.times)

    def _blocks(self) -> Iterator[RawScans]:
        records = _records(self.path, self.columns, self.delimiter)
        if self.columns.header:
            next(records, None)
        done = 0
        rows = max(1, min(BLOCK_SCANS, BLOCK_BYTES // (64 * len(self.names))))  # 64 bytes a field as text
        while chunk := list(islice(records, rows)):
            numbers = self._parse_fast(chunk)
            error: RecordingError | None = None
            if numbers is None:
                parsed, error = self._parse_rows(chunk, records, done)
                numbers = np.array(parsed, dtype=np.float64).reshape(len(parsed), self._columns_read.size)
            if len(numbers):
                yield self._scans(numbers, done)
            if error is not None:
                raise error
            done += len(chunk)

    def joints(self, names: list[str]) -> Joints | None:
        """The taxels' columns as joint angles before an error, which reading the scans finds; None without any."""
        if not names:
            return None
        found: list[RawScans] = []
        with suppress(RecordingError):
            found.extend(self.blocks())
        if not found:
            return None
        return joints_of(
            names, np.concatenate([one.t_s for one in found]), np.concatenate([one.values for one in found])
        )

    @property
    def _columns_read(self) -> NDArray[np.int64]:
        """Numbers of the columns that are read: the time, if there is one, then the taxels."""
        return self.taxels if self.time is None else np.concatenate([[self.time], self.taxels])

    def _scans(self, numbers: Floats, done: int) -> RawScans:
        if self.time is None:
            rate_hz = self.columns.rate_hz or math.nan
            return RawScans(np.arange(done, done + len(numbers)) / rate_hz, numbers)
        exact = self.iso or self.columns.per_second == 1
        return RawScans(numbers[:, 0] if exact else numbers[:, 0] / self.columns.per_second, numbers[:, 1:])

    def _parse_fast(self, chunk: list[str]) -> Floats | None:
        """(rows, columns read) by NumPy's parser; None for rows that it cannot parse: quotes, empty fields, errors."""
        fields = len(self.names)
        if self.delimiter is None:
            simple = all(len(line.split()) == fields for line in chunk)
        else:
            simple = all(line.count(self.delimiter) == fields - 1 and '"' not in line for line in chunk)
        if not simple:
            return None
        try:
            numbers: Floats = np.loadtxt(
                chunk,
                delimiter=self.delimiter,
                usecols=self._columns_read.tolist(),
                comments=None,
                ndmin=2,
                converters={self.time: iso_seconds} if self.iso and self.time is not None else None,
            )
        except ValueError:
            return None
        return numbers

    def _parse_rows(
        self, chunk: list[str], rest: Iterator[str], done: int
    ) -> tuple[list[list[float]], RecordingError | None]:
        """Row by row: the numbers up to the first error, and that error."""
        rows: list[list[float]] = []
        columns = self._columns_read.tolist()
        for number, line in enumerate(chunk):
            scan = done + number
            try:
                row = _split(line, self.delimiter)
                if len(row) != len(self.names):
                    last = number == len(chunk) - 1 and next(rest, None) is None
                    return rows, self._wrong_length(scan, len(row), last=last)
                rows.append([self._number(row[k], k) for k in columns])
            except csv.Error as error:
                return rows, RecordingCorrupt(self.path, f"scan {scan}: {error}", REMEDY)
            except _NoNumber as error:
                return rows, RecordingCorrupt(self.path, f"scan {scan}: {error}", error.remedy)
        return rows, None

    def _number(self, field: str, column: int) -> float:
        timed = column == self.time
        try:
            if self.iso and timed:
                return iso_seconds(field)
            return float(field) if field.strip() else math.nan
        except ValueError as error:
            raise _NoNumber(field, self.names[column], timed=timed) from error

    def _wrong_length(self, scan: int, fields: int, *, last: bool) -> RecordingError:
        seen = f"scan {scan} has {fields} columns, the {'header' if self.columns.header else 'first'} {len(self.names)}"
        if fields < len(self.names) and last:
            return RecordingTruncated(self.path, scan, None, seen)
        return RecordingCorrupt(self.path, seen, REMEDY)


def write_csv(recording: Recording, path: Path, blocks: Iterable[RawScans]) -> None:
    """Write blocks of a recording: times and numbers of the source only, with all their digits."""
    header = ",".join(["t_s", *(f"value{number}" for number in range(recording.sensor.channel_map.columns))])
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(header + "\n")
        for block in blocks:
            for t_s, values in zip(block.t_s.tolist(), block.values.tolist(), strict=True):
                file.write(",".join(map(repr, [t_s, *values])) + "\n")


def left_out(recording: Recording) -> str:
    """What a csv does not hold of a recording, in words."""
    held = (recording.truth is not None, recording.masked.any(), recording.joints is not None)
    lost = ["sensor", *(name for name, own in zip(("truth", "mask", "joint angles"), held, strict=True) if own)]
    words = f"neither {', '.join(lost[:-1])} nor {lost[-1]}" if len(lost) > 1 else f"no {lost[0]}"
    return f"a csv holds {words}: give --sensor when it is read"
