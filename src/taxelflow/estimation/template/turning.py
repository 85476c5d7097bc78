"""Tests that decide between a fit with a free angle (free) and one with a constant angle (held)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.bundle_adjustment import diagonals_of
from taxelflow.estimation.template.likelihood import FEWEST, cost, touched, unexplained
from taxelflow.estimation.template.observability import observability
from taxelflow.estimation.template.observations import COARSE, LARGEST
from taxelflow.numerics.bspline import states_of
from taxelflow.numerics.rounding import OBSERVABLE, SIGNIFICANT

if TYPE_CHECKING:
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.solution import Solved


_STEADY = 12.0
"""Scans per parameter of an angle that changes smoothly."""
UNCONVERGED = 1.0
"""Cost per scan by which two fits may differ because they have not fully converged."""


def explains_far_more(free: Solved, held: Solved, scanned: Scanned) -> bool:
    """Whether the free fit is better even if each angle is penalised like a parameter of all readings.

    The pattern must also show more of the angle than noise would. Heights that press no taxel are hardly known, and
    would outweigh those that do.
    """
    better = cost(free, scanned, strict=True) < cost(held, scanned, strict=True)
    return better and _observability(free, scanned, pressed=free.heights) > 1.0


def explains_no_less(free: Solved, held: Solved, scanned: Scanned) -> bool:
    """Whether the free fit, which contains the held one, is as good: if not, it has ended in a local minimum."""
    return unexplained(free, scanned) <= unexplained(held, scanned) + UNCONVERGED * len(scanned)


def outweighs_faults(free: Solved, held: Solved, scanned: Scanned) -> bool:
    """Whether the free fit is better if every reading may also have the sensor's `unseen_error`.

    Faults of the sensor are the same in all scans, so a rotation that explains them looks significant.
    """
    least = scanned.unseen_error
    prices = [cost(replace(one, error=max(one.error, least)), scanned) for one in (free, held)]
    return prices[0] < prices[1]


def turns_surely(free: Solved, scanned: Scanned) -> bool:
    """Whether the angle of a free fit is observable."""
    return _observability(free, scanned) > OBSERVABLE


def turns_steadily(free: Solved, held: Solved, scanned: Scanned) -> bool:
    """Whether the free fit is better if a smooth angle is penalised as one parameter per `_STEADY` scans.

    For patterns of heights only: their texture determines an angle, and they explain a part of what a rotation does.
    """
    if not (free.heights and turns_surely(free, scanned)):
        return False
    readings, scans = float(np.count_nonzero(touched(scanned))), len(scanned)
    saved = scans * float(np.log(max(readings / scans, FEWEST))) - scans  # each angle explains some noise, too
    few = scans / _STEADY * float(np.log(max(readings, FEWEST)))
    return cost(free, scanned) - saved + few < cost(held, scanned)


def shows_angle(held: Solved, free: Solved, scanned: Scanned) -> bool:
    """Whether the angle is observable in the pattern of the held fit, too: free angles make a pattern of noise show it.

    A round object on few taxels: 4 to 7 times the information of noise in free fits, 1 to 2 times in held ones.
    """
    return _observability(held, scanned, at=_most_informed(free)) > OBSERVABLE


def keeps_its_angle(free: Solved, scanned: Scanned) -> bool:
    """Whether the angle of a free fit is observable and constant; a pattern of noise makes any angle look constant."""
    variance = diagonals_of(np.asarray(np.linalg.inv(free.fit.information), np.float64)).theta
    theta = states_of(free.states).theta - np.median(states_of(free.states).theta)
    return bool(np.quantile(theta**2 / variance, LARGEST) < SIGNIFICANT**2) and turns_surely(free, scanned)


def _most_informed(free: Solved) -> int:
    """The scan with the most information on the angle."""
    return int(np.argmax(diagonals_of(free.fit.information).theta))


def _observability(solved: Solved, scanned: Scanned, *, pressed: bool = False, at: int | None = None) -> float:
    """Observability of the angle, see `observability`, in a scan, or in that with the most information on it."""
    scan = _most_informed(solved) if at is None else at
    error = max(solved.error, COARSE)
    return observability(solved.pattern, scanned, solved.states, solved.fit.factor, scan, error, pressed=pressed)
