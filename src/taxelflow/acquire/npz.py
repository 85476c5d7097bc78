"""`.npz` recordings: `t` (scans,) in s and `pressure` (scans, taxels) in the sensor's unit.

Optional members: `sensor` (JSON text with the fields of a sensor file), `masked` (taxels,), `truth_pad`,
`truth_t_s`, `truth_pose` (times, 3), `parameters` (JSON text of how the scans were made). Pickled objects are never
loaded.
"""

from __future__ import annotations

import zipfile
from contextlib import ExitStack
from typing import IO, TYPE_CHECKING, Any

import msgspec
import numpy as np
from numpy.lib import format as npy

from taxelflow.acquire.base import BLOCK_SCANS, Recording, Truth
from taxelflow.errors import RecordingCorrupt, RecordingTruncated, SensorNeeded, TaxelCountWrong
from taxelflow.layout import builtin_sensors, sensor_of
from taxelflow.messages import RawScans

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from taxelflow.layout import Sensor

_REMEDY = "write it with numpy.savez(path, t=..., pressure=...), t in s (scans,), pressure (scans, taxels)"
_SMALL = 1 << 20


def open_npz(path: Path, sensor: Sensor | None) -> Recording:
    """Open an `.npz` recording. Raises RecordingCorrupt, SensorNeeded, TaxelCountWrong."""
    try:
        with zipfile.ZipFile(path) as archive:
            members = {name.removesuffix(".npy") for name in archive.namelist()}
            if not {"t", "pressure"} <= members:
                raise RecordingCorrupt(path, f"it holds {', '.join(sorted(members)) or 'nothing'}", _REMEDY)
            with archive.open("t.npy") as member:
                times, *_ = _header(member)
            with archive.open("pressure.npy") as member:
                shape, fortran, dtype = _header(member)
            extras = {name: _small(archive, name) for name in members - {"t", "pressure"}}
    except (zipfile.BadZipFile, ValueError, EOFError, OSError, NotImplementedError, RuntimeError) as error:
        raise RecordingCorrupt(path, str(error) or type(error).__name__, _REMEDY) from error
    if len(times) != 1 or len(shape) != 2 or times[0] != shape[0] or dtype.kind not in "fiu":
        raise RecordingCorrupt(path, f"t has shape {times} and pressure shape {shape} of {dtype}", _REMEDY)
    if sensor is None:
        if "sensor" not in extras:
            raise SensorNeeded(path, builtin_sensors())
        sensor = _sensor(path, str(extras["sensor"]))
    if shape[1] != sensor.layout.taxels:
        raise TaxelCountWrong(path, shape[1], sensor.name, sensor.layout.taxels)
    truth = None
    if {"truth_pad", "truth_t_s", "truth_pose"} <= members:
        truth = Truth(str(extras["truth_pad"]), np.asarray(extras["truth_t_s"]), np.asarray(extras["truth_pose"]))
    masked = extras.get("masked", np.zeros(shape[1])).astype(np.bool_)
    return Recording(path, "npz", sensor, lambda: _read(path, fortran), scans=shape[0], masked=masked, truth=truth)


def _header(member: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    version = npy.read_magic(member)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, fortran, dtype = read(member)
    return shape, fortran, dtype


def _sensor(path: Path, text: str) -> Sensor:
    try:
        return sensor_of(msgspec.json.decode(text), f"{path}:sensor")
    except msgspec.DecodeError as error:
        raise RecordingCorrupt(path, f"member sensor: {error}", _REMEDY) from error


def _small(archive: zipfile.ZipFile, name: str) -> np.ndarray[Any, Any]:
    """A member that is not scans; declared sizes are not trusted beyond what the archive really holds."""
    entry = archive.getinfo(f"{name}.npy")
    if entry.file_size > 256 * _SMALL:
        raise ValueError(f"member {name} declares {entry.file_size} bytes")
    with archive.open(entry) as member:
        array: np.ndarray[Any, Any] = npy.read_array(member, allow_pickle=False)
        return array


def _read(path: Path, fortran: bool) -> Iterator[RawScans]:
    if fortran:  # column-major on disk cannot be read scan by scan: the one case that needs the whole array
        with np.load(path, allow_pickle=False) as archive:
            yield RawScans(archive["t"].astype(np.float64), archive["pressure"].astype(np.float64, order="C"))
        return
    with ExitStack() as stack:
        archive = stack.enter_context(zipfile.ZipFile(path))
        t = stack.enter_context(archive.open("t.npy"))
        pressure = stack.enter_context(archive.open("pressure.npy"))
        _, _, t_type = _header(t)
        (scans, taxels), _, p_type = _header(pressure)
        for start in range(0, scans, BLOCK_SCANS):
            count = min(BLOCK_SCANS, scans - start)
            try:
                seconds = np.frombuffer(_exactly(t, count * t_type.itemsize), t_type)
                values = np.frombuffer(_exactly(pressure, count * taxels * p_type.itemsize), p_type)
            except (EOFError, zipfile.BadZipFile, OSError) as error:
                raise RecordingTruncated(path, start, scans, str(error)) from error
            yield RawScans(seconds.astype(np.float64), values.reshape(count, taxels).astype(np.float64))


def _exactly(member: IO[bytes], size: int) -> bytes:
    piece = member.read(size)
    if len(piece) < size:
        raise EOFError(f"{size - len(piece)} bytes are missing")
    return piece
