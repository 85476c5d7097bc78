"""Median of a few numbers, by rank: quick to compile, and for a few numbers as fast as sorting them."""

from __future__ import annotations

import numpy as np

from taxelflow.messages import Floats
from taxelflow.runtime.compiling import routine


@routine
def median_of_first(values: Floats, count: int) -> float:
    """Median of the first `count` of values (n,), none of which is NaN; NaN of none."""
    low = high = np.nan
    for i in range(count):
        below = same = 0
        for j in range(count):
            below += 1 if values[j] < values[i] else 0
            same += 1 if values[j] == values[i] else 0
        if below <= (count - 1) // 2 < below + same:
            low = values[i]
        if below <= count // 2 < below + same:
            high = values[i]
    return 0.5 * (low + high)
