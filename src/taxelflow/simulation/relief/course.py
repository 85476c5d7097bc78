"""Pose of the object and load on it at any time of a recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats
    from taxelflow.simulation.relief.parameters import Course

_CYCLES = 3
"""Cycles of the load in a course."""
_WANDERS = ((1.3, 0.0), (0.9, 0.6))
"""Cycles during the motion, and phase in cycles, of the load's wandering along the object's axes."""


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """pose: (times, 3), m, m, rad, of the load point in the pad's frame. load: (times,), multiple of the nominal force.
    lever_m: (times, 2), distance of the load's line of action from the load point, in body coordinates.
    slides, turns: (times,), whether it does. ahead: (2,), direction of sliding in the pad's frame.
    """

    pose: Floats
    load: Floats
    lever_m: Floats
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
    fade = np.sin(np.pi * share)
    lever_m = np.stack([fade * np.sin(2 * np.pi * (often * share + phase)) for often, phase in _WANDERS], axis=1)
    lever_m *= course.wander_m
    return Followed(pose, load, lever_m, moves & (course.travel_m > 0), moves & (course.turn_rad != 0), ahead)


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
