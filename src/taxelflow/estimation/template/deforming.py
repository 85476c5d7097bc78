"""Contacts whose pattern changes, because the object rolls or deforms: each scan on the pattern of the few before it.

Nothing is remembered beyond them, so errors add up from scan to scan, and roll cannot be separated from slip.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.hypotheses import FIRST_GAIN_STD
from taxelflow.estimation.template.initialization import Tracker
from taxelflow.estimation.template.observability import sights
from taxelflow.estimation.template.observations import COARSE
from taxelflow.estimation.template.pose_output import Poses, to_pad
from taxelflow.messages import AMBIGUOUS, UNRESOLVED
from taxelflow.numerics.bspline import STATE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.estimation.template.map import Pattern
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.messages import Floats

MEMORY = 4
"""Scans that make the pattern."""
CHANGES = 2.0 * COARSE
"""A contact whose one pattern leaves twice the error that fits begin with has a pattern that changes."""


@dataclass(frozen=True, slots=True)
class _Turning:
    """When a turn is observed, and reported."""

    sight: float = 1.5
    seen_in: float = 0.9
    looks: int = 40
    """A turn is seen if the patterns of a few scans show it so well in the best of many looks; this share is worse."""
    guess: float = 1.0
    """A turn that is no better known than this, rad, is none."""


_TURNING = _Turning()

_LOADED = 0.25
"""The chain begins at the first scan with this share of the largest load."""
_MISFIT = 3.0


@dataclass(slots=True, eq=False)
class Moment:
    """The pattern of a few scans, numbers `which` of a contact, and their states (n, 5)."""

    pattern: Pattern
    scanned: Scanned
    states: Floats
    which: NDArray[np.int64]
    turns: bool


def follow_changing(scanned: Scanned, pitch_m: float, *, turns: bool) -> tuple[Poses, Moment]:
    """Poses of all scans of a contact whose pattern is not one, and the pattern where it is loaded most.

    turns: a turn is known to be seen; else the patterns of the few decide. One that
    adds up to a guess is left out all the same.
    """
    load = np.maximum(scanned.readings, 0.0).sum(axis=1)
    start = int(np.argmax(load >= _LOADED * load.max()))
    ahead = _chain(scanned.taken(slice(start, None)))
    back = _chain(scanned.taken(np.arange(start, -1, -1)))
    states, steps, misfit = (
        np.concatenate([one[:0:-1], other]) for one, other in zip(back[:3], ahead[:3], strict=True)
    )
    sight = max(ahead[3], back[3])
    turns = turns or sight > _TURNING.sight
    pose, noise = _added_up(states, steps, misfit, start, pitch_m, turns=turns)
    if turns and np.median(noise[:, 2, 2]) > _TURNING.guess**2:
        turns = False
        pose, noise = _added_up(states, steps, misfit, start, pitch_m, turns=False)
    quality = np.where(misfit > _MISFIT, UNRESOLVED, AMBIGUOUS).astype(np.uint8)
    return Poses(pose, noise, quality), _moment(scanned, states, int(np.argmax(load)), turns=turns)


def _added_up(
    states: Floats, steps: Floats, misfit: Floats, start: int, pitch_m: float, *, turns: bool
) -> tuple[Floats, Floats]:
    """Poses and their covariances, which grow from scan `start` on, both ways."""
    pose, noise = to_pad(states, steps, np.zeros(2), pitch_m, turns=turns)
    noise *= np.maximum(misfit, 1.0)[:, np.newaxis, np.newaxis] * (1.0 + 1.0 / MEMORY)
    noise[:start] += np.cumsum(noise[start - 1 :: -1], axis=0)[::-1] / MEMORY if start else 0.0
    noise[start + 1 :] += np.cumsum(noise[start + 1 :], axis=0) / MEMORY
    return pose, noise


def _moment(scanned: Scanned, states: Floats, scan: int, *, turns: bool) -> Moment:
    """The pattern that a scan and those before it make."""
    which = np.arange(max(scan - MEMORY, 0), scan + 1)
    few = scanned.taken(which)
    tracker = _tracker(few)
    tracker.states[:] = states[which]
    tracker.forget(len(few), len(few))
    return Moment(tracker.pattern, few, states[which], which, turns)


def _chain(scanned: Scanned) -> tuple[Floats, Floats, Floats, float]:
    """States (scans, 5), their information (scans, 5, 5), chi-square per reading (scans,), how well a turn is seen."""
    tracker = _tracker(scanned)
    steps, misfit, looked = np.zeros((len(scanned), STATE, STATE)), np.zeros(len(scanned)), [0.0]
    looks = max(MEMORY, len(scanned) // _TURNING.looks)
    for k in range(1, len(scanned)):
        tracker.forget(k, MEMORY)
        steps[k], misfit[k] = tracker.one(k)
        if k % looks == 0:
            factor = tracker.sums.solve(tracker.pattern)
            looked.append(sights(tracker.pattern, scanned, tracker.states, factor, k, COARSE).theta)
    steps[0] = steps[1] if len(scanned) > 1 else 1e12 * np.eye(STATE)
    return tracker.states, steps, misfit, float(np.quantile(looked, _TURNING.seen_in))


def _tracker(scanned: Scanned) -> Tracker:
    stiffness = scanned.stiffness(turns=True, gain_std=FIRST_GAIN_STD)
    return Tracker(scanned, 0, stiffness)
