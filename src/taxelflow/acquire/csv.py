"""`.csv`, `.tsv` and `.txt` recordings: per scan its time and a number per taxel, laid out as `Columns` says.

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


def open_csv(path: Path, sensor: Sensor | None, columns: Columns | None = None) -> Recording:
    """Open a table of text. Raises RecordingCorrupt, SensorNeeded, TaxelCountWrong, ParameterInvalid."""
    asked = (columns or Columns()).resolved()
    name = asked.delimiter or _DELIMITERS.get(path.suffix.lower(), ",")
    delimiter = {"space": None, "tab": "\t"}.get(name, name)
    first = next(_records(path, asked, delimiter), "")
    try:
        fields = [field.strip() for field in _split(first, delimiter)]
    except csv.Error as error:
        raise RecordingCorrupt(path, str(error), REMEDY) from error
    names = fields if asked.header else [str(number) for number in range(len(fields))]
    when, taxels = asked.find(path, names)
    if sensor is None:
        raise SensorNeeded(path, builtin_sensors())
    if len(taxels) != sensor.wiring.columns:
        raise TaxelCountWrong(path, len(taxels), sensor.name, sensor.wiring.columns)
    table = _Table(path, asked, delimiter, len(fields), when, np.array(taxels))
    notes = () if when is not None else (f"times are counted at {asked.rate_hz:g} Hz: the log has none",)
    return Recording(path, path.suffix.lower().lstrip("."), sensor, table.blocks, notes=notes)


def _records(path: Path, columns: Columns, delimiter: str | None) -> Iterator[str]:
    """Lines that are not blank, those of one scan joined, after those to be skipped. A last one may be short."""
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
    """A file whose layout is known: fields in a row, numbers of the columns with the time and the taxels."""

    path: Path
    columns: Columns
    delimiter: str | None
    fields: int
    when: int | None
    taxels: NDArray[np.int64]

    def blocks(self) -> Iterator[RawScans]:
        """From the start; what stands before a fault is given before it is raised."""
        records = _records(self.path, self.columns, self.delimiter)
        if self.columns.header:
            next(records, None)
        done = 0
        while chunk := list(islice(records, BLOCK_SCANS)):
            numbers = self._fast(chunk)
            fault: RecordingError | None = None
            if numbers is None:
                rows, fault = self._careful(chunk, records, done)
                numbers = np.array(rows, dtype=np.float64).reshape(len(rows), self._needed.size)
            if len(numbers):
                yield self._scans(numbers, done)
            if fault is not None:
                raise fault
            done += len(chunk)

    @property
    def _needed(self) -> NDArray[np.int64]:
        """Columns that are read: the time, if there is one, then the taxels."""
        return self.taxels if self.when is None else np.concatenate([[self.when], self.taxels])

    def _scans(self, numbers: Floats, done: int) -> RawScans:
        if self.when is None:
            rate_hz = self.columns.rate_hz or math.nan
            return RawScans(np.arange(done, done + len(numbers)) / rate_hz, numbers)
        t_s = numbers[:, 0] if self.columns.seconds == 1 else numbers[:, 0] * self.columns.seconds
        return RawScans(t_s, numbers[:, 1:])

    def _fast(self, chunk: list[str]) -> Floats | None:
        """(rows, needed) by NumPy's parser; None where something is not as simple as it takes."""
        if self.delimiter is None:
            simple = all(len(line.split()) == self.fields for line in chunk)
        else:
            simple = all(line.count(self.delimiter) == self.fields - 1 and '"' not in line for line in chunk)
        if not simple:
            return None
        try:
            numbers: Floats = np.loadtxt(
                chunk, delimiter=self.delimiter, usecols=self._needed.tolist(), comments=None, ndmin=2
            )
        except ValueError:
            return None
        return numbers

    def _careful(
        self, chunk: list[str], rest: Iterator[str], done: int
    ) -> tuple[list[list[float]], RecordingError | None]:
        """Row by row: numbers up to the first fault, and the fault."""
        rows: list[list[float]] = []
        needed = self._needed.tolist()
        for number, line in enumerate(chunk):
            scan = done + number
            try:
                row = _split(line, self.delimiter)
                if len(row) != self.fields:
                    last = number == len(chunk) - 1 and next(rest, None) is None
                    return rows, self._ragged(scan, len(row), last=last)
                rows.append([float(row[k]) if row[k].strip() else math.nan for k in needed])
            except (ValueError, csv.Error) as error:
                return rows, RecordingCorrupt(self.path, f"scan {scan}: {error}"[:300], REMEDY)
        return rows, None

    def _ragged(self, scan: int, fields: int, *, last: bool) -> RecordingError:
        seen = f"scan {scan} has {fields} columns, the {'header' if self.columns.header else 'first'} {self.fields}"
        if fields < self.fields and last:
            return RecordingTruncated(self.path, scan, None, seen)
        return RecordingCorrupt(self.path, seen, REMEDY)


def write_csv(recording: Recording, path: Path, blocks: Iterable[RawScans]) -> None:
    """Write these blocks of a recording: times and readings only, each with all its digits."""
    header = ",".join(["t_s", *(f"value{number}" for number in range(recording.sensor.wiring.columns))])
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(header + "\n")
        for block in blocks:
            for t_s, values in zip(block.t_s.tolist(), block.values.tolist(), strict=True):
                file.write(",".join(map(repr, [t_s, *values])) + "\n")
