"""A robot's log of the object's position, in the robot's frame and on its clock.

Formats: csv `t_s,x_m,y_m[,theta_rad]`; TUM, `t x y z qx qy qz qw` per line (the format of the TUM RGB-D benchmark,
which evo and many SLAM tools write); `geometry_msgs/PoseStamped` in a bag or MCAP file. Of a pose in space x and y are
used: the robot's frame has its z axis out of the skin.
"""

from __future__ import annotations

import csv
from array import array
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.acquire.limits import LONGEST_LINE
from taxelflow.errors import ParameterInvalid, TruthInvalid
from taxelflow.messages import Floats

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

_COLUMNS = (["t_s", "x_m", "y_m"], ["t_s", "x_m", "y_m", "theta_rad"])
_TUM, _TUM_FIELDS = (".tum", ".txt"), 8
"""Suffixes of the TUM format, and numbers in a row: time, position and quaternion."""
_BAGS = (".bag", ".mcap", ".db3")


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Positions of the contact's centre in the robot's frame, seen from outside the skin.

    t_s: (times,), robot's clock, increasing. place_m: (times, 2).
    """

    t_s: Floats
    place_m: Floats


def read_trajectory(path: str | Path, topic: str | None = None) -> Trajectory:
    """Read a trajectory: csv, TUM (`.tum`, `.txt`), or PoseStamped messages of a bag; rotations are not used.

    topic: of a bag, where several fit. Raises TruthInvalid, TopicUnclear, RecordingCorrupt, OSError.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if path.is_dir() or suffix in _BAGS:
        from taxelflow.acquire.ros.poses import read_poses

        table = read_poses(path, topic)
    elif topic is not None:
        raise ParameterInvalid("truth_topic", topic, "be left out for a trajectory that is no bag")
    elif suffix in _TUM:
        table = _numbers(path, _tum_rows(path), _TUM_FIELDS)
    else:
        table = _csv(path)
    if len(table) < 2:
        raise TruthInvalid(path, f"{len(table)} rows of numbers")
    if not (np.diff(table[:, 0]) > 0).all():
        row = int(np.argmin(np.diff(table[:, 0]) > 0)) + 2
        raise TruthInvalid(path, f"the time of pose {row} is not above the previous one")
    return Trajectory(table[:, 0], table[:, 1:3])


def _csv(path: Path) -> Floats:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = csv.reader(file)
            header = [name.strip() for name in next(filter(None, rows), [])]
            if header not in _COLUMNS:
                raise TruthInvalid(path, f"header {','.join(header)[:80]!r}")
            return _numbers(path, ((rows.line_num, row) for row in rows if row), len(header))
    except (UnicodeDecodeError, csv.Error) as error:
        raise TruthInvalid(path, str(error)) from error


def _tum_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line number and fields of each line that is not a comment."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            lines = enumerate(iter(lambda: file.readline(LONGEST_LINE), ""), 1)
            rows = ((number, line.partition("#")[0].split()) for number, line in lines)
            yield from ((number, row) for number, row in rows if row)
    except UnicodeDecodeError as error:
        raise TruthInvalid(path, str(error)) from error


def _numbers(path: Path, rows: Iterable[tuple[int, list[str]]], width: int) -> Floats:
    """(rows, width). Raises TruthInvalid for a row that does not hold that many finite numbers."""
    table = array("d")
    for line, row in rows:
        try:
            numbers = [float(field) for field in row]
        except ValueError as error:
            raise TruthInvalid(path, f"row {line}: {error}") from error
        if len(row) != width or not all(map(isfinite, numbers)):
            raise TruthInvalid(path, f"row {line} is {','.join(row)[:80]!r}")
        table.extend(numbers)
    return np.array(table).reshape(-1, width)
