"""How far apart two fits of a contact put its object."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.pose_output import arm_of
from taxelflow.numerics.bspline import states_of

if TYPE_CHECKING:
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.solution import Solved
    from taxelflow.messages import Bools, Floats

_SAME = 0.1
"""Largest distance, in pitches, at which two starts agree on a scan: one of them is refined coarsely."""


def agreement(best: Solved, other: Solved, *, most: float = _SAME) -> Bools:
    """(scans,), whether another fit puts the object where the best does, up to so much, in pitches."""
    centre = best.pattern.centre()
    places = best.states[:, :2] + arm_of(centre, best.states)
    others = other.states[:, :2] + arm_of(other.pattern.centre(), other.states)
    apart = others - places
    apart -= np.median(apart, axis=0)
    agrees: Bools = np.hypot(*apart.T) < most
    return agrees


def apart_by_turn(best: Solved, rival: Solved) -> Floats:
    """(scans, 2), see `distance`, with the turn of the one that turns."""
    return distance(best.states, rival.states, states_of((best if best.turns else rival).states).theta)


def apart_by_growth(best: Solved, rival: Solved, scanned: Scanned) -> Floats:
    """(scans, 2), in pitches, how far apart the points are that two hypotheses report, one of which grows."""
    apart = reported(rival, scanned) - reported(best, scanned)
    return apart - np.median(apart, axis=0)


def reported(solved: Solved, scanned: Scanned) -> Floats:
    """(scans, 2), places of the point that is reported."""
    places: Floats = solved.states[:, :2] + arm_of(solved.middle(scanned), solved.states)
    return places


def distance(states: Floats, others: Floats, theta: Floats) -> Floats:
    """(scans, 2), in pitches, how far apart two courses (scans, 5) of a body are that turns by theta (scans,).

    Each may follow a point of its own of the body: those that differ least.
    """
    cos, sin = np.cos(theta), np.sin(theta)
    still, none = np.ones_like(cos), np.zeros_like(cos)
    points = np.stack([cos, -sin, still, none, sin, cos, none, still], axis=1).reshape(-1, 4)
    apart = (others - states)[:, :2].ravel()
    left: Floats = (apart - points @ np.linalg.lstsq(points, apart, rcond=None)[0]).reshape(-1, 2)
    return left
