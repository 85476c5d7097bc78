"""`.npz` recordings: `t` (scans,) in s and `pressure` (scans, columns) in the sensor's unit, in the columns of its
source (`channels`); or (scans, rows, cols) of a sensor with one full grid, row 0 on top.

Optional members: `sensor` (JSON text with the fields of a sensor file), `masked` (taxels,), `truth_pad` (a pad, or
`hand`), `truth_t_s`, `truth_pose` (times, 3), `truth_slipping` (times,), `truth_second` (times, 3);
`joint_names` (joints,), `joint_t_s` (n,) in s and `joint_angles` (n, joints) in rad. The rig also writes
`parameters` (JSON text of its scenario), which is not read back.
Pickled objects are never loaded.
"""

from __future__ import annotations

import math
import tokenize
import zipfile
import zlib
from contextlib import ExitStack
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Any

import msgspec
import numpy as np
from numpy.lib import format as npy

from taxelflow.acquire.base import Recording, Truth
from taxelflow.acquire.limits import MOST_ARRAY_BYTES, check_expansion, scans_per_block
from taxelflow.acquire.metadata import checked_joints, checked_truth, sensor_in_text
from taxelflow.errors import (
    RecordingCorrupt,
    RecordingTooLarge,
    RecordingTruncated,
    SensorNeeded,
    TaxelCountWrong,
)
from taxelflow.messages import Bools, Joints, RawScans
from taxelflow.sensors.catalogue import builtin_sensors

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from taxelflow.sensors.sensor import Sensor

_REMEDY = "write it with numpy.savez(path, t=..., pressure=...), t in s (scans,), pressure (scans, taxels)"
_DAMAGE = (zipfile.BadZipFile, zlib.error, EOFError, OSError, NotImplementedError, RuntimeError, ValueError, KeyError)
_PACKED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""How NumPy writes members; of the others `zipfile` unpacks any amount at once."""
_TRUTH = {"truth_pad", "truth_t_s", "truth_pose", "truth_slipping", "truth_second"}
_JOINTS = {"joint_names", "joint_t_s", "joint_angles"}
_EXTRAS = {"sensor", "masked", *_TRUTH, *_JOINTS}

Members = dict[str, np.ndarray[Any, Any]]


@dataclass(frozen=True, slots=True)
class _Header:
    """Declaration of a member's array."""

    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype[Any]

    @property
    def size_bytes(self) -> int:
        """Bytes of the array's data."""
        return math.prod(self.shape) * self.dtype.itemsize

    def __str__(self) -> str:
        return f"{self.dtype} {self.shape}"


def open_npz(path: Path, sensor: Sensor | None) -> Recording:
    """Open an `.npz` recording. Raises RecordingCorrupt, SensorNeeded, TaxelCountWrong, SensorFileInvalid."""
    times, pressure, extras = _contents(path)
    if sensor is None:
        if "sensor" not in extras:
            raise SensorNeeded(path, builtin_sensors())
        sensor = sensor_in_text(path, str(extras["sensor"]))
    scans, *rest = pressure.shape
    columns = sensor.channel_map.columns
    if sensor.axes == 3 and rest == [columns // 3, 3]:  # x, y, z of each taxel side by side
        rest = [columns]
    if len(rest) > 1 and tuple(rest) not in sensor.images:
        seen = f"pressure has shape {pressure.shape}, which is no full grid of sensor {sensor.name}"
        raise RecordingCorrupt(path, seen, f"give pressure (scans, {columns})")
    if len(rest) == 1 and rest[0] != sensor.channel_map.columns:
        raise TaxelCountWrong(path, rest[0], sensor.name, sensor.channel_map.columns)
    return Recording(
        path,
        "npz",
        sensor,
        lambda: _in_columns(_read(path, times, pressure, scans_per_block(sensor)), sensor, images=len(rest) > 1),
        scans=scans,
        masked=_mask(path, extras, sensor.layout.taxels),
        truth=_truth(path, extras, sensor),
        joints=_joints_of(path, extras),
    )


def _contents(path: Path) -> tuple[_Header, _Header, Members]:
    """Headers of times and pressures, and the members besides them. Raises RecordingCorrupt."""
    try:
        with zipfile.ZipFile(path) as archive:
            check_expansion(path, sum(entry.file_size for entry in archive.infolist()))
            if any(entry.compress_type not in _PACKED for entry in archive.infolist()):
                raise RecordingCorrupt(path, "it is compressed, and not by deflate", _REMEDY)
            names = {name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")}
            if not {"t", "pressure"} <= names:
                raise RecordingCorrupt(path, f"it holds {', '.join(sorted(names)) or 'nothing'}", _REMEDY)
            with archive.open("t.npy") as member:
                times = _header(member)
            with archive.open("pressure.npy") as member:
                pressure = _header(member)
            extras = {name: _extra(archive, name) for name in _EXTRAS & names}
    except _DAMAGE as error:
        raise RecordingCorrupt(path, str(error) or type(error).__name__, _REMEDY) from error
    shaped = len(times.shape) == 1 and len(pressure.shape) in (2, 3, 4) and times.shape[0] == pressure.shape[0]
    if not shaped or times.dtype.kind not in "fiu" or pressure.dtype.kind not in "fiu":
        raise RecordingCorrupt(path, f"t is {times} and pressure {pressure}", _REMEDY)
    return times, pressure, extras


def _in_columns(blocks: Iterator[RawScans], sensor: Sensor, *, images: bool) -> Iterator[RawScans]:
    """Blocks in the source's columns. images: they are in the order of the layout."""
    return (RawScans(one.t_s, sensor.channel_map.arranged(one.values)) if images else one for one in blocks)


def _header(member: IO[bytes]) -> _Header:
    version = npy.read_magic(member)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    try:
        return _Header(*read(member))
    except (tokenize.TokenError, SyntaxError) as error:  # of headers that NumPy tries to repair
        raise ValueError(f"the header of an array is damaged: {error}") from error


def _extra(archive: zipfile.ZipFile, name: str) -> np.ndarray[Any, Any]:
    """A member besides the scans. Raises ValueError if it declares more data than the archive holds."""
    entry = archive.getinfo(f"{name}.npy")
    with archive.open(entry) as member:
        header = _header(member)
    if header.size_bytes > min(entry.file_size, MOST_ARRAY_BYTES):
        raise ValueError(f"member {name} declares {header} in {entry.file_size} bytes")
    with archive.open(entry) as member:
        array: np.ndarray[Any, Any] = npy.read_array(member, allow_pickle=False)
        return array


def _mask(path: Path, extras: Members, taxels: int) -> Bools:
    masked = extras.get("masked", np.zeros(taxels, dtype=np.bool_))
    if masked.shape != (taxels,) or masked.dtype.kind not in "biu":
        seen = f"member masked is {masked.dtype} {masked.shape}"
        raise RecordingCorrupt(path, seen, f"give a flag for each of the {taxels} taxels")
    return masked.astype(np.bool_)


def _truth(path: Path, extras: Members, sensor: Sensor) -> Truth | None:
    if not _TRUTH & extras.keys():
        return None
    t_s, pose = extras.get("truth_t_s", np.zeros(0)), extras.get("truth_pose", np.zeros(0))
    slipping, second = extras.get("truth_slipping"), extras.get("truth_second")
    return checked_truth(path, sensor, Truth(str(extras.get("truth_pad", "")), t_s, pose, slipping, second))


def _joints_of(path: Path, extras: Members) -> Joints | None:
    if not _JOINTS & extras.keys():
        return None
    if missing := _JOINTS - extras.keys():
        raise RecordingCorrupt(path, f"member {min(missing)} is missing", "give joint_names, joint_t_s, joint_angles")
    names = [str(name) for name in np.atleast_1d(extras["joint_names"])]
    return checked_joints(path, names, extras["joint_t_s"], extras["joint_angles"])


def _read(path: Path, times: _Header, pressure: _Header, block: int) -> Iterator[RawScans]:
    scans, taxels = pressure.shape[0], math.prod(pressure.shape[1:])
    start = 0
    try:
        if pressure.fortran:  # a column-major array cannot be read scan by scan
            seconds, whole = _whole(path, times, pressure)
            columns = whole.reshape(scans, taxels)
            for start in range(0, scans, block):
                part = slice(start, start + block)
                yield RawScans(seconds[part].astype(np.float64), columns[part].astype(np.float64, order="C"))
            return
        with ExitStack() as stack:
            archive = stack.enter_context(zipfile.ZipFile(path))
            t = stack.enter_context(archive.open("t.npy"))
            p = stack.enter_context(archive.open("pressure.npy"))
            _header(t), _header(p)
            while start < scans:
                count = min(block, scans - start)
                seconds = np.frombuffer(_exactly(t, count * times.dtype.itemsize), times.dtype)
                values = np.frombuffer(_exactly(p, count * taxels * pressure.dtype.itemsize), pressure.dtype)
                yield RawScans(seconds.astype(np.float64), values.reshape(count, taxels).astype(np.float64))
                start += count
    except _DAMAGE as error:
        raise RecordingTruncated(path, start, scans, str(error) or type(error).__name__) from error


def _whole(path: Path, times: _Header, pressure: _Header) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Times and pressures of a file whose pressures are column by column."""
    with zipfile.ZipFile(path) as archive:
        for name, header in (("t", times), ("pressure", pressure)):
            held = archive.getinfo(f"{name}.npy").file_size
            if header.size_bytes > held:
                raise EOFError(f"member {name} declares {header} in {held} bytes")
            if header.size_bytes > MOST_ARRAY_BYTES:
                seen = f"member {name} holds {header} column by column, which has to be read at once"
                raise RecordingTooLarge(path, seen, "save numpy.ascontiguousarray(pressure)")
        with archive.open("t.npy") as t, archive.open("pressure.npy") as p:
            return npy.read_array(t, allow_pickle=False), npy.read_array(p, allow_pickle=False)


def _exactly(member: IO[bytes], size: int) -> bytes:
    piece = member.read(size)
    if len(piece) < size:
        raise EOFError(f"{size - len(piece)} bytes are missing")
    return piece


def write_npz(recording: Recording, path: Path, blocks: Iterable[RawScans], **members: str) -> None:
    """Write blocks of a recording, with sensor, masked taxels and truth; members: further texts by name.

    Scans are written block by block. An array's header contains its length, so the recording is first read for its
    times.
    """
    t_s = np.concatenate([block.t_s for block in recording.blocks()])
    arrays = {"t": t_s, **_extras_of(recording), **members}
    header = {"descr": "<f8", "fortran_order": False, "shape": (len(t_s), recording.sensor.channel_map.columns)}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                npy.write_array(member, np.asanyarray(array), allow_pickle=False)
        with archive.open("pressure.npy", "w", force_zip64=True) as member:
            npy.write_array_header_1_0(member, header)
            for block in blocks:
                member.write(np.ascontiguousarray(block.values, dtype="<f8").tobytes())


def _extras_of(recording: Recording) -> dict[str, Any]:
    """Members of a recording besides its scans."""
    extras: dict[str, Any] = {"sensor": msgspec.json.encode(recording.sensor).decode()}
    if recording.masked.any():
        extras["masked"] = recording.masked
    truth = recording.truth
    if truth is not None:
        extras |= {"truth_pad": truth.pad, "truth_t_s": truth.t_s, "truth_pose": truth.pose}
        optional = {"truth_slipping": truth.slipping, "truth_second": truth.second}
        extras |= {name: array for name, array in optional.items() if array is not None}
    joints = recording.joints
    if joints is not None:
        extras |= {"joint_names": np.array(joints.names), "joint_t_s": joints.t_s, "joint_angles": joints.angles}
    return extras
