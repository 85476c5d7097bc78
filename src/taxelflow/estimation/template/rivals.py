"""Distances between the positions that two fits of the same contact give to its object."""

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
"""Largest distance, in pitches, at which two starts agree on a scan: one of the two is refined coarsely only."""


def agreement(best: Solved, other: Solved, *, most: float = _SAME) -> Bools:
    """(scans,), whether two fits agree on the position of the object to within `most` pitches, one offset taken off."""
    centre = best.pattern.centre()
    places = best.states[:, :2] + arm_of(centre, best.states)
    others = other.states[:, :2] + arm_of(other.pattern.centre(), other.states)
    apart = others - places
    apart -= np.median(apart, axis=0)
    agrees: Bools = np.hypot(*apart.T) < most
    return agrees


def any_agrees(solved: Solved, others: list[Solved], scanned: Scanned) -> bool:
    """Whether another fit reports the object where this one does, in all scans, one offset taken off."""
    places = reported(solved, scanned)
    apart = [reported(one, scanned) - places for one in others]
    return any(float(np.hypot(*(one - np.median(one, axis=0)).T).max()) < _SAME for one in apart)


def apart_by_turn(best: Solved, rival: Solved) -> Floats:
    """(scans, 3), `distance` of two hypotheses, of which one turns, and in rad their angle, one constant taken off."""
    turn = np.unwrap(states_of((best if best.turns else rival).states).theta)
    return np.column_stack([distance(best.states, rival.states, turn), turn - turn.mean()])


def apart_by_growth(best: Solved, rival: Solved, scanned: Scanned) -> Floats:
    """(scans, 3), in pitches, distance of the reported points of two hypotheses, of which one grows; no angle."""
    apart = reported(rival, scanned) - reported(best, scanned)
    return np.column_stack([apart - np.median(apart, axis=0), np.zeros(len(apart))])


def reported(solved: Solved, scanned: Scanned) -> Floats:
    """(scans, 2), in pitches, positions of the reported point of the object."""
    places: Floats = solved.states[:, :2] + arm_of(solved.middle(scanned), solved.states)
    return places


def distance(states: Floats, others: Floats, theta: Floats) -> Floats:
    """(scans, 2), in pitches, distance of two trajectories (scans, 5) of a body that turns by theta (scans,).

    Each may follow its own point of the body; the two points are those with the least distance (least squares).
    """
    cos, sin = np.cos(theta), np.sin(theta)
    still, none = np.ones_like(cos), np.zeros_like(cos)
    points = np.stack([cos, -sin, still, none, sin, cos, none, still], axis=1).reshape(-1, 4)
    apart = (others - states)[:, :2].ravel()
    left: Floats = (apart - points @ np.linalg.lstsq(points, apart, rcond=None)[0]).reshape(-1, 2)
    return left
