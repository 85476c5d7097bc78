"""What a pattern in a stream is learned from: keyframes, and the work that goes on beside the stream."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np
from threadpoolctl import threadpool_limits

from taxelflow.estimation.pattern.contact import (
    FIRST_GAIN_STD,
    FIRST_ROUGH,
    LOOSE_TURN,
    level,
    roughness,
    start_scan,
    unexplained,
)
from taxelflow.estimation.pattern.joint import Fit, refine
from taxelflow.estimation.pattern.online import HUBER, gate
from taxelflow.estimation.pattern.pattern import Pattern, Sums
from taxelflow.estimation.pattern.poses import arm_of
from taxelflow.estimation.pattern.register import HELD, register
from taxelflow.estimation.pattern.scanned import Scanned
from taxelflow.estimation.pattern.sight import sights
from taxelflow.estimation.pattern.spline import GAIN, STATE, THETA, in_object
from taxelflow.estimation.pattern.track import MARGIN, SPACING, Tracker

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.estimation.pattern.normal import Factor
    from taxelflow.messages import Floats

_NEAR = 0.25
"""Keyframes closer than this, in pitches, show the same."""
MOST_KEYFRAMES = 60
_YOUNG = 8
_RAW_ROUGH = 0.1
DOUBT = 0.25
"""How much of a pattern's rough doubt counts when scans are registered."""
_SEEN, _DOUBTFUL, _DECIDE = 3.0, 1.0, 4
_EXPLAINED, _TURN_NEEDED, _WHOLE = 1.3, 1.5, 0.1
_CUT_LOOKS_TURNED = 10.0
_RETRACED = 20
"""Up to so many keyframes a turn is looked for from the first one on."""
FIRST_SLACK = (0.0025, 0.0025)
"""Before anything is known of how good a pattern is: pitches^2, rad^2."""
_CUT_SLACK = 0.5
"""What is added, times the share of the load that lies at the border."""
_FORGET = 0.2
_MATURE, _SETTLED = 10, 0.05
_MOST_USUAL = 2.0
_CHANGES, _CHANGING_ROUGH, _LAST = 0.1, 0.05, 4
"""A pattern with a relative error above the first changes; then the last few make it, with an error of the second."""
_FREE = 0.2
"""A fit that leaves less freedom explains anything."""
_ABOUT = 1.0
"""How far, in pitches, a recognised object may lie from where it is looked for."""
_SEEN_ENOUGH = 12
_MOST_SLACK = (1.0, 0.3)


@dataclass(slots=True, eq=False)
class Keyframes:
    """Scans that the pattern is learned from, oldest first, with their states (n, 5).

    angled: (n, 5), where they would be if the object turned, as long as nobody knows whether it does.
    """

    scanned: Scanned
    states: Floats
    angled: Floats

    def __len__(self) -> int:
        return len(self.states)

    def spread(self, radius: float) -> float:
        """How far the keyframes lie from one another, in pitches."""
        extent = np.ptp(self.states[:, :2], axis=0)
        return float(max(extent.max(), radius * np.ptp(self.states[:, THETA])))

    def with_scan(self, t_s: float, reading: Floats, variance: Floats, bend: Floats, state: Floats) -> Keyframes:
        """One more; if there are too many, the one in the most crowded place goes, never the first."""
        old = self.scanned
        states = np.concatenate([self.states, state[np.newaxis]])
        ahead = state.copy()
        ahead[THETA] = self.angled[-1, THETA]
        angled = np.concatenate([self.angled, ahead[np.newaxis]])
        readings = np.concatenate([old.readings, reading[np.newaxis]])
        variances = np.concatenate([old.variance, variance[np.newaxis]])
        bends = np.concatenate([old.bends, bend[np.newaxis]])
        times = np.append(old.t_s, t_s)
        keep: NDArray[np.int64] = np.arange(len(states))
        if len(states) > MOST_KEYFRAMES:
            apart = np.abs(states[:, np.newaxis, : THETA + 1] - states[np.newaxis, :, : THETA + 1])
            apart = apart.sum(axis=2) + 1e6 * np.eye(len(states))
            crowded = np.sort(apart, axis=1)[:, :3].sum(axis=1)
            crowded[0] = crowded[-1] = np.inf
            keep = np.delete(keep, int(np.argmin(crowded)))
        scanned = Scanned(
            times[keep], old.places, readings[keep], variances[keep], old.ceiling, old.delay_s, bends[keep]
        )
        return Keyframes(scanned, states[keep], angled[keep])


@dataclass(slots=True, eq=False)
class Learned:
    """A pattern and what goes with it.

    keyframes: it was learned from, their states in its frame. usual: chi-square per reading of a scan that fits.
    slack: (2,) how wrong poses on the pattern before have been, variance of x and y (pitches^2) and of theta (rad^2).
    fresh: how many of the last keyframes were registered on the pattern before.
    turned: by how much its theta differs from that of the pattern before.
    gain_std: from scan to scan. turns: whether it may turn; proved: whether its scans are explained by turning, and not
    without; seen: whether the pattern shows a turn. sight: how well, and sight_of_place how well where it is, see
    `sights`. changing: it does not stay the same, and only the last keyframes count.
    """

    pattern: Pattern
    keyframes: Keyframes
    radius: float
    rough: float = _RAW_ROUGH
    usual: float = 1.0
    gain_std: float = FIRST_GAIN_STD
    turns: bool = False
    proved: bool = False
    seen: bool = False
    changing: bool = False
    sight: float = 2.0
    sight_of_place: float = np.inf
    turned: float = 0.0
    slack: Floats = field(default_factory=lambda: np.array(FIRST_SLACK))
    fresh: int = 0

    @property
    def mature(self) -> bool:
        """Whether the pattern is known well enough to look for it elsewhere."""
        known = len(self.keyframes) >= _MATURE and self.slack[0] < _SETTLED
        return not self.changing and known and self.rough <= _CHANGING_ROUGH


def first_pattern(
    t_s: float,
    places: Floats,
    reading: Floats,
    variance: Floats,
    ceiling: Floats,
    delay_s: Floats,
    at: Floats | None = None,
) -> Learned:
    """A pattern from a single scan, its origin at the contact's centroid, or at the place `at` (2,)."""
    scanned = Scanned.of(np.array([t_s]), places, reading[np.newaxis], variance[np.newaxis], ceiling, delay_s)
    state = np.array([*(scanned.centroids()[0] if at is None else at), 0.0, 1.0, 0.0])
    learned = learn(
        Learned(
            _covering(scanned, state[np.newaxis], None), Keyframes(scanned, state[np.newaxis], state[np.newaxis]), 1.0
        )
    )
    learned.slack[0] += _CUT_SLACK * _most_whole(learned.keyframes)[1]
    return learned


def recognised(
    known: Learned,
    middle: Floats,
    places: Floats,
    reading: Floats,
    variance: Floats,
    ceiling: Floats,
    theta: float | None = None,
) -> tuple[Floats, Floats, float, int] | None:
    """Where a known pattern explains a scan, or None: state (5,), its information (5, 5), chi-square per reading and
    how many readings. middle: (2,) centroid of the scan.

    The object may lie partly beyond the pad's border, so it is looked for further out, too; where a turn can be seen,
    at all angles, or at those around theta. A few taxels at the border may be explained by many a place along it: it is
    looked for where its middle lies on the line from the pad's through the scan's.
    """
    pattern = known.pattern
    outward = middle / max(float(np.hypot(*middle)), 1e-9)
    steps = np.arange(12) if theta is None else np.arange(-1, 2)
    angles = steps * (np.pi / 6) if known.turns else np.zeros(1)
    angles = angles + (known.keyframes.states[-1, THETA] if theta is None else theta)
    centre, best, found = pattern.centre(), np.inf, None
    information = np.zeros((STATE, STATE))
    stiffness = np.array([_ABOUT**-2, _ABOUT**-2, 1e-6 if known.turns else HELD, 0.0, HELD])
    for gain_std in (max(3.0 * known.gain_std, 0.05), 1.0):
        stiffness[GAIN] = gain_std**-2
        for angle in angles:
            for reach in (0.0, 0.5, 1.0, 1.5, 2.0):
                cos, sin = np.cos(angle), np.sin(angle)
                arm = np.array([cos * centre[0] - sin * centre[1], sin * centre[0] + cos * centre[1]])
                state = np.array([*(middle + reach * known.radius * outward - arm), angle, 1.0, 0.0])
                cost, chi, count = register(
                    pattern.coefficients,
                    DOUBT * pattern.doubt,
                    pattern.lattice,
                    places,
                    np.zeros((3, 0)),
                    reading,
                    variance,
                    ceiling,
                    known.rough,
                    HUBER,
                    state.copy(),
                    stiffness,
                    20,
                    state,
                    information,
                )
                if cost < best and count and chi / count < gate(known.usual, count):
                    best, found = cost, (state.copy(), information.copy(), chi / count, count)
        if found is not None:
            break
    return found


def learn(known: Learned) -> Learned:
    """The pattern anew from its keyframes; poses are refined with it where the object has moved.

    The frame stays as well as the keyframes tell.
    """
    with threadpool_limits(1, user_api="blas"):
        return _learn(known)


def _forgetting(known: Learned) -> Learned:
    """A pattern of the last few keyframes, where they are: it does not stay for long enough to be refined."""
    old, most = known.keyframes, slice(-_LAST, None)
    keyframes = Keyframes(old.scanned.taken(most), old.states[most], old.angled[most])
    scanned, states = keyframes.scanned, keyframes.states
    pattern = _covering(scanned, states, None)
    _solve(pattern, scanned, states, _CHANGING_ROUGH)
    slack = np.minimum(known.slack + FIRST_SLACK, _MOST_SLACK)
    return replace(
        known,
        pattern=pattern,
        keyframes=keyframes,
        radius=_radius(pattern),
        rough=_CHANGING_ROUGH,
        usual=_MOST_USUAL,
        gain_std=FIRST_GAIN_STD,
        slack=slack,
        turned=0.0,
        changing=True,
    )


def _learn(known: Learned) -> Learned:
    if known.changing:
        return _forgetting(known)
    keyframes = known.keyframes
    scanned, states, angled = keyframes.scanned, keyframes.states.copy(), keyframes.angled.copy()
    before = keyframes.states
    pattern = _covering(scanned, states, known.pattern)
    count = len(keyframes)
    rough = _RAW_ROUGH if count < _YOUNG else min(known.rough, FIRST_ROUGH)
    factor = _solve(pattern, scanned, states)
    fit, doubt, spare = None, pattern.doubt, 1.0
    radius = _radius(pattern)
    new = replace(known, pattern=pattern, radius=radius, rough=rough, turned=0.0)
    scan, cut_off = _most_whole(keyframes)
    if count > 2 and keyframes.spread(radius) > _NEAR:
        fit = _refined(new, pattern, scanned, states)
        if not known.turns and count >= _DECIDE and cut_off < _WHOLE:
            turned = _turned(new, known.pattern, keyframes, angled, fit, scan)
            if turned is not None:
                new, fit, doubt = turned
                pattern, states, before = new.pattern, angled, keyframes.angled
        factor, spare = fit.factor, fit.freedom
        new.usual = float(np.clip(fit.reduced / fit.freedom, 1.0, _MOST_USUAL))
        if new.rough > _CHANGES and count >= _SEEN_ENOUGH:
            return _forgetting(new)
        new.turned = float(np.mean(states[:, THETA] - before[:, THETA]))
        states = reframed(states, keyframes.states, fit.information, pattern)
        off = (states - before)[count - known.fresh :]
        if len(off):
            wrong = np.array([np.mean(off[:, :2] ** 2), np.mean((off[:, THETA] - new.turned) ** 2)])
            new.slack = np.maximum(wrong, _FORGET * known.slack)
    if count >= _DECIDE:
        told = sights(pattern, scanned, states, factor, scan, max(new.rough, FIRST_ROUGH)) * spare**2
        sight = new.sight = float(told[THETA])
        new.sight_of_place = float(told[:THETA].min()) if spare < 1.0 else np.inf
        likely = sight > _SEEN * (1.0 + _CUT_LOOKS_TURNED * cut_off)
        if fit is not None and known.turns and not (likely or new.proved) and cut_off < _WHOLE:
            _, new.proved = _explains(fit, _without_turn(new, scanned, states), scanned)
        new.seen = likely or new.proved or (known.seen and sight > _DOUBTFUL)
        new.turns = new.seen or (new.turns and sight > _DOUBTFUL)
        if not new.turns:
            states[:, THETA] = states[0, THETA]
    pattern.doubt = doubt
    new.keyframes = Keyframes(scanned, states, states if new.turns else angled)
    return new


def _turned(
    new: Learned, known: Pattern, keyframes: Keyframes, angled: Floats, fixed: Fit, scan: int
) -> tuple[Learned, Fit, Floats] | None:
    """What is learned if the object turns, its fit and its doubt; None if the keyframes do not say that it does.

    known: the pattern before. angled: (n, 5), where they would be, becomes where they are. fixed: the fit without a
    turn. scan: the one to look at.
    """
    scanned = keyframes.scanned
    starts = [angled, _retraced(scanned)] if len(keyframes) <= _RETRACED else [angled]
    tried = []
    for states in starts:
        pattern = _covering(scanned, states, known)
        _solve(pattern, scanned, states)
        doubt = pattern.doubt
        free = replace(new, turns=True, pattern=pattern)
        fit = _refined(free, pattern, scanned, states)
        tried.append((unexplained(fit, scanned, FIRST_ROUGH), states, free, fit, doubt))
    _, states, free, fit, doubt = min(tried, key=itemgetter(0))
    angled[:], pattern = states, free.pattern
    explains, free.proved = _explains(fit, fixed, scanned)
    sight = sights(pattern, scanned, angled, fit.factor, scan, max(free.rough, FIRST_ROUGH))[THETA]
    if not explains and sight * fit.freedom**2 <= _SEEN:
        return None
    return free, fit, doubt


def _explains(free: Fit, fixed: Fit, scanned: Scanned) -> tuple[bool, bool]:
    """Whether a fit with a turn explains the scans clearly better than one without; and so well that it is proved."""
    least = min(FIRST_ROUGH, roughness(free, scanned), roughness(fixed, scanned))
    left, without = (unexplained(one, scanned, least) for one in (free, fixed))
    explains = free.freedom > _FREE and without > max(_EXPLAINED, _TURN_NEEDED * left)
    return explains, explains and left < _MOST_USUAL


def _without_turn(new: Learned, scanned: Scanned, states: Floats) -> Fit:
    """The fit if the object did not turn, from states (n, 5) with a turn."""
    fixed = states.copy()
    fixed[:, :2] += arm_of(new.pattern.centre(), states)
    fixed[:, THETA] = 0.0
    pattern = _covering(scanned, fixed, None)
    _solve(pattern, scanned, fixed)
    return _refined(replace(new, turns=False), pattern, scanned, fixed)


def _retraced(scanned: Scanned) -> Floats:
    """States (n, 5) of keyframes of an object that may turn, one registered after the other as in a batch.

    Poses learned without a turn are far from those with one, and refined they may end in between.
    """
    stiffness = np.array([0.0, 0.0, LOOSE_TURN, FIRST_GAIN_STD**-2, np.inf])
    own = scanned.taken(np.arange(len(scanned)))
    tracker = Tracker(own, start_scan(own), size=np.ones(2), rough=FIRST_ROUGH, stiffness=stiffness)
    tracker.run()
    return tracker.states


def _solve(pattern: Pattern, scanned: Scanned, states: Floats, rough: float = FIRST_ROUGH) -> Factor:
    """Make pattern what explains the scans at these states (n, 5) best."""
    sums = Sums(pattern)
    sums.add(pattern, scanned, states, rough)
    return sums.solve(pattern)


def _refined(new: Learned, pattern: Pattern, scanned: Scanned, states: Floats) -> Fit:
    """Refine pattern and states (n, 5) jointly, in place; what that says of gains and roughness goes into `new`."""
    young = len(states) < _YOUNG
    turn = LOOSE_TURN if new.turns else np.inf
    gain_std = FIRST_GAIN_STD if young else new.gain_std
    stiffness = np.array([0.0, 0.0, turn, gain_std**-2, np.inf])
    rounds, rough = (6, FIRST_ROUGH) if young else (3, min(new.rough, FIRST_ROUGH))
    fit = refine(pattern, scanned, states, rounds=rounds, rough=rough, stiffness=stiffness)
    if not young:
        new.gain_std = level(pattern, states, fit)
        new.rough = max(roughness(fit, scanned), FIRST_ROUGH * np.sqrt(_YOUNG / len(states)))
    return fit


def reframed(states: Floats, before: Floats, information: Floats, pattern: Pattern) -> Floats:
    """States (n, 5) with the object's frame shifted, and the pattern with it, so that most stay where they were before.

    Those count most of which the scans know most: information (n, 5, 5). Some may have been wrong before, so it is
    their weighted median that stays. Only the origin moves: a turned lattice would have to be learned anew.
    """
    own = np.linalg.inv(information + 1e-9 * np.eye(STATE))
    weight = 1.0 / (own[:, 0, 0] + own[:, 1, 1])
    cos, sin = np.cos(states[:, THETA]), np.sin(states[:, THETA])
    gap = before[:, :2] - states[:, :2]
    body = np.array(
        [
            _weighted_median(cos * gap[:, 0] + sin * gap[:, 1], weight),
            _weighted_median(cos * gap[:, 1] - sin * gap[:, 0], weight),
        ]
    )
    moved = states.copy()
    moved[:, 0] += cos * body[0] - sin * body[1]
    moved[:, 1] += sin * body[0] + cos * body[1]
    pattern.lattice = pattern.lattice - np.array([0.0, *body])
    return moved


def _weighted_median(values: Floats, weight: Floats) -> float:
    order = np.argsort(values)
    reached = np.cumsum(weight[order])
    return float(values[order[np.searchsorted(reached, 0.5 * reached[-1])]])


def _most_whole(keyframes: Keyframes) -> tuple[int, float]:
    """The keyframe least cut by the pad's border, and which share of its load lies there.

    A round contact that is cut looks as if it had an angle.
    """
    x, y = keyframes.scanned.places
    border = (x <= x.min()) | (x >= x.max()) | (y <= y.min()) | (y >= y.max())
    load = np.where(keyframes.scanned.loaded(), keyframes.scanned.readings, 0.0)
    share = load[:, border].sum(axis=1) / np.maximum(load.sum(axis=1), 1e-300)
    best = len(share) - 1 - int(np.argmin(share[::-1]))
    return best, float(share[best])


def _radius(pattern: Pattern) -> float:
    """Of gyration of the pattern, in pitches."""
    h, left, low = pattern.lattice
    c = np.maximum(pattern.coefficients, 0.0)
    x, y = left + h * np.arange(pattern.shape[1]), low + h * np.arange(pattern.shape[0])
    centre, total = pattern.centre(), c.sum() or 1.0
    square = (c.sum(axis=0) @ (x - centre[0]) ** 2 + c.sum(axis=1) @ (y - centre[1]) ** 2) / total
    return float(np.sqrt(max(square, 0.25)))


def _covering(scanned: Scanned, states: Floats, known: Pattern | None) -> Pattern:
    """A pattern of zeros over all that the scans load, on the lattice of the known one."""
    loaded = scanned.loaded()
    reached = np.concatenate([in_object(scanned.places[:, own].T, at) for own, at in zip(loaded, states, strict=True)])
    reached = reached if len(reached) else np.zeros((1, 2))
    low, high = reached.min(axis=0) - MARGIN, reached.max(axis=0) + MARGIN
    pattern = Pattern.empty(low, high, SPACING, 1, np.ones(2), scanned.amplitude)
    if known is not None:
        pattern.smoothing = known.smoothing * (known.amplitude / pattern.amplitude) ** 2
    return pattern
