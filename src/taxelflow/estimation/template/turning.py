"""Whether the object of a contact turns: what decides between a fit that lets it turn and one that does not."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.likelihood import FEWEST, cost, touched, unexplained
from taxelflow.estimation.template.observability import sights
from taxelflow.estimation.template.observations import COARSE
from taxelflow.numerics.bspline import States, states_of

if TYPE_CHECKING:
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.solution import Solved
    from taxelflow.messages import Floats

_MOST, _STILL = 0.9, 9.0
"""An object has not turned if this quantile of its squared turns, over their variances, is below the second."""
_JERKY = 2.0
"""Median of the squared second differences of an angle, over their variances, up to which the turn is steady; noise
alone gives 0.45."""
_STEADY = 12.0
"""Scans over which an angle that turns steadily is one parameter."""
_UNCONVERGED = 1.0
"""By which a fit may explain a scan less, because it has not quite converged."""
_SEEN = 4.0
"""An angle is observable if the pattern shows it better by this factor than its own noise seems to."""


def explains_far_more(free: Solved, held: Solved, scanned: Scanned) -> bool:
    """Whether a turn explains so much that each angle may cost as much as a parameter that all readings determine; and
    the pattern shows more of it than noise.
    """
    return _sight(free, scanned) > 1.0 and cost(free, scanned, dear=True) < cost(held, scanned, dear=True)


def explains_no_less(free: Solved, held: Solved, scanned: Scanned) -> bool:
    """Whether a fit that lets the object turn is as good as one that does not, which it contains: if not, it has ended
    in a minimum of its own.
    """
    return unexplained(free, scanned) <= unexplained(held, scanned) + _UNCONVERGED * len(scanned)


def outweighs_faults(free: Solved, held: Solved, scanned: Scanned) -> bool:
    """Whether a turn explains more than it costs, if all readings may have the error that the sensor declares unseen.

    Faults of the sensor stay where they are from scan to scan: a turn that explains them seems sure.
    """
    least = scanned.unseen_error
    prices = [cost(replace(one, error=max(one.error, least)), scanned) for one in (free, held)]
    return prices[0] < prices[1]


def turns_surely(free: Solved, scanned: Scanned) -> bool:
    """Whether an object that was let turn shows its angle, and turns no more jerkily than noise makes it seem."""
    variance = variances_of(free.fit.information).theta
    jerk = np.diff(states_of(free.states).theta, 2)
    noise = variance[:-2] + 4.0 * variance[1:-1] + variance[2:]
    steady = len(jerk) == 0 or float(np.median(jerk**2 / noise)) < _JERKY
    return steady and _sight(free, scanned) > _SEEN


def turns_steadily(free: Solved, held: Solved, scanned: Scanned) -> bool:
    """Whether angles that follow from those before explain more than none: they cost as few as they are.

    Only of heights, whose texture shows an angle: they explain some of what a turn does.
    """
    if not (free.heights and turns_surely(free, scanned)):
        return False
    readings, scans = float(np.count_nonzero(touched(scanned))), len(scanned)
    saved = scans * float(np.log(max(readings / scans, FEWEST))) - scans  # each of them explains some noise, too
    few = scans / _STEADY * float(np.log(max(readings, FEWEST)))
    return cost(free, scanned) - saved + few < cost(held, scanned)


def keeps_its_angle(free: Solved, scanned: Scanned) -> bool:
    """Whether an object that was let turn has kept its angle, and its pattern shows that: noise in one seems to."""
    variance, theta = variances_of(free.fit.information).theta, states_of(free.states).theta
    theta = theta - np.median(theta)
    return bool(np.quantile(theta**2 / variance, _MOST) < _STILL and _sight(free, scanned) > _SEEN)


def _sight(free: Solved, scanned: Scanned) -> float:
    """How much better the pattern shows an angle than its own noise seems to, in the scan that shows it best."""
    scan = int(np.argmax(_diagonals(free.fit.information).theta))
    error = max(free.error, COARSE)
    return float(sights(free.pattern, scanned, free.states, free.fit.factor, scan, error).theta)


def _diagonals(matrices: Floats) -> States:
    """Diagonals of matrices (scans, 5, 5) over states."""
    return states_of(matrices.diagonal(axis1=1, axis2=2))


def variances_of(information: Floats) -> States:
    """Of the states whose information (scans, 5, 5) is given."""
    return _diagonals(np.asarray(np.linalg.inv(information), np.float64))
