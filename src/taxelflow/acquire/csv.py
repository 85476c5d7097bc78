"""`.csv`, `.tsv` and `.txt` recordings: time and one number per taxel for each scan, in the structure of `Columns`.

An empty or `nan` field is a missing taxel. Units and taxel order are the sensor's.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from itertools import islice
from typing import IO, TYPE_CHECKING

import numpy as np

from taxelflow.acquire.base import BLOCK_SCANS, Recording
from taxelflow.acquire.columns import REMEDY, Columns
from taxelflow.errors import RecordingCorrupt, RecordingError, RecordingTruncated, SensorNeeded, TaxelCountWrong
from taxelflow.messages import Floats, RawScans
from taxelflow.sensors.catalogue import builtin_sensors

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
    first = next(_records(path, asked, delimiter), "")
    try:
        fields = [field.strip() for field in _split(first, delimiter)]
    except csv.Error as error:
        raise RecordingCorrupt(path, str(error), REMEDY) from error
    names = fields if asked.header else [str(number) for number in range(len(fields))]
    time, taxels = asked.find(path, names)
    if sensor is None:
        raise SensorNeeded(path, builtin_sensors())
    if len(taxels) != sensor.channel_map.columns:
        raise TaxelCountWrong(path, len(taxels), sensor.name, sensor.channel_map.columns)
    table = _Table(path, asked, delimiter, len(fields), time, np.array(taxels))
    notes = () if time is not None else (f"times computed from the rate of {asked.rate_hz:g} Hz: the log has none",)
    return Recording(path, path.suffix.lower().lstrip("."), sensor, table.blocks, notes=notes)


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


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """A file of known structure. fields: number in a row. time, taxels: numbers of their columns."""

    path: Path
    columns: Columns
    delimiter: str | None
    fields: int
    time: int | None
    taxels: NDArray[np.int64]

    def blocks(self) -> Iterator[RawScans]:
        """Blocks from the start; the scans before an error are delivered before it is raised."""
        records = _records(self.path, self.columns, self.delimiter)
        if self.columns.header:
            next(records, None)
        done = 0
        while chunk := list(islice(records, BLOCK_SCANS)):
            numbers = self._parse_fast(chunk)
            error: RecordingError | None = None
            if numbers is None:
                rows, error = self._parse_rows(chunk, records, done)
                numbers = np.array(rows, dtype=np.float64).reshape(len(rows), self._columns_read.size)
            if len(numbers):
                yield self._scans(numbers, done)
            if error is not None:
                raise error
            done += len(chunk)

    @property
    def _columns_read(self) -> NDArray[np.int64]:
        """Numbers of the columns that are read: the time, if there is one, then the taxels."""
        return self.taxels if self.time is None else np.concatenate([[self.time], self.taxels])

    def _scans(self, numbers: Floats, done: int) -> RawScans:
        if self.time is None:
            rate_hz = self.columns.rate_hz or math.nan
            return RawScans(np.arange(done, done + len(numbers)) / rate_hz, numbers)
        t_s = numbers[:, 0] if self.columns.seconds == 1 else numbers[:, 0] * self.columns.seconds
        return RawScans(t_s, numbers[:, 1:])

    def _parse_fast(self, chunk: list[str]) -> Floats | None:
        """(rows, columns read) by NumPy's parser; None for rows that it cannot parse: quotes, empty fields, errors."""
        if self.delimiter is None:
            simple = all(len(line.split()) == self.fields for line in chunk)
        else:
            simple = all(line.count(self.delimiter) == self.fields - 1 and '"' not in line for line in chunk)
        if not simple:
            return None
        try:
            numbers: Floats = np.loadtxt(
                chunk, delimiter=self.delimiter, usecols=self._columns_read.tolist(), comments=None, ndmin=2
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
                if len(row) != self.fields:
                    last = number == len(chunk) - 1 and next(rest, None) is None
                    return rows, self._wrong_length(scan, len(row), last=last)
                rows.append([float(row[k]) if row[k].strip() else math.nan for k in columns])
            except (ValueError, csv.Error) as error:
                return rows, RecordingCorrupt(self.path, f"scan {scan}: {error}"[:300], REMEDY)
        return rows, None

    def _wrong_length(self, scan: int, fields: int, *, last: bool) -> RecordingError:
        seen = f"scan {scan} has {fields} columns, the {'header' if self.columns.header else 'first'} {self.fields}"
        if fields < self.fields and last:
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
