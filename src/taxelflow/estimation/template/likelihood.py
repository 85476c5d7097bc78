"""How likely a fit makes the scans of a contact: what hypotheses are compared by, and the error that a fit leaves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.depth import DEPTH_STD
from taxelflow.estimation.template.observations import COARSE
from taxelflow.numerics.bspline import states_of
from taxelflow.numerics.robust import OUTLIER

if TYPE_CHECKING:
    from taxelflow.estimation.template.bundle_adjustment import Fit
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.solution import Solved
    from taxelflow.messages import Bools, Floats

_LEAST, _MOST = 1e-3, 0.5
"""Bounds of the error learned; below the first, noise is larger on every sensor known."""
_LOADED = 0.03
"""Share of a contact's largest reading above which a taxel is in the contact."""
FEWEST = 2
"""Readings by parameter, at least, for its cost."""
_HALVINGS = 30


def learned_error(fit: Fit, scanned: Scanned) -> float:
    """Error of a reading, as a share of its contact's largest, that the residuals in the contact surely show."""
    level = scanned.amplitude
    within = (fit.weight > 0) & (np.maximum(fit.model, scanned.readings) > _LOADED * level)
    squared, variance = fit.residual[within] ** 2, scanned.variance[within]
    wanted = fit.freedom * len(squared) + float(np.sqrt(2.0 * len(squared)))  # what noise may make of chi-square

    def excess(share: float) -> float:
        return float(np.minimum(squared / (variance + (share * level) ** 2), OUTLIER).sum()) - wanted

    low, high = _LEAST, _MOST
    if not len(squared) or excess(low) <= 0:
        return low
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return high


def cost(solved: Solved, scanned: Scanned, *, dear: bool = False) -> float:
    """-2 log posterior of a fit and log n for each parameter that n readings determine (Schwarz 1978): those of a scan
    its state, or, if `dear`, all of them; its share of them a coefficient.

    All fits of a contact are judged by the same readings: those of the taxels that are loaded at any time. Off a
    lattice there is no load.
    """
    fit, within = solved.fit, touched(scanned)
    model = np.maximum(fit.model, 0.0)
    variance = scanned.variance + (solved.error * scanned.amplitude) ** 2
    residual = scanned.readings - model
    residual[(scanned.readings >= scanned.ceiling) & (residual < 0)] = 0.0
    usual = (
        scanned.variance[within] + (COARSE * scanned.amplitude) ** 2
    )  # what is not explained costs all fits the same
    chi = residual[within] ** 2 / variance[within] + np.log(variance[within])
    chi = np.minimum(chi, OUTLIER + np.log(usual))
    gains = float(np.sum((states_of(solved.states).gain - 1.0) ** 2)) / solved.gain_std**2
    depths = float(np.sum(solved.depth**2)) / DEPTH_STD**2
    count, scans = float(np.count_nonzero(within)), len(scanned)
    states = scans * fit.freed
    own = count if dear else count / scans
    coefficients = max(fit.free - states, 1.0)
    free = coefficients * np.log(max(count / coefficients, FEWEST)) + states * np.log(max(own, FEWEST))
    return float(chi.sum() + gains + depths + solved.pattern.smoothing * fit.bending + free)


def touched(scanned: Scanned) -> Bools:
    """(scans, taxels), readings of taxels that are loaded in any scan of the contact."""
    within: Bools = (scanned.variance > 0) & scanned.loaded().any(axis=0)
    return within


def misfit(fit: Fit) -> Floats:
    """(scans,), chi-square per degree of freedom."""
    share: Floats = fit.chi / np.maximum(fit.counts, 1) / fit.freedom
    return share
