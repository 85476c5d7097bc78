"""How a pattern in a stream is learned, beside the stream."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from threadpoolctl import threadpool_limits

from taxelflow.estimation.template.batch.model_selection import FIRST_GAIN_STD, FIRST_ROUGH
from taxelflow.estimation.template.extrapolation import level_off
from taxelflow.estimation.template.observability import sights
from taxelflow.estimation.template.observations import Scanned
from taxelflow.estimation.template.online.keyframes import Keyframes, most_whole
from taxelflow.estimation.template.online.local_map import (
    CHANGING_ROUGH,
    FIRST_SLACK,
    MOST_USUAL,
    RAW_ROUGH,
    YOUNG,
    Learned,
    covering,
    fill,
    refined,
    usual_of,
)
from taxelflow.estimation.template.online.rotation import SEEN, explains, with_turn, without_turn
from taxelflow.estimation.template.online.scaling import due, placed, regrown, slack_of
from taxelflow.numerics.bspline import STATE, THETA

if TYPE_CHECKING:
    from taxelflow.estimation.template.map import Pattern
    from taxelflow.messages import Floats

_NEAR, _FAR = 0.25, 1.0
"""Keyframes closer than this, in pitches, show the same; further for contacts whose size varies: what the size leaves
unexplained seems to move them."""
_DOUBTFUL, _DECIDE, _WHOLE = 1.0, 4, 0.1
"""Sight below which a turn is dropped; keyframes from which, and share of the load at the border up to which, one is
looked for."""
_TOLD = 0.1
"""Share of the first slack from which on a turn is told: that of a pattern on which two more fits have agreed."""
_CUT_LOOKS_TURNED = 10.0
_CUT_SLACK = 0.5
"""What is added to the first slack, times the share of the load that lies at the border."""
_CHANGES, _LAST = 0.1, 4
"""A pattern with a relative error above the first changes; then the last few make it."""
_SEEN_ENOUGH = 12
"""Keyframes from which a pattern that does not explain them changes."""
_MOST_SLACK = (1.0, 0.3)


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
            covering(scanned, state[np.newaxis], None), Keyframes(scanned, state[np.newaxis], state[np.newaxis]), 1.0
        )
    )
    learned.slack[0] += _CUT_SLACK * most_whole(learned.keyframes)[1]
    return learned


def learn(known: Learned) -> Learned:
    """The pattern anew from its keyframes; poses are refined with it where the object has moved.

    The frame stays as well as the keyframes tell.
    """
    with threadpool_limits(1, user_api="blas"):
        new = _learn(known)
    level_off(new.pattern, new.keyframes.scanned, new.keyframes.states)
    return new


def _forgetting(known: Learned) -> Learned:
    """A pattern of the last few keyframes, where they are: it does not stay for long enough to be refined."""
    old, most = known.keyframes, slice(-_LAST, None)
    keyframes = Keyframes(old.scanned.taken(most), old.states[most], old.angled[most])
    scanned, states = keyframes.scanned, keyframes.states
    pattern = covering(scanned, states, None)
    fill(pattern, scanned, states, CHANGING_ROUGH)
    slack = np.minimum(known.slack + FIRST_SLACK, _MOST_SLACK)
    return replace(
        known,
        pattern=pattern,
        keyframes=keyframes,
        radius=pattern.radius(),
        rough=CHANGING_ROUGH,
        usual=MOST_USUAL,
        gain_std=FIRST_GAIN_STD,
        slack=slack,
        turned=0.0,
        changing=True,
    )


def _learn(known: Learned) -> Learned:
    if known.changing:
        return _forgetting(known)
    if due(known):
        known = replace(known, looked=len(known.keyframes))
        grows = placed(known)
        if grows is not None:
            return grows
    if known.placed:
        grows = regrown(known)
        return grows if grows.rough <= _CHANGES else _forgetting(grows)
    keyframes = known.keyframes
    scanned, states, angled = keyframes.scanned, keyframes.states.copy(), keyframes.angled.copy()
    before = keyframes.states
    pattern = covering(scanned, states, known.pattern)
    count, across = len(keyframes), scanned.across
    rough = RAW_ROUGH if count < YOUNG else min(known.rough, FIRST_ROUGH)
    factor = fill(pattern, scanned, states)
    fit, doubt, spare = None, pattern.doubt, 1.0
    radius = pattern.radius()
    new = replace(known, pattern=pattern, radius=radius, rough=rough, turned=0.0)
    scan, cut_off = most_whole(keyframes)
    if count > 2 and keyframes.spread(radius) > (_FAR if keyframes.grown else _NEAR):
        fit = refined(new, pattern, scanned, states)
        if not known.turns and count >= _DECIDE and cut_off < _WHOLE and not across.any():
            found = with_turn(new, known.pattern, keyframes, angled, fit, scan)
            if found is not None:
                new, fit, doubt = found
                pattern, states, before = new.pattern, angled, keyframes.angled
        factor, spare = fit.factor, fit.freedom
        new.usual = usual_of(fit)
        if new.rough > _CHANGES and count >= _SEEN_ENOUGH:
            return _forgetting(new)
        new.turned = float(np.mean(states[:, THETA] - before[:, THETA]))
        states = reframed(states, keyframes.states, fit.information, pattern)
        new.slack = slack_of(known, states - before - [0.0, 0.0, new.turned, 0.0, 0.0])
    if count >= _DECIDE:
        told = sights(pattern, scanned, states, factor, scan, max(new.rough, FIRST_ROUGH)) * spare**2
        sight = new.sight = float(told[THETA])
        new.sight_of_place = float(told[:THETA][~across].min(initial=np.inf)) if spare < 1.0 else np.inf
        likely = sight > SEEN * (1.0 + _CUT_LOOKS_TURNED * cut_off)
        if fit is not None and known.turns and not (likely or new.proved) and cut_off < _WHOLE:
            _, new.proved = explains(fit, without_turn(new, scanned, states), scanned)
        new.seen = likely or new.proved or (known.seen and sight > _DOUBTFUL)
        new.told = new.seen and (known.told or bool(new.slack[1] < _TOLD * FIRST_SLACK[1]))
        new.turns = new.seen or (new.turns and sight > _DOUBTFUL)
        if not new.turns:
            states[:, THETA] = states[0, THETA]
    pattern.doubt = doubt
    new.keyframes = Keyframes(scanned, states, states if new.turns else angled)
    return new


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
