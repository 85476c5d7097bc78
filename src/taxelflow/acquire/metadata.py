"""Metadata of a recording besides its scans: sensor, masked taxels and truth, as JSON texts and checked."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from taxelflow.acquire.base import HAND, Truth
from taxelflow.errors import RecordingCorrupt
from taxelflow.sensors.sensor import sensor_of

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Bools
    from taxelflow.sensors.sensor import Sensor

_REMEDY = "convert the original recording again with `taxelflow convert`"


class _TruthText(msgspec.Struct):
    """The fields of `Truth`; null encodes NaN."""

    pad: str
    t_s: list[float | None]
    pose: list[list[float | None]]
    slipping: list[bool] | None = None
    second: list[list[float | None]] | None = None


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
    return texts


def sensor_in(path: Path, texts: Mapping[str, str]) -> Sensor | None:
    """The sensor, if it is among the texts. Raises RecordingCorrupt, SensorFileInvalid."""
    return sensor_of(_decoded(path, texts, "sensor", Any), f"{path}:sensor") if "sensor" in texts else None


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


def checked_truth(path: Path, sensor: Sensor, found: Truth) -> Truth:
    """A truth whose arrays are from a file, checked and in standard types. Raises RecordingCorrupt."""
    pad, t_s, pose, slipping, second = found.pad, found.t_s, found.pose, found.slipping, found.second
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
    try:
        return msgspec.json.decode(texts[name], type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise RecordingCorrupt(path, f"its {name}: {error}", _REMEDY) from error
