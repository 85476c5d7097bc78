"""Gains of a contact's scans: their mean is 1 by convention, their spread is learned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.turning import diagonals_of
from taxelflow.numerics.bspline import states_of

if TYPE_CHECKING:
    from taxelflow.estimation.template.solution import Solved


@dataclass(frozen=True, slots=True)
class _Gains:
    """Gains of a contact."""

    well_known: float = 0.6
    spread: tuple[float, float] = (0.05, 0.95)
    """Quantiles: gains with a variance below the first are used; their spread is the distance of the other two: ..."""
    normal_spread: float = 3.29
    """... which is this number of standard deviations of a normal distribution. A load that changes for a short time
    counts, too."""
    least: float = 0.05
    least_std: float = 0.02
    """Lower limits of the mean gain by which all are divided, and of their standard deviation."""


_GAINS = _Gains()


def normalize_gains(solved: Solved) -> float:
    """Normalise the gains to mean 1, in place, by scaling pattern and depth; returns their standard deviation.

    Both are taken from the scans that determine their gain best.
    """
    variance, gains = diagonals_of(solved.fit.covariance).gain, states_of(solved.states).gain
    well = variance <= np.quantile(variance, _GAINS.well_known)
    mean = max(float(np.median(gains[well])), _GAINS.least)
    low, high = np.quantile(gains[well], _GAINS.spread)
    spread = float(high - low) / _GAINS.normal_spread
    gains /= mean
    solved.depth *= mean
    solved.pattern.coefficients = solved.pattern.coefficients * mean
    solved.pattern.smoothing /= mean**2
    return float(np.sqrt(max(spread**2 - float(np.median(variance[well])), _GAINS.least_std**2)))
