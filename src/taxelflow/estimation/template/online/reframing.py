"""Gauge alignment: an adjusted map is shifted into the frame of the map before, so that the reported point stays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.bundle_adjustment import covariance_of
from taxelflow.estimation.template.pose_output import arm_of
from taxelflow.estimation.template.solution import shown_centre
from taxelflow.numerics.bspline import states_of
from taxelflow.numerics.geometry import turned

if TYPE_CHECKING:
    from taxelflow.estimation.template.map import Pattern
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.solution import Solved
    from taxelflow.messages import Floats


def align_gauge(before: Floats, best: Solved, scanned: Scanned, turn: float) -> tuple[Floats, Floats, Floats]:
    """States (n, 5) of a solved contact in the frame of those before (n, 5), the origin (2,) of a frame that grows, and
    how far the states are from those before (n, 5), x and y at the centre of pressure.

    turn: by how much theta differs, the median.
    """
    away = np.array([0.0, 0.0, turn, 0.0, 0.0])
    if best.grows:
        origin = np.median(before[:, :2] - best.states[:, :2], axis=0)
        off = best.states - before - away
        return best.states, origin, off - np.median(off, axis=0)
    shown = shown_centre(scanned, before)
    middle = np.zeros(2) if shown is None else shown
    arms = arm_of(middle, best.states - away) - arm_of(middle, before)
    states = _fix_gauge(best.states, before[:, :2] - arms, best.fit.information, best.pattern)
    off = states - before - away
    off[:, :2] += arms
    return states, np.zeros(2), off


def _fix_gauge(states: Floats, before: Floats, information: Floats, pattern: Pattern) -> Floats:
    """States (n, 5) with the object's frame shifted, and the pattern with it, so that most are where they were, (n, 2).

    Those count most of which the scans know most: information (n, 5, 5). Some may have been wrong before, so it is
    their weighted median that stays. Only the origin moves: a turned lattice would have to be learned again.
    """
    own = covariance_of(information)
    weight = 1.0 / (own[:, 0, 0] + own[:, 1, 1])
    theta = states_of(states).theta
    gap = turned(before - states[:, :2], -theta)
    body = np.array([_weighted_median(along, weight) for along in gap.T])
    moved = states.copy()
    moved[:, :2] += turned(body, theta)
    pattern.lattice = pattern.lattice - np.array([0.0, *body])
    return moved


def _weighted_median(values: Floats, weight: Floats) -> float:
    order = np.argsort(values)
    reached = np.cumsum(weight[order])
    return float(values[order[np.searchsorted(reached, 0.5 * reached[-1])]])
