"""`.npz` recordings: `t` (scans,) in s and `pressure` (scans, taxels) in the sensor's unit, as its source
sends it (`wiring`).

Optional members: `sensor` (JSON text with the fields of a sensor file), `masked` (taxels,), `truth_pad` (a pad, or
`hand`), `truth_t_s`, `truth_pose` (times, 3), `truth_slipping` (times,), `truth_second` (times, 3). The rig also writes
`parameters` (JSON text of how the scans were made), which is not read back.
Pickled objects are never loaded.
"""

from __future__ import annotations

import math
import zipfile
import zlib
from contextlib import ExitStack
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Any

import msgspec
import numpy as np
from numpy.lib import format as npy

from taxelflow.acquire.base import BLOCK_SCANS, Recording
from taxelflow.acquire.metadata import checked_truth
from taxelflow.errors import RecordingCorrupt, RecordingTruncated, SensorNeeded, TaxelCountWrong
from taxelflow.messages import Bools, RawScans
from taxelflow.sensors.catalogue import builtin_sensors
from taxelflow.sensors.sensor import sensor_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from taxelflow.acquire.base import Truth
    from taxelflow.sensors.sensor import Sensor

_REMEDY = "write it with numpy.savez(path, t=..., pressure=...), t in s (scans,), pressure (scans, taxels)"
_DAMAGE = (zipfile.BadZipFile, zlib.error, EOFError, OSError, NotImplementedError, RuntimeError, ValueError, KeyError)
_MOST_EXTRA_BYTES = 1 << 28


@dataclass(frozen=True, slots=True)
class _Header:
    """What a member declares of its array."""

    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype[Any]


def open_npz(path: Path, sensor: Sensor | None) -> Recording:
    """Open an `.npz` recording. Raises RecordingCorrupt, SensorNeeded, TaxelCountWrong, SensorFileInvalid."""
    try:
        with zipfile.ZipFile(path) as archive:
            members = {name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")}
            if not {"t", "pressure"} <= members:
                raise RecordingCorrupt(path, f"it holds {', '.join(sorted(members)) or 'nothing'}", _REMEDY)
            with archive.open("t.npy") as member:
                times = _header(member)
            with archive.open("pressure.npy") as member:
                pressure = _header(member)
            extras = {name: _extra(archive, name) for name in _EXTRAS & members}
    except _DAMAGE as error:
        raise RecordingCorrupt(path, str(error) or type(error).__name__, _REMEDY) from error
    if (
        len(times.shape) != 1
        or len(pressure.shape) != 2
        or times.shape[0] != pressure.shape[0]
        or times.dtype.kind not in "fiu"
        or pressure.dtype.kind not in "fiu"
    ):
        seen = f"t is {times.dtype} {times.shape} and pressure {pressure.dtype} {pressure.shape}"
        raise RecordingCorrupt(path, seen, _REMEDY)
    if sensor is None:
        if "sensor" not in extras:
            raise SensorNeeded(path, builtin_sensors())
        sensor = _sensor(path, str(extras["sensor"]))
    scans, columns = pressure.shape
    if columns != sensor.wiring.columns:
        raise TaxelCountWrong(path, columns, sensor.name, sensor.wiring.columns)
    return Recording(
        path,
        "npz",
        sensor,
        lambda: _read(path, times, pressure),
        scans=scans,
        masked=_mask(path, extras, sensor.layout.taxels),
        truth=_truth(path, extras, sensor),
    )


_TRUTH = {"truth_pad", "truth_t_s", "truth_pose", "truth_slipping", "truth_second"}
_EXTRAS = {"sensor", "masked", *_TRUTH}


def _header(member: IO[bytes]) -> _Header:
    version = npy.read_magic(member)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    return _Header(*read(member))


def _extra(archive: zipfile.ZipFile, name: str) -> np.ndarray[Any, Any]:
    """A member that is not scans; what it declares is believed only as far as the archive holds it."""
    entry = archive.getinfo(f"{name}.npy")
    with archive.open(entry) as member:
        header = _header(member)
    if math.prod(header.shape) * header.dtype.itemsize > min(entry.file_size, _MOST_EXTRA_BYTES):
        raise ValueError(f"member {name} declares {header.shape} of {header.dtype} in {entry.file_size} bytes")
    with archive.open(entry) as member:
        array: np.ndarray[Any, Any] = npy.read_array(member, allow_pickle=False)
        return array


def _sensor(path: Path, text: str) -> Sensor:
    try:
        return sensor_of(msgspec.json.decode(text), f"{path}:sensor")
    except msgspec.DecodeError as error:
        raise RecordingCorrupt(path, f"member sensor: {error}", _REMEDY) from error


def _mask(path: Path, extras: dict[str, np.ndarray[Any, Any]], taxels: int) -> Bools:
    masked = extras.get("masked", np.zeros(taxels, dtype=np.bool_))
    if masked.shape != (taxels,) or masked.dtype.kind not in "biu":
        seen = f"member masked is {masked.dtype} {masked.shape}"
        raise RecordingCorrupt(path, seen, f"it holds a flag for each of the {taxels} taxels")
    return masked.astype(np.bool_)


def _truth(path: Path, extras: dict[str, np.ndarray[Any, Any]], sensor: Sensor) -> Truth | None:
    if not _TRUTH & extras.keys():
        return None
    t_s, pose = extras.get("truth_t_s", np.zeros(0)), extras.get("truth_pose", np.zeros(0))
    more = extras.get("truth_slipping"), extras.get("truth_second")
    return checked_truth(path, sensor, str(extras.get("truth_pad", "")), t_s, pose, *more)


def _read(path: Path, times: _Header, pressure: _Header) -> Iterator[RawScans]:
    scans, taxels = pressure.shape
    start = 0
    try:
        if pressure.fortran:  # column-major on disk cannot be read scan by scan: the one case that needs it all
            yield _whole(path, times, pressure)
            return
        with ExitStack() as stack:
            archive = stack.enter_context(zipfile.ZipFile(path))
            t = stack.enter_context(archive.open("t.npy"))
            p = stack.enter_context(archive.open("pressure.npy"))
            _header(t), _header(p)
            while start < scans:
                count = min(BLOCK_SCANS, scans - start)
                seconds = np.frombuffer(_exactly(t, count * times.dtype.itemsize), times.dtype)
                values = np.frombuffer(_exactly(p, count * taxels * pressure.dtype.itemsize), pressure.dtype)
                yield RawScans(seconds.astype(np.float64), values.reshape(count, taxels).astype(np.float64))
                start += count
    except _DAMAGE as error:
        raise RecordingTruncated(path, start, scans, str(error) or type(error).__name__) from error


def _whole(path: Path, times: _Header, pressure: _Header) -> RawScans:
    with zipfile.ZipFile(path) as archive:
        for name, header in (("t", times), ("pressure", pressure)):
            held = archive.getinfo(f"{name}.npy").file_size
            if math.prod(header.shape) * header.dtype.itemsize > held:
                raise EOFError(f"member {name} declares {header.shape} of {header.dtype} in {held} bytes")
        with archive.open("t.npy") as t, archive.open("pressure.npy") as p:
            seconds, values = npy.read_array(t, allow_pickle=False), npy.read_array(p, allow_pickle=False)
    return RawScans(seconds.astype(np.float64), np.ascontiguousarray(values, dtype=np.float64))


def _exactly(member: IO[bytes], size: int) -> bytes:
    piece = member.read(size)
    if len(piece) < size:
        raise EOFError(f"{size - len(piece)} bytes are missing")
    return piece


def write_npz(recording: Recording, path: Path, blocks: Iterable[RawScans], **members: str) -> None:
    """Write these blocks of a recording, with sensor, masked taxels and truth; further members are texts.

    Scans go to the file block by block. As an array's header tells its length, the recording is read once more, before,
    for its times.
    """
    t_s = np.concatenate([block.t_s for block in recording.blocks()])
    arrays: dict[str, Any] = {"t": t_s, "sensor": msgspec.json.encode(recording.sensor).decode(), **members}
    if recording.masked.any():
        arrays["masked"] = recording.masked
    truth = recording.truth
    if truth is not None:
        arrays |= {"truth_pad": truth.pad, "truth_t_s": truth.t_s, "truth_pose": truth.pose}
        if truth.slipping is not None:
            arrays["truth_slipping"] = truth.slipping
        if truth.second is not None:
            arrays["truth_second"] = truth.second
    header = {"descr": "<f8", "fortran_order": False, "shape": (len(t_s), recording.sensor.wiring.columns)}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                npy.write_array(member, np.asanyarray(array), allow_pickle=False)
        with archive.open("pressure.npy", "w", force_zip64=True) as member:
            npy.write_array_header_1_0(member, header)
            for block in blocks:
                member.write(np.ascontiguousarray(block.values, dtype="<f8").tobytes())
