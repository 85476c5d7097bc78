"""Whether the object of a pattern in a stream turns: two hypotheses, until the scans decide."""

from __future__ import annotations

from dataclasses import replace
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.batch.initialization import Tracker
from taxelflow.estimation.template.batch.model_selection import (
    FIRST_GAIN_STD,
    FIRST_ROUGH,
    roughness,
    start_scan,
    unexplained,
)
from taxelflow.estimation.template.observability import sights
from taxelflow.estimation.template.online.local_map import MOST_USUAL, covering, fill, refined
from taxelflow.estimation.template.pose_output import unturned
from taxelflow.numerics.bspline import THETA

if TYPE_CHECKING:
    from taxelflow.estimation.template.bundle_adjustment import Fit
    from taxelflow.estimation.template.map import Pattern
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.online.keyframes import Keyframes
    from taxelflow.estimation.template.online.local_map import Learned
    from taxelflow.messages import Floats

SEEN = 3.0
"""A turn is seen if the pattern tells it so many times better than its noise would."""
_EXPLAINED, _TURN_NEEDED = 1.3, 1.5
"""Without a turn they are not, and worse by so much."""
_RETRACED = 20
"""Up to so many keyframes a turn is looked for from the first one on."""
_FREE = 0.2
"""A fit that leaves less freedom explains anything."""


def with_turn(
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
        pattern = covering(scanned, states, known)
        fill(pattern, scanned, states)
        doubt = pattern.doubt
        free = replace(new, turns=True, pattern=pattern)
        fit = refined(free, pattern, scanned, states)
        tried.append((unexplained(fit, scanned, FIRST_ROUGH), states, free, fit, doubt))
    _, states, free, fit, doubt = min(tried, key=itemgetter(0))
    angled[:], pattern = states, free.pattern
    needed, free.proved = explains(fit, fixed, scanned)
    sight = sights(pattern, scanned, angled, fit.factor, scan, max(free.rough, FIRST_ROUGH))[THETA]
    if not needed and sight * fit.freedom**2 <= SEEN:
        return None
    return free, fit, doubt


def explains(free: Fit, fixed: Fit, scanned: Scanned) -> tuple[bool, bool]:
    """Whether a fit with a turn explains the scans clearly better than one without; and so well that it is proved."""
    least = min(FIRST_ROUGH, roughness(free, scanned), roughness(fixed, scanned))
    left, without = (unexplained(one, scanned, least) for one in (free, fixed))
    needed = free.freedom > _FREE and without > max(_EXPLAINED, _TURN_NEEDED * left)
    return needed, needed and left < MOST_USUAL


def without_turn(new: Learned, scanned: Scanned, states: Floats) -> Fit:
    """The fit if the object did not turn, from states (n, 5) with a turn."""
    fixed = unturned(new.pattern.centre(), states)
    pattern = covering(scanned, fixed, None)
    fill(pattern, scanned, fixed)
    return refined(replace(new, turns=False), pattern, scanned, fixed)


def _retraced(scanned: Scanned) -> Floats:
    """States (n, 5) of keyframes of an object that may turn, one registered after the other as in a batch.

    Poses learned without a turn are far from those with one, and refined they may end in between.
    """
    stiffness = scanned.stiffness(turns=True, gain_std=FIRST_GAIN_STD)
    own = scanned.taken(np.arange(len(scanned)))
    tracker = Tracker(own, start_scan(own), size=np.ones(2), rough=FIRST_ROUGH, stiffness=stiffness)
    tracker.run()
    return tracker.states
