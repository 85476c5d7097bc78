"""Contacts whose pattern changes, because the object rolls or deforms: each scan on the pattern of the few before it.

Nothing is remembered beyond them, so errors add up from scan to scan, and roll cannot be told from slip.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.pattern.contact import sight_of_turn
from taxelflow.estimation.pattern.poses import Poses, to_pad
from taxelflow.estimation.pattern.spline import STATE
from taxelflow.estimation.pattern.track import Tracker
from taxelflow.messages import AMBIGUOUS, UNRESOLVED

if TYPE_CHECKING:
    from taxelflow.estimation.pattern.scanned import Scanned
    from taxelflow.messages import Floats

MEMORY = 4
"""Scans that make the pattern."""
ROUGH = 0.05
_SIGHT = 1.5
_LOADED = 0.25
"""The chain begins at the first scan with this share of the largest load."""
_MISFIT = 3.0


def follow_changing(scanned: Scanned, size: Floats, pitch_m: float, *, turns: bool) -> Poses:
    """Poses of all scans of a contact whose pattern is not one.

    size: (2,) of a taxel, in pitches. turns: a turn is known to be seen; else the first scans decide.
    """
    load = np.maximum(scanned.readings, 0.0).sum(axis=1)
    start = int(np.argmax(load >= _LOADED * load.max()))
    ahead = _chain(scanned.taken(slice(start, None)), size)
    back = _chain(scanned.taken(slice(start, None, -1)), size)
    states, steps, misfit = (
        np.concatenate([one[:0:-1], other]) for one, other in zip(back[:3], ahead[:3], strict=True)
    )
    sight = max(ahead[3], back[3])
    turns = turns or sight > _SIGHT
    pose, noise = to_pad(states, steps, np.zeros(2), np.inf, pitch_m, turns=turns)
    noise *= np.maximum(misfit, 1.0)[:, np.newaxis, np.newaxis] * (1.0 + 1.0 / MEMORY)
    quality = np.where(misfit > _MISFIT, UNRESOLVED, AMBIGUOUS).astype(np.uint8)
    return Poses(pose, np.cumsum(noise, axis=0) / MEMORY + noise, quality)


def _chain(scanned: Scanned, size: Floats) -> tuple[Floats, Floats, Floats, float]:
    """States (scans, 5), their information (scans, 5, 5), chi-square per reading (scans,), how well a turn is seen."""
    tracker = Tracker(
        scanned,
        0,
        spacing=0.5,
        quadrature=1,
        size=size,
        rough=ROUGH,
        stiffness=np.array([0.0, 0.0, 1e-3, 0.3**-2, np.inf]),
        step=np.array([0.3, 0.1]),
    )
    steps, misfit, sight = np.zeros((len(scanned), STATE, STATE)), np.zeros(len(scanned)), 0.0
    for k in range(1, len(scanned)):
        tracker.forget(k, MEMORY)
        steps[k], misfit[k] = tracker.one(k)
        if k == MEMORY:
            factor = tracker.sums.solve(tracker.pattern)
            sight = sight_of_turn(tracker.pattern, scanned, tracker.states, factor, k, ROUGH)
    steps[0] = steps[1] if len(scanned) > 1 else 1e12 * np.eye(STATE)
    return tracker.states, steps, misfit, sight
