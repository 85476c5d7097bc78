"""Odometry of contacts whose pattern changes, because the object rolls or deforms.

Each scan is registered to the pattern of the `ODOMETRY.memory` scans before it. Errors add up from scan to scan, and
rolling cannot be separated from slip.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.template.initialization import IncrementalMapper
from taxelflow.estimation.template.levenberg_marquardt import HELD
from taxelflow.estimation.template.observability import observability
from taxelflow.estimation.template.observations import COARSE, LARGEST
from taxelflow.estimation.template.pose_output import Poses, to_pad
from taxelflow.messages import AMBIGUOUS, UNRESOLVED
from taxelflow.numerics.bspline import STATE
from taxelflow.numerics.rounding import LINEAR_RAD

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.estimation.template.map import Pattern
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.messages import Floats


class _Odometry(NamedTuple):
    """A pattern that changes is followed from scan to scan."""

    memory: int = 4
    """Scans that the pattern is estimated from."""
    loaded: float = 0.25
    """The odometry begins at the first scan with this share of the largest load."""
    misfit: float = 3.0
    """Chi-square per reading above which a scan is unresolved."""
    observability: float = 1.5
    """A rotation is observable if its observability exceeds this in a tenth of the sampled scans."""
    samples: int = 40
    """Number of scans in which the observability is computed, at most."""


ODOMETRY = _Odometry()


@dataclass(slots=True, eq=False)
class Moment:
    """The pattern of a few scans, numbers `which` of a contact, and their states (n, 5)."""

    pattern: Pattern
    scanned: Scanned
    states: Floats
    which: NDArray[np.int64]
    turns: bool


def follow_changing(scanned: Scanned, pitch_m: float, *, turns: bool) -> tuple[Poses, Moment]:
    """Poses of all scans of a contact whose pattern changes, and its pattern at the largest load.

    turns: the rotation is known to be observable; else the short patterns decide. It is left out if its accumulated
    standard deviation is too large.
    """
    load = np.maximum(scanned.readings, 0.0).sum(axis=1)
    start = int(np.argmax(load >= ODOMETRY.loaded * load.max()))
    ahead = _chain(scanned.taken(slice(start, None)))
    back = _chain(scanned.taken(np.arange(start, -1, -1)))
    states, steps, misfit = (
        np.concatenate([one[:0:-1], other]) for one, other in zip(back[:3], ahead[:3], strict=True)
    )
    seen = max(ahead[3], back[3])
    turns = turns or seen > ODOMETRY.observability
    pose, noise = _added_up(states, steps, misfit, start, pitch_m, turns=turns)
    if turns and np.median(noise[:, 2, 2]) > LINEAR_RAD**2:
        turns = False
        pose, noise = _added_up(states, steps, misfit, start, pitch_m, turns=False)
    quality = np.where(misfit > ODOMETRY.misfit, UNRESOLVED, AMBIGUOUS).astype(np.uint8)
    return Poses(pose, noise, quality), _moment(scanned, states, int(np.argmax(load)), turns=turns)


def _added_up(
    states: Floats, steps: Floats, misfit: Floats, start: int, pitch_m: float, *, turns: bool
) -> tuple[Floats, Floats]:
    """Poses and their covariances, which grow from scan `start` on, both ways."""
    pose, noise = to_pad(states, steps, np.zeros(2), pitch_m, turns=turns)
    noise *= np.maximum(misfit, 1.0)[:, np.newaxis, np.newaxis] * (1.0 + 1.0 / ODOMETRY.memory)
    noise[:start] += np.cumsum(noise[start - 1 :: -1], axis=0)[::-1] / ODOMETRY.memory if start else 0.0
    noise[start + 1 :] += np.cumsum(noise[start + 1 :], axis=0) / ODOMETRY.memory
    return pose, noise


def _moment(scanned: Scanned, states: Floats, scan: int, *, turns: bool) -> Moment:
    """The pattern of a scan and those before it."""
    which = np.arange(max(scan - ODOMETRY.memory, 0), scan + 1)
    few = scanned.taken(which)
    mapper = IncrementalMapper(few, 0, turns=True)
    mapper.states[:] = states[which]
    mapper.keep_last(len(few), len(few))
    return Moment(mapper.pattern, few, states[which], which, turns)


def _chain(scanned: Scanned) -> tuple[Floats, Floats, Floats, float]:
    """States (scans, 5), their information (scans, 5, 5), chi-square per reading (scans,), observability of theta."""
    mapper = IncrementalMapper(scanned, 0, turns=True)
    steps, misfit, observed = np.zeros((len(scanned), STATE, STATE)), np.zeros(len(scanned)), [0.0]
    every = max(ODOMETRY.memory, len(scanned) // ODOMETRY.samples)
    for k in range(1, len(scanned)):
        mapper.keep_last(k, ODOMETRY.memory)
        steps[k], misfit[k] = mapper.register(k)
        if k % every == 0:
            factor = mapper.information.solve(mapper.pattern)
            observed.append(observability(mapper.pattern, scanned, mapper.states, factor, k, COARSE))
    steps[0] = steps[1] if len(scanned) > 1 else HELD * np.eye(STATE)
    return mapper.states, steps, misfit, float(np.quantile(observed, LARGEST))
