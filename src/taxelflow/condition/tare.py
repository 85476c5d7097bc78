"""Offset of idle taxels, estimated without mistaking a steady contact for an offset.

A pad is idle where its sum is lowest, and only if the readings there are small (all taxels below a share of the
reference) and spatially unstructured: no taxel is an outlier, and neighbours differ as much as any two taxels. A
contact is smooth; the offsets of taxels are not. A pad that is loaded from the first to the last scan fails these tests
and keeps its readings as they are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taxelflow.messages import Bools, Floats

MAX_OFFSET_SHARE = 0.1
"""Largest offset as a share of the reference (full scale, or the largest reading): a larger one may be a load."""
OUTLIER_SIGMAS = 6.0
"""A taxel farther from the pad's median than this many robust standard deviations (1.4826 MAD) is an outlier."""
MIN_GEARY_RATIO = 0.5
"""Smallest Geary ratio, the mean squared difference of neighbours over that of taxels drawn at random, of an
unstructured offset. Random offsets of 24 taxels fall below it 3 times in 10,000; a contact does, unless it is about as
narrow as a taxel."""
SUSPECT_SIGMAS, MIN_SUSPECT_GEARY_RATIO = 4.5, 0.8
"""A pad with a taxel beyond this many robust standard deviations may be a narrow contact: it needs a higher ratio."""
FLAT_SIGMAS = 2.0
"""Offsets whose standard deviation over the pad is below this many of their own are equal: there is no structure."""
MIN_NEIGHBOUR_PAIRS = 8
"""With fewer pairs of neighbours the Geary ratio is not significant."""
_MAD_TO_SIGMA = 1.4826
"""Standard deviation of normal numbers over their median absolute deviation."""


def estimate_offset(
    windows: Floats, noise: Floats, masked: Bools, neighbours: NDArray[np.int64], reference: float
) -> Floats | None:
    """Offset of one pad (taxels,) in the unit of its readings, or None if no window of it was idle.

    windows: (windows, scans, taxels) of this pad, NaN where missing. noise, masked: (taxels,). neighbours: (pairs, 2)
    of taxels. reference: full scale or largest reading, in the same unit.
    """
    complete = windows[(np.isfinite(windows) | masked).all(axis=(1, 2))]
    if not complete.size:
        complete = _filled(windows, masked)
    if not complete.size:
        return None
    live = complete[:, :, ~masked]
    with np.errstate(over="ignore", invalid="ignore"):
        sums = live.mean(axis=1).sum(axis=1)
        tolerance = OUTLIER_SIGMAS * np.sqrt(np.sum(noise[~masked] ** 2) / live.shape[1])
    idle = live[sums <= sums.min() + tolerance]
    offset = np.zeros(len(masked))
    offset[~masked] = idle.mean(axis=(0, 1))
    offset_std = float(noise.max()) / np.sqrt(idle.shape[0] * idle.shape[1])
    small = np.abs(offset).max() <= MAX_OFFSET_SHARE * reference
    return offset if small and is_unstructured(offset, masked, neighbours, offset_std) else None


def _filled(windows: Floats, masked: Bools) -> Floats:
    """Windows of a pad that is never complete: a missing reading takes the mean of its taxel in its window.

    Windows in which some taxel is missing in half of the scans or more are left out.
    """
    known = np.isfinite(windows)
    count = known.sum(axis=1, keepdims=True)
    mean = np.sum(windows, axis=1, keepdims=True, where=known) / np.maximum(count, 1)
    mostly_known = (2 * count[:, 0] > windows.shape[1]) | masked
    filled: Floats = np.where(known, windows, mean)[mostly_known.all(axis=1)]
    return filled


def is_unstructured(offset: Floats, masked: Bools, neighbours: NDArray[np.int64], offset_std: float) -> bool:
    """Whether an offset (taxels,) looks like that of electronics, not like a contact.

    offset_std: standard deviation of the offset of one taxel. The spatial test is Geary's contiguity ratio
    (R. C. Geary, The Contiguity Ratio and Statistical Mapping, The Incorporated Statistician 5, 1954).
    """
    live = offset[~masked]
    deviation = np.abs(live - np.median(live))
    spread = max(_MAD_TO_SIGMA * float(np.median(deviation)), offset_std)
    if deviation.max() > OUTLIER_SIGMAS * spread:
        return False
    pairs = neighbours[~masked[neighbours].any(axis=1)]
    if len(pairs) < MIN_NEIGHBOUR_PAIRS:
        return bool(np.abs(live).max() <= OUTLIER_SIGMAS * offset_std)
    variance = float(np.var(live))
    if variance <= (FLAT_SIGMAS * offset_std) ** 2:
        return True
    neighbour_variance = float(np.mean((offset[pairs[:, 0]] - offset[pairs[:, 1]]) ** 2)) / 2
    suspect = deviation.max() > SUSPECT_SIGMAS * spread
    return neighbour_variance >= (MIN_SUSPECT_GEARY_RATIO if suspect else MIN_GEARY_RATIO) * variance
