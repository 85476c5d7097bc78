"""Contacts of which parts lift and come down again: what the rest of a scan denies is set aside, reading by reading.

One pattern of all parts explains such scans badly, and in joint refinement the missing part pulls at the pose as hard
as the others hold it. Registered by what agrees with the pattern so far, scan by scan, a part that is not there shows,
and what is lost with it widens the scan's covariance.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.batch.dead_taxels import silent_taxels
from taxelflow.estimation.template.batch.model_selection import SEEN, first_fit, solved_from, tracker_of
from taxelflow.estimation.template.linearization import laid_out, look_up
from taxelflow.numerics.bspline import GAIN

if TYPE_CHECKING:
    from taxelflow.estimation.template.batch.initialization import Tracker
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.solution import Solved
    from taxelflow.messages import Floats

_DENIED = 4.0
"""Standard deviations beyond which a reading is set aside."""
_LOOKS, _ROUNDS = 4, 4
"""How often a scan is registered anew, and all are refined, until the same readings are set aside."""
_MOST = 0.5
"""A scan of which more is denied, by load, is another pattern: nothing of it is set aside."""
_RIGID = 0.05
"""Parts are believed if the pattern of what is left errs by no more than this share: what deforms or rolls errs more,
and everywhere."""


def in_parts(scanned: Scanned, size: Floats) -> tuple[Solved, Scanned] | None:
    """The contact, and its scans without what the pattern does not explain; None if no rigid pattern explains most.

    size: (2,) of a taxel, in pitches.
    """
    dead = silent_taxels(scanned)
    whole = scanned.variance.copy()
    whole[:, dead] = 0.0
    rest = replace(scanned, variance=whole.copy(), bends=scanned.bends.copy())
    if rest.across.any():
        return None
    tracker = tracker_of(rest, size, turns=True)
    unlike = [k for k in tracker.order() if not _learned(tracker, k, whole[k])]
    for k in unlike:  # by all others
        _register(tracker, k, whole[k])
        tracker.learn(k)
    for _ in range(_ROUNDS):
        fit = first_fit(rest, tracker)
        before = rest.variance.copy()
        for k in range(len(rest)):
            rest.variance[k], _ = _left(tracker, k, whole[k])
        if np.array_equal(before, rest.variance):
            break
    solved = solved_from(rest, tracker, fit, turns=True)
    solved.dead = dead
    return (solved, rest) if solved.rough <= _RIGID and solved.sight > SEEN else None


def _learned(tracker: Tracker, k: int, variance: Floats) -> bool:
    """Register scan k and learn from it, unless most of it is denied: a pattern must not learn from where it is not."""
    like = _register(tracker, k, variance)
    if like:
        tracker.learn(k)
    return like


def _register(tracker: Tracker, k: int, variance: Floats) -> bool:
    """Register scan k, and again without what is denied where it lies then; whether most of it is not.

    variance: (taxels,), before.
    """
    tracker.one(k)
    for _ in range(_LOOKS):
        left, like = _left(tracker, k, variance)
        if np.array_equal(left, tracker.scanned.variance[k]):
            break
        tracker.scanned.variance[k] = left
        tracker.one(k)
    return like


def _left(tracker: Tracker, k: int, variance: Floats) -> tuple[Floats, bool]:
    """(taxels,) variance of scan k, 0 where its readings are denied; as it was, and False, if that were most of the
    load.
    """
    scanned, pattern, gain = tracker.scanned, tracker.pattern, tracker.states[k, GAIN]
    readings, ceiling = scanned.readings[k], scanned.ceiling
    taxels = laid_out(scanned.places, scanned.bends[k], readings, variance, ceiling)
    seen = np.empty((2, len(readings)))
    look_up(pattern.coefficients, pattern.doubt, pattern.lattice, taxels, tracker.states[k], seen)
    model = gain * np.nan_to_num(seen[0])
    noise = variance + (tracker.rough_now() * model) ** 2 + gain**2 * seen[1]
    denied = ((readings - model) ** 2 > _DENIED**2 * noise) & ~((readings >= ceiling) & (model > readings))
    load = np.where(variance > 0, np.maximum(readings, model), 0.0)
    like = bool(load[denied].sum() <= _MOST * load.sum())
    return np.where(denied & like, 0.0, variance), like
