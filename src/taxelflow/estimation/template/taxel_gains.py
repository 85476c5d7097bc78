"""Gains of the taxels, estimated with the map: one part of the object is read by one taxel after the other.

Taxels of real skins differ by some 10 %. That looks like a pattern that stays on the skin while the object moves, and
biases poses. The gains are unknowns with a prior around 1, whose width is learned (empirical Bayes); they are kept only
if they make the scans likelier, each of them counted as a parameter (Schwarz 1978).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.template.hypotheses import refined
from taxelflow.estimation.template.likelihood import FEWEST, cost
from taxelflow.numerics.centroid import LOADED

if TYPE_CHECKING:
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.solution import Solved
    from taxelflow.messages import Floats


class _Learning(NamedTuple):
    """How gains of taxels are learned."""

    spread: float = 0.1
    most_spread: float = 0.2
    """Standard deviation of the gains before anything is known, and the largest."""
    limits: tuple[float, float] = (0.5, 2.0)
    """Bounds of a gain; a taxel beyond is faulty, which `dead_taxels` and `condition.health` detect."""
    passes: int = 2


_LEARNING = _Learning()


class Gains(NamedTuple):
    """value: (taxels,), around 1. penalty: of the cost, for their spread and number. gain: what they seem to lower the
    cost by at most, the fit held.
    """

    value: Floats
    spread: float
    penalty: float
    gain: float


def with_gains(scanned: Scanned, solved: Solved) -> Solved:
    """The fit with the taxels' gains, if that is likelier; the readings in `scanned` are then divided by them.

    solved: a fit of the readings as they are, or divided by gains that were known before.
    """
    found = _estimated(scanned, solved, np.ones(scanned.readings.shape[1]), _LEARNING.spread)
    if found.gain <= found.penalty:
        return solved
    best, corrected = solved, scanned
    for _ in range(_LEARNING.passes):
        corrected = scanned.divided(found.value)
        best = refined(corrected, best.copy())
        known, found = found, _estimated(scanned, best, found.value, found.spread)
    as_read = replace(
        best,
        fit=replace(best.fit, model=best.fit.model * known.value),
        error=best.error * corrected.amplitude / scanned.amplitude,
    )
    if cost(as_read, scanned) + known.penalty > cost(solved, scanned):
        return solved
    scanned.readings, scanned.variance, scanned.ceiling = corrected.readings, corrected.variance, corrected.ceiling
    best.gains = known.value
    return best


def _estimated(scanned: Scanned, solved: Solved, before: Floats, spread: float) -> Gains:
    """The gains with which the model of a fit explains the readings best; before: (taxels,), those in the fit."""
    fit, level = solved.fit, scanned.amplitude
    seen = (fit.weight > 0) & (fit.model > LOADED.skirt * level) & (scanned.readings < scanned.ceiling)
    model = np.where(seen, fit.model, 0.0)
    variance = np.where(scanned.variance > 0, scanned.variance + (solved.error * level * before) ** 2, np.inf)
    shown = np.sum(model**2 / variance, axis=0)
    pull = np.sum(model * (scanned.readings - fit.model) / variance, axis=0)
    known = shown > 0
    off, left = pull / (shown + spread**-2), 1.0 / (shown + spread**-2)
    if known.any():
        spread = float(min(np.sqrt(np.mean(off[known] ** 2 + left[known])), _LEARNING.most_spread))
    off, determined = pull / (shown + spread**-2), 1.0 - 1.0 / (1.0 + shown * spread**2)
    counts = np.maximum(np.count_nonzero(seen, axis=0), FEWEST)
    penalty = float(np.sum(off[known] ** 2) / spread**2 + np.sum(determined[known] * np.log(counts[known])))
    return Gains(np.clip(1.0 + off, *_LEARNING.limits), spread, penalty, float(np.sum(pull * off)))
