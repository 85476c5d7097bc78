"""Recordings of a XELA finger with a marker on the object, whose speed at each scan is the truth.

A recording is a folder of `xela_sensor1.csv` (x, y, z of each taxel), `marker.csv` (position in m, row by row with the
sensor's) and `meta_data.csv` (`frequency_hz` of the rows). A camera on the hand tracks the marker. A pose
that repeats bit for bit, or lies farther away than the hand reaches, is lost.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow.acquire.columns import Columns
from taxelflow.errors import RecordingCorrupt, RecordingMissing
from taxelflow.pipeline import api
from taxelflow.sensors.catalogue import load_sensor

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Floats

READINGS = "xela_sensor1.csv"
_SENSOR = "xela-4x4@4.7mm"
"""The recordings do not state their pitch; this is that of the uSkin modules of their time."""
_POSITION = ("marker1_position_x", "marker1_position_y", "marker1_position_z")
_FARTHEST_M = 1.5
"""A marker on an object in the hand is nearer to the hand's camera than this."""


@dataclass(frozen=True, slots=True, eq=False)
class Marked:
    """A recording, and the positions of its marker. t_s: (times,). position: (times, 3), m.

    half_s: a speed is measured over this time before and after, three scans of the sensor, four or more of the camera.
    """

    name: str
    recording: Recording
    t_s: Floats
    position: Floats
    half_s: float = 0.15

    def at(self, t_s: Floats) -> Floats:
        """(times, 3), the marker's position, m; NaN where it was lost."""
        return np.stack([self._between(t_s, axis) for axis in range(3)], axis=1)

    def speed_m_s(self, t_s: Floats) -> Floats:
        """(times,), its speed; NaN where it was lost."""
        way = self.at(t_s + self.half_s) - self.at(t_s - self.half_s)
        speed: Floats = np.linalg.norm(way, axis=1) / (2 * self.half_s)
        return speed

    def _between(self, t_s: Floats, axis: int) -> Floats:
        """Linear interpolation; NaN between poses farther apart than the time over which a speed is measured."""
        after = np.clip(np.searchsorted(self.t_s, t_s), 1, len(self.t_s) - 1)
        known = (
            (self.t_s[after] - self.t_s[after - 1] <= 2 * self.half_s) & (t_s >= self.t_s[0]) & (t_s <= self.t_s[-1])
        )
        return np.where(known, np.interp(t_s, self.t_s, self.position[:, axis]), np.nan)


def marked_recordings(folder: Path) -> list[Path]:
    """The folders of a data set, by name. Raises RecordingMissing if there are none."""
    found = sorted(path.parent for path in folder.glob(f"*/{READINGS}"))
    if not found:
        raise RecordingMissing(folder / "*" / READINGS)
    return found


def open_marked(folder: Path, *, shear: bool = True) -> Marked:
    """Open one recording of the data set. shear: whether it is read. Raises RecordingCorrupt."""
    rate_hz = float(_columns(folder / "meta_data.csv", ("frequency_hz",))[0, 0])
    position = _columns(folder / "marker.csv", _POSITION)
    moved = np.concatenate([[True], (np.diff(position, axis=0) != 0).any(axis=1)])
    seen = moved & (np.linalg.norm(position, axis=1) < _FARTHEST_M)
    if seen.sum() < 2:
        raise RecordingCorrupt(folder / "marker.csv", "the marker is hardly ever seen", "leave the recording out")
    t_s = np.arange(len(position)) / rate_hz
    sensor = load_sensor(_SENSOR)
    sensor = sensor if shear else msgspec.structs.replace(sensor, shear=None)
    recording = api.read(folder / READINGS, sensor, columns=Columns(rate_hz=rate_hz))
    return Marked(folder.name, recording, t_s[seen], position[seen])


def _columns(path: Path, names: tuple[str, ...]) -> Floats:
    """(rows, names), named columns of a csv file. Raises RecordingMissing, RecordingCorrupt."""
    if not path.is_file():
        raise RecordingMissing(path)
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    try:
        return np.array([[float(row[name]) for name in names] for row in rows]).reshape(-1, len(names))
    except (KeyError, TypeError, ValueError) as error:
        raise RecordingCorrupt(path, f"not numbers: {error}", f"give columns {', '.join(names)}") from error
