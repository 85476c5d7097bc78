"""`.csv` recordings: a header row `t_s,...`, then per scan its time in s and a column per taxel.

An empty or `nan` field is a missing taxel. Units and taxel order are the sensor's.
"""

from __future__ import annotations

import csv
import math
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.acquire.base import BLOCK_SCANS, Recording
from taxelflow.catalogue import builtin_sensors
from taxelflow.errors import (
    RecordingCorrupt,
    RecordingError,
    RecordingTruncated,
    SensorNeeded,
    TaxelCountWrong,
)
from taxelflow.messages import RawScans

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from taxelflow.sensor import Sensor

_REMEDY = "a recording has a header row `t_s,...` and then one row per scan: time in s, a number per taxel"


def open_csv(path: Path, sensor: Sensor | None) -> Recording:
    """Open a `.csv` recording. Raises RecordingCorrupt, SensorNeeded, TaxelCountWrong."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            header = next(csv.reader(file), [])
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordingCorrupt(path, str(error), _REMEDY) from error
    if not header or header[0].strip() != "t_s":
        raise RecordingCorrupt(path, f"its header starts with {','.join(header[:3])!r}", _REMEDY)
    if sensor is None:
        raise SensorNeeded(path, builtin_sensors())
    if len(header) - 1 != sensor.wiring.columns:
        raise TaxelCountWrong(path, len(header) - 1, sensor.name, sensor.wiring.columns)
    return Recording(path, "csv", sensor, lambda: _read(path, len(header)))


def _read(path: Path, columns: int) -> Iterator[RawScans]:
    block: list[list[float]] = []
    try:
        for row in _rows(path, columns):
            block.append(row)
            if len(block) == BLOCK_SCANS:
                yield _scans(block)
                block = []
    except RecordingError:
        if block:
            yield _scans(block)
        raise
    if block:
        yield _scans(block)


def _scans(block: list[list[float]]) -> RawScans:
    table = np.array(block)
    return RawScans(table[:, 0], table[:, 1:])


def _rows(path: Path, columns: int) -> Iterator[list[float]]:
    scan = 0
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = csv.reader(file)
        next(rows)
        try:
            for row in filter(None, rows):
                if len(row) != columns:
                    seen = f"scan {scan} has {len(row)} columns, the header {columns}"
                    if len(row) < columns and not any(rows):
                        raise RecordingTruncated(path, scan, None, seen)
                    raise RecordingCorrupt(path, seen, _REMEDY)
                yield [float(field) if field.strip() else math.nan for field in row]
                scan += 1
        except (ValueError, csv.Error) as error:
            raise RecordingCorrupt(path, f"scan {scan}: {error}", _REMEDY) from error
