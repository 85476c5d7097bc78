"""What `taxelflow estimate --out` has written, read back."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow.errors import ResultMissing
from taxelflow.messages import OK, QUALITY
from taxelflow.publish.summary import Summary

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.messages import Bools, Floats

# fmt: off
_COLUMNS = (
    "t_s", "x_m", "y_m", "theta_rad", "dx_m", "dy_m", "vx_m_s", "vy_m_s", "std_x_m", "std_y_m", "std_theta_rad",
    "lag_s",
)
# fmt: on
_FLAGS = ("contact", "slipping")


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """What one method saw on one pad: arrays over scans, columns of slips.csv by name, NaN where unknown.

    flags: contact, slipping, and ok, where the quality of the pose is ok.
    """

    method: str
    pad: str
    numbers: dict[str, Floats]
    flags: dict[str, Bools]

    @property
    def t_s(self) -> Floats:
        """When the pose was true: the scan's time less the method's lag."""
        when: Floats = self.numbers["t_s"] - np.nan_to_num(self.numbers["lag_s"])
        return when

    @property
    def position_m(self) -> Floats:
        """(scans, 2) in the pad's frame."""
        return np.stack([self.numbers["x_m"], self.numbers["y_m"]], axis=1)


def read_result(directory: Path) -> tuple[Summary, list[Track]]:
    """Summary and tracks of all pads. Raises ResultMissing."""
    summary, slips = directory / "summary.json", directory / "slips.csv"
    for file in (summary, slips):
        if not file.is_file():
            raise ResultMissing(directory, file.name)
    try:
        ran = msgspec.json.decode(summary.read_bytes(), type=Summary)
    except msgspec.DecodeError as error:
        raise ResultMissing(directory, f"readable summary.json ({error})") from error
    try:
        tracks = _tracks(slips, ran)
    except (ValueError, KeyError, csv.Error) as error:  # UnicodeDecodeError is a ValueError
        raise ResultMissing(directory, f"readable slips.csv ({error})") from error
    if {track.pad for track in tracks} != set(ran.pads):
        raise ResultMissing(directory, "slips.csv of the pads that its summary.json names")
    return ran, tracks


def _tracks(slips: Path, ran: Summary) -> list[Track]:
    columns: dict[str, dict[str, list[float]]] = {}
    with slips.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            own = columns.setdefault(row["pad"], {name: [] for name in (*_COLUMNS, *_FLAGS, "ok")})
            for name in (*_COLUMNS, *_FLAGS):
                own[name].append(float(row[name] or "nan"))
            own["ok"].append(row["quality"] == QUALITY[OK])
    return [
        Track(
            ran.method,
            pad,
            {name: np.array(own[name]) for name in _COLUMNS},
            {name: np.array(own[name]) > 0 for name in (*_FLAGS, "ok")},
        )
        for pad, own in columns.items()
    ]
