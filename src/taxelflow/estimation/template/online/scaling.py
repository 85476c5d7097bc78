"""Whether the contact of a pattern in a stream grows while the object stays, and how such a pattern is learned.

Until that is known, what grows at a border seems to move, and the pattern is learned from where it seemed to be. An
object that stays where it is explains all keyframes at once, and tells about which point its contact grows.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.batch.model_selection import FIRST_ROUGH, start_scan, unexplained
from taxelflow.estimation.template.models.scaling import centre, in_place
from taxelflow.estimation.template.online.keyframes import Keyframes
from taxelflow.estimation.template.online.local_map import (
    CHANGING_ROUGH,
    FIRST_SLACK,
    Learned,
    covering,
    fill,
    refined,
    usual_of,
)
from taxelflow.numerics.bspline import THETA

if TYPE_CHECKING:
    from taxelflow.messages import Floats

_MORE = 1.5
"""One looks again when there are so many times more keyframes."""
_EXPLAINED, _STAYS = 1.3, 0.5
"""An object that stays explains them up to this chi-square per reading, within so many pitches."""
_FORGET = 0.2
"""Of the slack before, what stays when keyframes have hardly moved."""


def due(known: Learned) -> bool:
    """Whether to look for growth: where sizes differ, and a pattern that grows is not known, or does not fit."""
    fits = known.placed and known.rough <= CHANGING_ROUGH
    return known.keyframes.grown and not fits and len(known.keyframes) >= _MORE * known.looked


def placed(known: Learned) -> Learned | None:
    """What is learned if the object has stayed while its contact grew; None if that does not explain the keyframes."""
    own = known.keyframes.scanned
    scanned = replace(own, delay_s=np.zeros_like(own.delay_s), bends=np.zeros_like(own.bends))
    load = scanned.load().sum(axis=1)
    states, pattern, fit, rough, gain_std = in_place(
        scanned, np.ones(2), load, start_scan(scanned), FIRST_ROUGH, turns=known.turns
    )
    moved = float(np.ptp(states[:, :2], axis=0).max())
    if unexplained(fit, scanned, FIRST_ROUGH) > _EXPLAINED or moved > _STAYS:
        return None
    return replace(
        known,
        pattern=pattern,
        keyframes=Keyframes(replace(own, bends=scanned.bends), states, states),
        radius=pattern.radius(),
        rough=rough,
        usual=usual_of(fit),
        gain_std=gain_std,
        slack=np.array(FIRST_SLACK),
        turned=0.0,
        placed=True,
    )


def regrown(known: Learned) -> Learned:
    """The pattern of a contact that grows, and the poses on it, anew from the keyframes."""
    keyframes = known.keyframes
    scanned, states = keyframes.scanned, keyframes.states.copy()
    pattern = covering(scanned, states, known.pattern)
    fill(pattern, scanned, states)
    doubt = pattern.doubt
    new = replace(known, pattern=pattern, radius=pattern.radius(), turned=0.0)
    fit = refined(new, pattern, scanned, states)
    centre(pattern, scanned, states)
    new.usual = usual_of(fit)
    off = states - keyframes.states
    new.slack = slack_of(known, off - np.median(off, axis=0))
    pattern.doubt = doubt
    new.keyframes = Keyframes(scanned, states, states)
    return new


def slack_of(known: Learned, off: Floats) -> Floats:
    """(2,), see `Learned`: from how far the last keyframes were from where they are, off (n, 5)."""
    fresh = off[len(off) - known.fresh :]
    if not len(fresh):
        return known.slack
    wrong = np.array([np.mean(fresh[:, :2] ** 2), np.mean(fresh[:, THETA] ** 2)])
    slack: Floats = np.maximum(wrong, _FORGET * known.slack)
    return slack
