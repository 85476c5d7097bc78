"""A robot's log of the object's position: csv `t_s,x_m,y_m[,theta_rad]`, in the robot's frame and on its clock."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.errors import TruthInvalid
from taxelflow.messages import Floats

if TYPE_CHECKING:
    from pathlib import Path

_COLUMNS = (["t_s", "x_m", "y_m"], ["t_s", "x_m", "y_m", "theta_rad"])


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Positions of the contact's centre in the robot's frame, seen from outside the skin.

    t_s: (times,), robot's clock, increasing. place_m: (times, 2).
    """

    t_s: Floats
    place_m: Floats


def read_trajectory(path: Path) -> Trajectory:
    """Read a trajectory; `theta_rad` is allowed and not used. Raises TruthInvalid, OSError."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row]
    except (UnicodeDecodeError, csv.Error) as error:
        raise TruthInvalid(path, str(error)) from error
    header = [name.strip() for name in rows[0]] if rows else []
    if header not in _COLUMNS:
        raise TruthInvalid(path, f"header {','.join(header)[:80]!r}")
    numbers = []
    for line, row in enumerate(rows[1:], 2):
        try:
            numbers.append([float(field) for field in row])
        except ValueError as error:
            raise TruthInvalid(path, f"row {line}: {error}") from error
        if len(row) != len(header) or not np.isfinite(numbers[-1]).all():
            raise TruthInvalid(path, f"row {line} is {','.join(row)[:80]!r}")
    table = np.array(numbers)
    if len(table) < 2:
        raise TruthInvalid(path, f"{len(table)} rows of numbers")
    if not (np.diff(table[:, 0]) > 0).all():
        line = int(np.argmin(np.diff(table[:, 0]) > 0)) + 3
        raise TruthInvalid(path, f"the time in row {line} is not above the previous one")
    return Trajectory(table[:, 0], table[:, 1:3])
