"""`.h5` recordings: datasets `t` in s (scans,) and `pressure` (scans, ...), or others by --columns.time and .taxels.

A dataset or attribute `sensor` with JSON text is the sensor, as in `.npz`.
"""

from __future__ import annotations

import math
from contextlib import contextmanager
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Any

from taxelflow.acquire.arrays import Stored, array_recording
from taxelflow.acquire.columns import Columns
from taxelflow.acquire.hdf5_text import text_beside
from taxelflow.acquire.limits import MOST_ARRAY_BYTES, check_expansion
from taxelflow.acquire.metadata import sensor_in_text
from taxelflow.errors import ExtraMissing, RecordingCorrupt, RecordingTooLarge

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from taxelflow.acquire.base import Recording
    from taxelflow.sensors.sensor import Sensor

_TIMES, _SCANS = ("t", Columns.time), "pressure"
_MOST_TEXT = 1 << 22
"""Bytes of a text in the file at most."""
_REMEDY = "store datasets t (scans,) in s and pressure (scans, taxels), or name others by --columns.time and .taxels"


def open_hdf5(path: Path, sensor: Sensor | None, columns: Columns | None = None) -> Recording:
    """Open an HDF5 file. Raises ExtraMissing, RecordingCorrupt, RecordingTooLarge, SensorNeeded, TaxelCountWrong."""
    library = _library()
    asked = (columns or Columns()).resolved()
    name = asked.taxels[0] if asked.taxels != Columns.taxels else _SCANS
    try:
        with library.File(path, "r") as file:
            values = _dataset(file, path, name)
            times = [time for time in {asked.time, *_TIMES} if _is_dataset(file, time)]
            time = asked.time if asked.time in times else min(times, default=None)
            if time is not None and _dataset(file, path, time).shape != values.shape[:1]:
                seen = f"dataset {time} has shape {file[time].shape} and {name} {values.shape}"
                raise RecordingCorrupt(path, seen, _REMEDY)
            shape, kind = values.shape, values.dtype
            text = _sensor_text(file, path) if sensor is None else None
    except (OSError, KeyError, ValueError, RuntimeError) as error:
        raise RecordingCorrupt(path, " ".join(str(error).split()), _REMEDY) from error
    if asked.times is not None or asked.rate_hz is not None:
        time = None
    if text is not None:
        sensor = sensor_in_text(path, text)

    @contextmanager
    def opened() -> Iterator[tuple[Any, Any]]:
        with library.File(path, "r") as file:
            yield file[name], None if time is None else file[time]

    stored = Stored(path, "h5", shape, kind, time is not None, opened)
    return array_recording(stored, sensor, replace(asked, taxels=Columns.taxels))


def _is_dataset(file: Any, name: str) -> bool:
    return name in file and isinstance(file.get(name, getlink=True), _library().HardLink)


def _dataset(file: Any, path: Path, name: str) -> Any:
    """A dataset that is stored in this file, of a size that the file explains. Raises RecordingCorrupt, ..TooLarge."""
    library = _library()
    if not _is_dataset(file, name) or not isinstance(file[name], library.Dataset):
        raise RecordingCorrupt(path, f"no dataset {name} in it: it holds {', '.join(list(file)[:20])}", _REMEDY)
    found = file[name]
    if found.is_virtual or found.external:
        raise RecordingCorrupt(path, f"dataset {name} is stored in other files", "copy it with h5repack")
    if found.dtype.kind not in "fiu" or not found.shape:
        raise RecordingCorrupt(path, f"dataset {name} is {found.dtype} {found.shape}", _REMEDY)
    check_expansion(path, math.prod(found.shape) * found.dtype.itemsize)
    chunk = math.prod(found.chunks or (1,)) * found.dtype.itemsize
    if chunk > MOST_ARRAY_BYTES:
        seen = f"dataset {name} has chunks of {chunk} bytes"
        raise RecordingTooLarge(path, seen, "write it with chunks of 1 MB (h5repack -l CHUNK=...)")
    return found


def _sensor_text(file: Any, path: Path) -> str | None:
    """The JSON text of the sensor, None if there is none. Raises RecordingCorrupt."""
    if "sensor" in file.attrs:
        place, stored = "attribute", file.attrs.get_id("sensor")
    elif _is_dataset(file, "sensor"):
        place, stored = "dataset", file["sensor"]
    else:
        return None
    kind, shape = stored.dtype, stored.shape or ()
    text = _library().check_string_dtype(kind)
    if text is not None and text.length is None and not shape:
        return text_beside(path, place, "sensor")
    if kind.hasobject or math.prod(shape) * kind.itemsize > _MOST_TEXT:
        raise RecordingCorrupt(path, f"{place} sensor is {kind} {shape}, not one text of at most 4 MB", _REMEDY)
    found = file.attrs["sensor"] if place == "attribute" else file["sensor"][()]
    return found.decode(errors="replace") if isinstance(found, bytes) else str(found)


def _library() -> Any:
    try:
        return import_module("h5py")
    except ModuleNotFoundError as error:
        raise ExtraMissing("h5", "h5py") from error
