"""An upper bound for live slip detection at a given rate of false alarms: an oracle that knows all but the time.

It knows where the object rests and the velocity at which it will slip. Errors are independent, with the method's
covariance. It reports a slip when the Shiryaev-Roberts statistic, a sum over all possible times of onset, exceeds the
threshold of that rate, and its end as soon as that is more probable than not. If the covariance is right, no detector
is much better.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.slip.measurement import LEAST_STD

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.messages import Bools, Floats

_STOPS_PER_S = 3.6
"""One over the mean duration of the rig's slips."""


def called(
    t_s: Floats, place: Floats, covariance: Floats, runs: Sequence[tuple[int, int]], alarm_s: float, seed: int
) -> Bools:
    """Flags (scans,), whether the oracle reports a slip.

    place: (scans, 2), where the object is in truth. covariance: (scans, 2, 2) of its pose. runs: the slips, first scan
    and first after. alarm_s: mean time between false alarms. seed: of the errors.
    """
    covariance = covariance + LEAST_STD.m**2 * np.eye(2)
    root, information = (np.asarray(of(covariance), dtype=np.float64) for of in (np.linalg.cholesky, np.linalg.inv))
    seen = place + np.einsum("kxy,ky->kx", root, np.random.default_rng(seed).standard_normal(place.shape))
    slipping, rests = np.zeros(len(t_s), dtype=np.bool_), 0
    for (begin, end), (following, _) in pairwise([*runs, (len(t_s), 0)]):
        if end - begin > 1:
            speed = (place[end - 1] - place[begin]) / (t_s[end - 1] - t_s[begin])
            before, after = (
                slice(max(rests, begin - 60), end),
                slice(begin, min(end + 30, following)),
            )
            begun = _begun(t_s[before], seen[before] - place[max(begin - 1, 0)], information[before], speed, alarm_s)
            on_line = place[begin] + speed * (t_s[after] - t_s[begin])[:, np.newaxis]
            goes_on = ~_stopped(t_s[after], seen[after] - on_line, information[after], speed)
            slipping[before] |= begun
            slipping[after] = goes_on & (slipping[after] | (np.arange(after.start, after.stop) >= end) & begun.any())
        rests = end
    return slipping


def _begun(t_s: Floats, off: Floats, information: Floats, speed: Floats, alarm_s: float) -> Bools:
    """(scans,), whether a slip has been reported. off: (scans, 2), poses less the place of rest.

    The statistic overshoots its threshold by far in a single scan: a 50th of it keeps the rate of false alarms.
    """
    begun: Bools = np.maximum.accumulate(_statistic(t_s, off, information, speed) > 0.02 * alarm_s)
    return begun


def _stopped(t_s: Floats, off: Floats, information: Floats, speed: Floats) -> Bools:
    """(scans,), whether a stop is more probable than not. off: (scans, 2), poses less the line of continued motion."""
    return _statistic(t_s, off, information, -speed) * _STOPS_PER_S > 1.0


def _statistic(t_s: Floats, off: Floats, information: Floats, speed: Floats, times_a_scan: int = 4) -> Floats:
    """(scans,), s: Shiryaev-Roberts statistic, the integral of the likelihood ratio over the time of onset.

    The ratio is that of motion since then at velocity `speed` (2,) to no motion, for poses off (scans, 2) with
    `information` (scans, 2, 2).
    """
    count = times_a_scan * (len(t_s) - 1)
    share_s = (t_s[-1] - t_s[0]) / count
    times = t_s[0] + share_s * (np.arange(count) + 0.5)
    way = np.maximum(t_s[:, np.newaxis] - times, 0.0)[..., np.newaxis] * speed
    gain = np.einsum("kjx,kxy,ky->kj", way, information, off) - 0.5 * np.einsum(
        "kjx,kxy,kjy->kj", way, information, way
    )
    likelihood = np.exp(np.minimum(np.cumsum(gain, axis=0), 600.0))
    whole: Floats = share_s * (likelihood * (times <= t_s[:, np.newaxis])).sum(axis=1)
    return whole
