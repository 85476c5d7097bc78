"""A whole contact: pattern, poses, and what the data say about noise, gain, rotation and dead taxels."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.batch.dead_taxels import silent_taxels
from taxelflow.estimation.template.batch.initialization import Tracker
from taxelflow.estimation.template.bundle_adjustment import Fit, refine
from taxelflow.estimation.template.observability import sights
from taxelflow.estimation.template.pose_output import TOO_ROUGH, unturned
from taxelflow.estimation.template.solution import Solved
from taxelflow.numerics.bspline import GAIN, STATE, THETA

if TYPE_CHECKING:
    from taxelflow.estimation.template.map import Pattern
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.messages import Floats

FIRST_ROUGH, _LEAST_ROUGH, _MOST_ROUGH = 0.02, 0.002, 0.2
FIRST_GAIN_STD, _LEAST_GAIN_STD = 0.3, 0.02
_STEADY_GAIN_STD, _SCANT = 0.1, 0.8
"""A load that hardly varies is tried, too, where gains vary but less than this share of the readings checks the fit."""
SEEN = 4.0
"""A turn is observable if the pattern tells it so many times better than its own noise would."""
_TURN_NEEDED, _AS_NOISE = 1.1, 1.0
"""... or if the scans fit so many times worse without it, and worse than noise lets them."""
_SMALL_TURN, _PAID, _FEW, _FEW_ROUNDS = 0.5, 1.25, 100, 8
"""A turn that ranges over more, rad, is real only if the scans fit so many times worse without it. So many scans,
in so many rounds, show it. A smaller one, if it goes with the way, may be as well a shift of another pattern."""
_ROUND, _EXPLAINED = 1.0, 1.3
"""A pattern that shows less of a turn than this, and leaves less of the scans unexplained, needs no second look."""
_HOPELESS = 1.5
"""A first fit without a turn that leaves so much unexplained is not worth refining before one with a turn was tried."""
_GLIMPSE, _LIKELY = 4, 3.0
"""After so many scans a pattern shows whether a turn is likely to be seen."""
_MOST_DEAD = 8
_DEAD_GAIN = 0.8
"""... and the fit without it is at least so much better."""
_DEAD, _LOADED_ENOUGH = 0.5, 400.0
"""A taxel is dead if it gives less than this share of what the pattern puts on it, which is so many variances."""


def unexplained(fit: Fit, scanned: Scanned, rough: float) -> float:
    """Chi-square per degree of freedom if the pattern's relative error were `rough`."""
    used = (fit.weight > 0) & (scanned.variance > 0)
    variance = scanned.variance[used] + (rough * np.maximum(fit.model[used], 0.0)) ** 2
    return float(np.minimum(fit.residual[used] ** 2 / variance, 25.0).mean() / fit.freedom) if used.any() else 0.0


def solve_contact(scanned: Scanned, size: Floats) -> Solved:
    """Pattern and poses of all scans of a contact, by maximum likelihood. size: (2,) of a taxel, in pitches."""
    dead = silent_taxels(scanned).tolist()
    scanned.variance[:, dead] = 0.0
    solved = _solve_either(scanned, size)
    while len(dead) < _MOST_DEAD:
        worst = _dead_taxel(scanned, solved.fit)
        if worst is None:
            break
        kept = scanned.variance[:, worst].copy()
        scanned.variance[:, worst] = 0.0
        without = _solve_either(scanned, size)
        if unexplained(without.fit, scanned, solved.rough) > _DEAD_GAIN * unexplained(
            solved.fit, scanned, solved.rough
        ):
            scanned.variance[:, worst] = kept
            break
        dead.append(worst)
        solved = without
    if solved.fit.freedom < _SCANT and solved.gain_std > _LEAST_GAIN_STD:
        solved = _steadier(solved, scanned, size)
    solved.dead = np.array(dead, np.int64)
    return solved


def _steadier(solved: Solved, scanned: Scanned, size: Floats) -> Solved:
    """The contact from a start with nearly equal gains if that is likelier, else as it was.

    Scans of an object no larger than a taxel say little of place and gain each, and a pattern that is hardly checked
    fits many of both: which of them is found depends on the start.
    """
    tracker = tracker_of(scanned, size, turns=solved.turns, gain_std=_STEADY_GAIN_STD)
    steady = solved_from(scanned, tracker, first_fit(scanned, tracker), turns=solved.turns)
    rough, smoothing = min(solved.rough, steady.rough), min(solved.pattern.smoothing, steady.pattern.smoothing)
    gain_variance = solved.gain_std * steady.gain_std

    def cost(one: Solved) -> float:
        """-2 log posterior by what both starts have learned; all readings are in it: off a lattice there is no load."""
        used = (scanned.variance > 0) & ((scanned.readings > 0) | (one.fit.model > 0))
        model = np.maximum(one.fit.model[used], 0.0)
        variance = scanned.variance[used] + (rough * model) ** 2
        chi = np.minimum((scanned.readings[used] - model) ** 2 / variance, 25.0).sum()
        return float(chi + np.sum((one.states[:, GAIN] - 1.0) ** 2) / gain_variance + smoothing * one.fit.bending)

    return steady if steady.rough <= TOO_ROUGH and cost(steady) < cost(solved) else solved


def _solve_either(scanned: Scanned, size: Floats) -> Solved:
    """With rotation if the data show that it can be seen, else without."""
    held = tracker_of(scanned, size, turns=False)
    if scanned.across.any():
        return solved_from(scanned, held, first_fit(scanned, held), turns=False)
    turning = tracker_of(scanned, size, turns=True)
    turning.run(_GLIMPSE)
    factor = turning.sums.solve(turning.pattern)
    likely = sights(turning.pattern, scanned, turning.states, factor, turning.start, FIRST_ROUGH)[THETA] > _LIKELY
    fixed = None
    if not likely:
        first = first_fit(scanned, held)
        if unexplained(first, scanned, FIRST_ROUGH) < _HOPELESS:
            fixed = solved_from(scanned, held, first, turns=False)
            if fixed.sight < _ROUND and unexplained(fixed.fit, scanned, FIRST_ROUGH) < _EXPLAINED:
                return fixed
    free = solved_from(scanned, turning, first_fit(scanned, turning), turns=True)
    if _seen_to_turn(free, scanned, size):
        return free
    if fixed is None:
        fixed = solved_from(scanned, held, first_fit(scanned, held), turns=False)
    rough = min(free.rough, fixed.rough)
    least = _TURN_NEEDED if _turned(free) < _SMALL_TURN else _PAID
    without = unexplained(fixed.fit, scanned, rough)
    needed = free.sight > _ROUND and without > max(_AS_NOISE, least * unexplained(free.fit, scanned, rough))
    return free if needed else fixed


def _turned(solved: Solved) -> float:
    """Range of the angles, rad."""
    return float(np.ptp(np.unwrap(solved.states[:, THETA])))


def _seen_to_turn(free: Solved, scanned: Scanned, size: Floats) -> bool:
    """Whether the pattern of a contact shows how it turns: noise in the pattern of a round one seems to."""
    if free.sight <= SEEN or _turned(free) < _SMALL_TURN:
        return free.sight > SEEN
    which = np.unique(np.linspace(0, len(scanned) - 1, _FEW).astype(np.int64))
    few, states = scanned.taken(which), free.states[which]
    tracker = tracker_of(few, size, turns=False)
    tracker.start = 0
    tracker.states[:] = unturned(free.pattern.centre(), states)
    tracker.forget(len(few), len(few))
    pattern, rough = tracker.pattern, free.rough
    fixed = refine(pattern, few, tracker.states, rounds=_FEW_ROUNDS, rough=rough, stiffness=tracker.stiffness)
    own = replace(
        free.fit, residual=free.fit.residual[which], weight=free.fit.weight[which], model=free.fit.model[which]
    )
    return unexplained(fixed, few, rough) > _PAID * unexplained(own, few, rough)


def start_scan(scanned: Scanned) -> int:
    """The scan to begin with: well loaded, its contact nearest to the pad's centre."""
    load = scanned.load().sum(axis=1)
    away = np.hypot(*(scanned.centroids() - scanned.middle).T)
    return int(np.argmin(np.where(load >= 0.5 * load.max(), away, np.inf)))


def tracker_of(scanned: Scanned, size: Floats, *, turns: bool, gain_std: float = FIRST_GAIN_STD) -> Tracker:
    """The tracker that a contact begins with. gain_std: of the gains around 1."""
    stiffness = scanned.stiffness(turns=turns, gain_std=gain_std)
    return Tracker(scanned, start_scan(scanned), size=size, rough=FIRST_ROUGH, stiffness=stiffness)


def first_fit(scanned: Scanned, tracker: Tracker) -> Fit:
    """Track all scans that are left, and refine them jointly."""
    tracker.run()
    scanned.bend(tracker.states)
    return refine(tracker.pattern, scanned, tracker.states, rounds=4, rough=FIRST_ROUGH, stiffness=tracker.stiffness)


def solved_from(scanned: Scanned, tracker: Tracker, fit: Fit, *, turns: bool) -> Solved:
    """Refine further from the first fit, learning gain and roughness in between."""
    pattern, states, rough = tracker.pattern, tracker.states, FIRST_ROUGH
    start, stiffness = tracker.start, tracker.stiffness.copy()
    gain_std = FIRST_GAIN_STD
    for rounds in (6, 10):
        gain_std = level(pattern, states, fit)
        stiffness[GAIN] = gain_std**-2
        rough = roughness(fit, scanned)
        scanned.bend(states)
        fit = refine(pattern, scanned, states, rounds=rounds, rough=rough, stiffness=stiffness)
    sight = float(sights(pattern, scanned, states, fit.factor, start, rough)[THETA]) * fit.freedom**2
    return Solved(pattern, states, fit, rough, gain_std, turns, np.zeros(0, np.int64), sight)


def level(pattern: Pattern, states: Floats, fit: Fit) -> float:
    """Make the mean gain of states (scans, 5) 1, in place, the pattern taking the rest; the gains' standard deviation.

    Both from the scans that determine theirs best.
    """
    variance = np.linalg.inv(fit.information + 1e-9 * np.eye(STATE))[:, GAIN, GAIN]
    well = variance <= np.quantile(variance, 0.6)
    mean = max(float(np.median(states[well, GAIN])), 0.05)
    low, high = np.quantile(states[well, GAIN], (0.05, 0.95))
    spread = float(high - low) / 3.29  # of a normal distribution; a load that changes for a short time counts, too
    states[:, GAIN] /= mean
    pattern.coefficients = pattern.coefficients * mean
    pattern.smoothing /= mean**2
    return float(np.sqrt(max(spread**2 - float(np.median(variance[well])), _LEAST_GAIN_STD**2)))


def roughness(fit: Fit, scanned: Scanned) -> float:
    """Error of the pattern relative to itself that makes chi-square of the loaded taxels what it should be."""
    high = (fit.weight > 0) & (fit.model > 5.0 * np.sqrt(scanned.variance))
    squared, model, variance = fit.residual[high] ** 2, fit.model[high] ** 2, scanned.variance[high]
    wanted = fit.freedom * len(squared)

    def excess(rough: float) -> float:
        return float(np.minimum(squared / (variance + rough**2 * model), 25.0).sum()) - wanted

    low, top = _LEAST_ROUGH, _MOST_ROUGH
    if not len(squared) or excess(low) <= 0:
        return low
    for _ in range(30):
        middle = float(np.sqrt(low * top))
        low, top = (middle, top) if excess(middle) > 0 else (low, middle)
    return top


def _dead_taxel(scanned: Scanned, fit: Fit) -> int | None:
    """The taxel that answers least to what the pattern surely puts on it, if it is too little."""
    known = (scanned.variance > 0) & (fit.model > 0)
    model = np.where(known, fit.model, 0.0)
    power = (model**2).sum(axis=0)
    answer = (model * scanned.readings).sum(axis=0)
    noise = (model**2 * scanned.variance).sum(axis=0)
    share = np.where(power**2 > _LOADED_ENOUGH * noise, answer / np.maximum(power, 1e-300), np.inf)
    worst = int(np.argmin(share))
    return worst if share[worst] < _DEAD else None
