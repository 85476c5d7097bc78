"""Metadata of a recording besides its scans: sensor, mask, truth and joint angles, as JSON texts and checked."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from taxelflow.acquire.base import HAND, Truth
from taxelflow.acquire.joints import joints_of
from taxelflow.errors import RecordingCorrupt, RecordingTooLarge
from taxelflow.sensors.names import safe_name, with_safe_names
from taxelflow.sensors.sensor import sensor_of
from taxelflow.sensors.toml_text import MOST_BYTES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Bools, Floats, Joints
    from taxelflow.sensors.sensor import Sensor

_REMEDY = "convert the original recording again with `taxelflow convert`"


class _TruthText(msgspec.Struct):
    """The fields of `Truth`; null encodes NaN."""

    pad: str
    t_s: list[float | None]
    pose: list[list[float | None]]
    slipping: list[bool] | None = None
    second: list[list[float | None]] | None = None


class _JointsText(msgspec.Struct):
    """The fields of `Joints`."""

    names: list[str]
    t_s: list[float]
    angles: list[list[float | None]]


def texts_of(recording: Recording) -> dict[str, str]:
    """JSON texts by name: `sensor`, `masked` (numbers of taxels), and `truth` if it is known. Numbers are exact."""
    texts = {
        "sensor": msgspec.json.encode(recording.sensor).decode(),
        "masked": msgspec.json.encode(np.flatnonzero(recording.masked).tolist()).decode(),
    }
    truth = recording.truth
    if truth is not None:
        slipping = None if truth.slipping is None else truth.slipping.tolist()
        second = None if truth.second is None else truth.second.tolist()
        text = _TruthText(truth.pad, truth.t_s.tolist(), truth.pose.tolist(), slipping, second)
        texts["truth"] = msgspec.json.encode(text).decode()
    if recording.joints is not None:
        joints = recording.joints
        angles = _JointsText(list(joints.names), joints.t_s.tolist(), joints.angles.tolist())
        texts["joints"] = msgspec.json.encode(angles).decode()
    return texts


def sensor_in(path: Path, texts: Mapping[str, str]) -> Sensor | None:
    """The sensor, if it is among the texts. Raises RecordingCorrupt, SensorFileInvalid."""
    return sensor_in_text(path, texts["sensor"]) if "sensor" in texts else None


def sensor_in_text(path: Path, text: str) -> Sensor:
    """The sensor in JSON text of a recording, its names made safe. Raises RecordingCorrupt, SensorFileInvalid."""
    return sensor_of(with_safe_names(_decoded(path, {"sensor": text}, "sensor", Any)), f"{path}:sensor")


def masked_in(path: Path, texts: Mapping[str, str], taxels: int) -> Bools:
    """(taxels,): whether a taxel is masked; none if the texts do not contain it. Raises RecordingCorrupt."""
    masked = np.zeros(taxels, dtype=np.bool_)
    numbers = _decoded(path, texts, "masked", list[int]) if "masked" in texts else []
    if any(not 0 <= number < taxels for number in numbers):
        raise RecordingCorrupt(path, f"masked lists numbers beyond the {taxels} taxels of the sensor", _REMEDY)
    masked[numbers] = True
    return masked


def truth_in(path: Path, texts: Mapping[str, str], sensor: Sensor) -> Truth | None:
    """The truth, if it is among the texts. Raises RecordingCorrupt."""
    if "truth" not in texts:
        return None
    text = _decoded(path, texts, "truth", _TruthText)
    try:
        t_s, pose = np.array(text.t_s, dtype=np.float64), np.array(text.pose, dtype=np.float64)
        second = None if text.second is None else np.array(text.second, dtype=np.float64)
    except ValueError as error:
        raise RecordingCorrupt(path, f"truth: {error}", _REMEDY) from error
    slipping = None if text.slipping is None else np.array(text.slipping, dtype=np.bool_)
    return checked_truth(path, sensor, Truth(text.pad, t_s, pose, slipping, second))


def joints_text_in(path: Path, texts: Mapping[str, str]) -> Joints | None:
    """The joint angles, if they are among the texts. Raises RecordingCorrupt."""
    if "joints" not in texts:
        return None
    text = _decoded(path, texts, "joints", _JointsText)
    t_s = np.array(text.t_s, np.float64)
    try:
        angles = np.array(text.angles, np.float64) if text.angles else np.zeros((0, len(text.names)))
    except ValueError as error:
        raise RecordingCorrupt(path, f"joints: {error}", _REMEDY) from error
    return checked_joints(path, text.names, t_s, angles)


def checked_joints(path: Path, names: Sequence[str], t_s: Floats, angles: Floats) -> Joints:
    """Joint angles whose arrays are from a file, checked. Raises RecordingCorrupt."""
    if t_s.ndim != 1 or angles.shape != (*t_s.shape, len(names)) or t_s.dtype.kind + angles.dtype.kind != "ff":
        seen = f"{len(names)} joints, joint_t_s {t_s.dtype} {t_s.shape}, joint_angles {angles.dtype} {angles.shape}"
        raise RecordingCorrupt(path, seen, "give names, times (n,) in s and angles (n, joints) in rad")
    check_joint_names(path, names)
    return joints_of(names, t_s.astype(np.float64), angles.astype(np.float64))


def check_joint_names(path: Path, names: Sequence[str]) -> None:
    """Raises RecordingCorrupt if two columns hold the angles of one joint: which of them count is not known."""
    twice = [name for number, name in enumerate(names) if name in names[:number]]
    if twice:
        raise RecordingCorrupt(path, f"joint {twice[0]!r} has two columns of angles", "give each joint one")


def checked_truth(path: Path, sensor: Sensor, found: Truth) -> Truth:
    """A truth whose arrays are from a file, checked and in standard types. Raises RecordingCorrupt."""
    pad, t_s, pose, slipping, second = safe_name(found.pad), found.t_s, found.pose, found.slipping, found.second
    fits = t_s.ndim == 1 and pose.shape == (*t_s.shape, 3) and t_s.dtype.kind + pose.dtype.kind == "ff"
    if not fits or pad not in (*sensor.layout.pads, HAND):
        seen = f"truth_pad {pad!r}, truth_t_s {t_s.dtype} {t_s.shape}, truth_pose {pose.dtype} {pose.shape}"
        raise RecordingCorrupt(
            path, seen, "give a pad of the sensor or hand, times (n,) in s and poses (n, 3) in m, m, rad"
        )
    if slipping is not None and (slipping.shape != t_s.shape or slipping.dtype.kind not in "biu"):
        seen = f"truth_slipping is {slipping.dtype} {slipping.shape}"
        raise RecordingCorrupt(path, seen, f"give a flag for each of the {len(t_s)} times of truth_t_s")
    if second is not None and (second.shape != pose.shape or second.dtype.kind != "f"):
        seen = f"truth_second is {second.dtype} {second.shape}"
        raise RecordingCorrupt(path, seen, f"give a pose for each of the {len(t_s)} times of truth_t_s")
    slips = None if slipping is None else slipping.astype(np.bool_)
    return Truth(pad, t_s.astype(np.float64), pose.astype(np.float64), slips, second)


def _decoded(path: Path, texts: Mapping[str, str], name: str, kind: Any) -> Any:
    text = texts[name]
    if name == "sensor" and len(text) > MOST_BYTES:
        raise RecordingTooLarge(path, f"its sensor is a text of {len(text)} characters", _REMEDY)
    try:
        return msgspec.json.decode(text, type=kind)
    except RecursionError as error:
        raise RecordingCorrupt(path, f"its {name} is nested too deeply", _REMEDY) from error
    except (msgspec.DecodeError, UnicodeError) as error:
        raise RecordingCorrupt(path, f"its {name}: {error}", _REMEDY) from error
