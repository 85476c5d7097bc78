"""Penalised likelihood of a fit, by which hypotheses are compared, and the model error that a fit leaves."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.template.depth import DEPTH_STD
from taxelflow.estimation.template.observations import COARSE
from taxelflow.numerics.centroid import LOADED
from taxelflow.numerics.robust import OUTLIER

if TYPE_CHECKING:
    from taxelflow.estimation.template.bundle_adjustment import Fit
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.solution import Solved
    from taxelflow.messages import Bools, Floats


class _Learned(NamedTuple):
    """Errors that are learned, as a share of the largest reading."""

    least: float = 1e-3
    """Every known sensor has more noise."""
    largest: float = 0.5


_LEARNED = _Learned()
FEWEST = 2
"""Readings per parameter, at least: in the logarithm of its cost, and of a fit whose error they show."""


def learned_error(fit: Fit, scanned: Scanned) -> float:
    """Error of a reading, as a share of its contact's largest, that the residuals in the contact significantly show."""
    level = scanned.amplitude
    within = (fit.weight > 0) & (np.maximum(fit.model, scanned.readings) > LOADED.skirt * level)
    squared, variance = fit.residual[within] ** 2, scanned.variance[within]
    wanted = fit.freedom * len(squared) + float(np.sqrt(2.0 * len(squared)))  # what noise may make of chi-square

    def excess(share: float) -> float:
        return float(np.minimum(squared / (variance + (share * level) ** 2), OUTLIER).sum()) - wanted

    low, high = _LEARNED
    if not len(squared) or excess(low) <= 0:
        return low
    for _ in range(16):  # halvings, to a relative error below 1e-4
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return high


def cost(solved: Solved, scanned: Scanned, *, strict: bool = False) -> float:
    """Bayesian information criterion (Schwarz 1978): -2 log posterior, and log n for each parameter.

    n is the number of readings that determine a parameter. For a state these are the readings of its scan, or all of
    them if `strict`; for a coefficient, its share of all. All fits of a contact are compared on the same readings:
    those of the taxels that are loaded at any time. Off a lattice there is no load.
    """
    count, scans = float(np.count_nonzero(touched(scanned))), len(scanned)
    states = scans * solved.fit.freed
    own = count if strict else count / scans
    coefficients = max(solved.fit.free - states, 1.0)
    free = coefficients * np.log(max(count / coefficients, FEWEST)) + states * np.log(max(own, FEWEST))
    return unexplained(solved, scanned) + float(free)


def unexplained(solved: Solved, scanned: Scanned) -> float:
    """-2 log posterior of a fit, without the penalty on its parameters."""
    chi = _by(solved, scanned, touched(scanned))
    depths = float(np.sum(solved.depth**2)) / DEPTH_STD**2
    return float(chi.sum() + depths + solved.pattern.smoothing * solved.fit.bending)


def as_dead(scanned: Scanned, taxel: int, noise: Floats, error: float) -> float:
    """-2 log likelihood of what a dead taxel has read, with the error that a fit leaves of others. noise: (scans,),
    variance of its readings. Each reading is penalised like a parameter of its scan, because the fit loses it.
    """
    used = noise > 0
    chi = _chi(scanned.readings[used, taxel], noise[used], error, scanned)
    own = np.count_nonzero(touched(scanned)) / len(scanned)
    return float(chi.sum()) + float(used.sum() * np.log(max(own, FEWEST)))


def as_alive(scanned: Scanned, taxel: int, solved: Solved) -> float:
    """-2 log likelihood of a taxel's readings under a fit, without those that `cost` already contains."""
    used = np.zeros(scanned.readings.shape, np.bool_)
    used[:, taxel] = (scanned.variance[:, taxel] > 0) & ~touched(scanned)[:, taxel]
    return float(_by(solved, scanned, used).sum())


def _by(solved: Solved, scanned: Scanned, used: Bools) -> Floats:
    """(n,), -2 log likelihood of the n readings that are used, a mask (scans, taxels), by a fit."""
    residual = scanned.readings[used] - np.maximum(solved.fit.model[used], 0.0)
    clipped = (scanned.readings >= scanned.ceiling)[used]
    residual[clipped & (residual < 0)] = 0.0
    return _chi(residual, scanned.variance[used], solved.error, scanned)


def _chi(residual: Floats, noise: Floats, error: float, scanned: Scanned) -> Floats:
    """(n,), -2 log likelihood of residuals; an outlier costs all fits the same. noise: variance."""
    variance = noise + (error * scanned.amplitude) ** 2
    most = OUTLIER + np.log(noise + (COARSE * scanned.amplitude) ** 2)
    return np.minimum(residual**2 / variance + np.log(variance), most)


def touched(scanned: Scanned) -> Bools:
    """(scans, taxels), readings of taxels that are loaded in any scan of the contact."""
    within: Bools = (scanned.variance > 0) & scanned.loaded().any(axis=0)
    return within
