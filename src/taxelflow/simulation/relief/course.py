"""Pose of the object and load on it at any time of a recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats
    from taxelflow.simulation.relief.parameters import Course

_CYCLES = 3


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """pose: (times, 3), m, m, rad, of the load point in the pad's frame. load: (times,), multiple of the nominal force.
    slides, turns: (times,), whether it does. ahead: (2,), direction of sliding in the pad's frame.
    """

    pose: Floats
    load: Floats
    slides: Bools
    turns: Bools
    ahead: Floats


def follow(course: Course, rate_hz: float, t_s: Floats) -> Followed:
    """The course at times t_s (times,), s."""
    scan = np.round(t_s * rate_hz, 6)  # the first scan that touches must not depend on how its time is rounded
    pressed = course.idle_scans + course.pressing_scans
    begins = pressed + course.rest_scans
    share = np.clip((scan - begins) / course.moving_scans, 0.0, 1.0)
    moves = (share > 0) & (share < 1)
    ahead = np.array([np.cos(course.direction_rad), np.sin(course.direction_rad)])
    pose = np.empty((len(t_s), 3))
    pose[:, :2] = np.array(course.middle_m) + course.travel_m * (share[:, np.newaxis] - 0.5) * ahead
    pose[:, 2] = course.angle_rad + course.turn_rad * (share - 0.5)
    load = _multiple(course, share)
    load *= np.clip((scan - course.idle_scans) / max(course.pressing_scans, 1e-9), 0.0, 1.0) if pressed else 1.0
    return Followed(pose, load, moves & (course.travel_m > 0), moves & (course.turn_rad != 0), ahead)


def _multiple(course: Course, share: Floats) -> Floats:
    """Multiple (times,) of the nominal force after a share (times,) of the motion."""
    first, second = course.multiples
    if course.load == "constant":
        return np.ones_like(share)
    if course.load == "ramp":
        ramp: Floats = first + (second - first) * share
        return ramp
    cycles: Floats = first + (second - first) * (0.5 - 0.5 * np.cos(2 * np.pi * _CYCLES * share))
    return cycles
