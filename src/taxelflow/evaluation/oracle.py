"""How well slips can be detected live at a given rate of false alarms: by an oracle that knows all but the time.

It knows where the object rests, how fast and where to it will slip, and that errors are independent and as large as the
method's covariance. It begins a slip when the sum of Shiryaev and Roberts over all times at which it may have
begun exceeds what the rate allows, and calls scans still as soon as that is likelier than not. Where errors are as
large as the covariance, that is close to the best there is.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.messages import Bools, Floats

_FINE = 4
"""Times within an interval at which a slip may begin or end."""
_LENIENT = 0.02
"""The sum leaps over its threshold, the further the larger the steps, and alarms so much more seldom than it might: the
oracle may begin as if far more alarms were allowed.
"""
_FLOOR_M = 1e-6
"""Least standard deviation of a pose; some methods report 0."""
_STOPS_PER_S = 3.6
"""One over the mean duration of the rig's slips."""
_LOOKS_BACK, _LOOKS_ON = 60, 30
"""Scans before a slip's begin and after its end: farther away nothing is decided."""


def called(
    t_s: Floats, place: Floats, covariance: Floats, runs: Sequence[tuple[int, int]], alarm_s: float, seed: int
) -> Bools:
    """Flags (scans,): slipping, as the oracle calls it.

    place: (scans, 2), where the object is in truth. covariance: (scans, 2, 2) of its pose. runs: the slips, first scan
    and first after. alarm_s: mean time between false alarms. seed: of the errors.
    """
    covariance = covariance + _FLOOR_M**2 * np.eye(2)
    root, sure = (np.asarray(of(covariance), dtype=np.float64) for of in (np.linalg.cholesky, np.linalg.inv))
    seen = place + np.einsum("kxy,ky->kx", root, np.random.default_rng(seed).standard_normal(place.shape))
    slipping, rests = np.zeros(len(t_s), dtype=np.bool_), 0
    for (begin, end), (following, _) in pairwise([*runs, (len(t_s), 0)]):
        if end - begin > 1:
            speed = (place[end - 1] - place[begin]) / (t_s[end - 1] - t_s[begin])
            before, after = slice(max(rests, begin - _LOOKS_BACK), end), slice(begin, min(end + _LOOKS_ON, following))
            begun = _begun(t_s[before], seen[before] - place[max(begin - 1, 0)], sure[before], speed, alarm_s)
            on_line = place[begin] + speed * (t_s[after] - t_s[begin])[:, np.newaxis]
            goes_on = ~_stopped(t_s[after], seen[after] - on_line, sure[after], speed)
            slipping[before] |= begun
            slipping[after] = goes_on & (slipping[after] | (np.arange(after.start, after.stop) >= end) & begun.any())
        rests = end
    return slipping


def _begun(t_s: Floats, off: Floats, sure: Floats, speed: Floats, alarm_s: float) -> Bools:
    """From which scan on a slip is called: poses (scans, 2) off the place where the object rests."""
    begun: Bools = np.maximum.accumulate(_sum(t_s, off, sure, speed) > _LENIENT * alarm_s)
    return begun


def _stopped(t_s: Floats, off: Floats, sure: Floats, speed: Floats) -> Bools:
    """In which scans a stop is likelier than not: poses (scans, 2) off the line on which the object would go on."""
    return _sum(t_s, off, sure, -speed) * _STOPS_PER_S > 1.0


def _sum(t_s: Floats, off: Floats, sure: Floats, speed: Floats) -> Floats:
    """(scans,), s: over all times, of the likelihood ratio that poses (scans, 2), sure (scans, 2, 2), move off since
    then at this speed (2,) against that they do not.
    """
    count = _FINE * (len(t_s) - 1)
    share_s = (t_s[-1] - t_s[0]) / count
    times = t_s[0] + share_s * (np.arange(count) + 0.5)
    way = np.maximum(t_s[:, np.newaxis] - times, 0.0)[..., np.newaxis] * speed
    gain = np.einsum("kjx,kxy,ky->kj", way, sure, off) - 0.5 * np.einsum("kjx,kxy,kjy->kj", way, sure, way)
    likelihood = np.exp(np.minimum(np.cumsum(gain, axis=0), 600.0))
    whole: Floats = share_s * (likelihood * (times <= t_s[:, np.newaxis])).sum(axis=1)
    return whole
