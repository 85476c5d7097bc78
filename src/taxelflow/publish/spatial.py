"""Rows of object3d.csv: the object's twist and pose in space, with their covariances and what is not observable."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from taxelflow.messages import Floats, SpatialMotions

_AXES = ("x", "y", "z", "rx", "ry", "rz")
_PAIRS = tuple(combinations_with_replacement(range(6), 2))
NAME = "object3d"
"""Stem of its files, key in JSON, topic."""
COUNTS = ("rank", "pose_rank", "pads", "contradicted")
TEXTS = ("blamed", "unobservable", "pose_unobservable")
"""Columns that are not real numbers."""
COLUMNS = (
    "t_s",
    *(f"{name}_m_s" for name in ("vx", "vy", "vz")),
    *(f"{name}_rad_s" for name in ("wx", "wy", "wz")),
    *("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"),
    *("rank", "pose_rank", "pads", "blamed", "contradicted", "unobservable", "pose_unobservable"),
    *(f"cov_twist_{_AXES[i]}_{_AXES[j]}" for i, j in _PAIRS),
    *(f"cov_pose_{_AXES[i]}_{_AXES[j]}" for i, j in _PAIRS),
)


@dataclass(frozen=True, slots=True)
class _Kind:
    """What a motion is called."""

    pure: float = 0.02
    """Translation or advance, in m per rad, below which a motion is called a rotation about an axis."""
    far_m: float = 2.0
    """Distance of an axis beyond which a rotation is called a translation."""


_KIND = _Kind()


def spatial_values(motions: SpatialMotions, pads: tuple[str, ...]) -> Iterable[list[float | int | str]]:
    """A row per scan; unknown numbers are NaN."""
    first, second = (list(side) for side in zip(*_PAIRS, strict=True))
    twist_cov, pose_cov = motions.twist_covariance[:, first, second], motions.pose_covariance[:, first, second]
    for k, t_s in enumerate(motions.t_s.tolist()):
        touched = motions.pads[k] > 0
        yield [
            t_s,
            *motions.twist[k].tolist(),
            *motions.pose[k].tolist(),
            int(motions.rank[k]),
            int(motions.pose_rank[k]),
            int(motions.pads[k]),
            " ".join(pads[pad] for pad in np.flatnonzero(motions.blamed[k])),
            int(motions.contradicted[k]),
            "; ".join(in_words(motions.blind[k])) if touched else "",
            "; ".join(in_words(motions.pose_blind[k])),
            *twist_cov[k].tolist(),
            *pose_cov[k].tolist(),
        ]


def in_words(blind: Floats) -> list[str]:
    """Directions (6, 6) of `SpatialMotions.blind`, in words: turns about an axis, translations, screws."""
    shifts, turns = basis_of(blind)
    return [*(_translation(shift) for shift in shifts), *(_turn(motion) for motion in turns)]


def basis_of(blind: Floats) -> tuple[Floats, Floats]:
    """Pure translations (n, 3), as many as possible, and twists (m, 6) that span directions (6, 6) as in
    `SpatialMotions.blind`: motions that cannot be seen.
    """
    rows = blind[np.abs(blind).max(axis=1) > 0]
    if not len(rows):
        return np.zeros((0, 3)), np.zeros((0, 6))
    _, sizes, mixed = np.linalg.svd(rows[:, 3:].T)
    turning = int(np.sum(sizes > 1e-6 * max(float(np.abs(rows).max()), 1e-12)))
    basis = mixed @ rows
    shifts = basis[turning:, :3]
    if turning:  # a translation that cannot be seen anyway is taken out of the turns
        free, *_ = np.linalg.svd(shifts.T) if len(shifts) else (np.zeros((3, 0)),)
        span = free[:, : len(shifts)]
        basis[:turning, :3] -= basis[:turning, :3] @ span @ span.T
    return shifts, basis[:turning]


def _translation(shift: Floats) -> str:
    return f"translation along ({_direction(shift)})"


def _turn(motion: Floats) -> str:
    """A twist (6,) as a turn about an axis, or a screw."""
    v, omega = motion[:3], motion[3:]
    rate = float(np.linalg.norm(omega))
    point = np.cross(omega, v) / rate**2
    advance = float(v @ omega) / rate**2
    if np.linalg.norm(point) > _KIND.far_m:
        return _translation(v)
    at = ", ".join(str(round(1e3 * float(number))) for number in point)
    words = f"turn about ({_direction(omega)}) through ({at}) mm"
    return words if abs(advance) < _KIND.pure else f"{words}, advancing {round(1e3 * advance)} mm/rad"


def _direction(vector: Floats) -> str:
    """Components of a unit vector whose largest one is positive."""
    unit = vector / np.linalg.norm(vector)
    unit = unit * np.sign(unit[np.argmax(np.abs(unit))]) + 0.0
    return ", ".join(f"{number:.2f}".replace("-0.00", "0.00") for number in unit)
