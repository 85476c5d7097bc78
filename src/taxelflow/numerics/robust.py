"""Robust statistics: how much a residual counts, whether a scan fits its model, spread from a median."""

from __future__ import annotations

import numpy as np

from taxelflow.messages import Floats
from taxelflow.runtime.compiling import inlined, kernel

MAD_TO_SIGMA = 1.4826
"""Standard deviation of normal numbers over their median absolute deviation, which is their upper quartile."""
HUBER = 5.0
"""Standard deviations above which a reading of a registered scan weighs less."""
OUTLIER = HUBER**2
"""The most that one reading adds to chi-square, and from which on a measurement is an outlier."""
FITS = 1.5
"""Reduced chi-square up to which a scan fits so well that nothing else is tried, or learned from what is left."""
CLEARLY = 1.5
"""Times as much as another hypothesis that one must leave unexplained to be clearly worse."""
CHEAPER = 1e-3
"""What a further start of a registration must lower the cost by, to be more than rounding."""
GATE = 2.0
"""A scan fits up to this many times the reduced chi-square that is expected."""


def robust_std(values: Floats, middle: float) -> float:
    """Standard deviation of numbers about their median, `middle`, by the median of their absolute deviations."""
    return MAD_TO_SIGMA * float(np.median(np.abs(values - middle)))


def quantile(values: Floats, share: float) -> float:
    """That of numbers (n,), at least one, as by `np.quantile`, which takes ten times as long."""
    ordered, place = np.sort(values), (len(values) - 1) * share
    before = int(place)
    low, high, beyond = float(ordered[before]), float(ordered[min(before + 1, len(values) - 1)]), place - before
    if np.isnan(ordered[-1]):
        return float("nan")
    return high - (high - low) * (1.0 - beyond) if beyond >= 0.5 else low + (high - low) * beyond


@inlined
def huber_weight(z: float, threshold: float) -> float:
    """Weight of a residual of z >= 0 standard deviations: 1 up to the threshold, then threshold / z (Huber 1964)."""
    weight: float = threshold / z if z > threshold else 1.0
    return weight


@kernel
def gate(expected: float, count: float) -> float:
    """Reduced chi-square (per reading) up to which a scan of `count` readings fits, if `expected` is usual.

    With a margin for few readings.
    """
    return float(expected * GATE * (1.0 + 2.0 / np.sqrt(max(count, 1.0))))
