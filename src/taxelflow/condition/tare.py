"""The offset of idle taxels, found without ever taking a steady contact for one.

A pad was idle where its sum is lowest, and only if what is left there is small (all taxels under a share of the
reference) and has no shape: no taxel sticks out of the others, and neighbours are as different as any two taxels. A
contact is smooth; the offsets of taxels are not. A pad that is loaded from the first to the last scan fails these
tests and keeps its readings as they are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taxelflow.messages import Bools, Floats

_SMALL = 0.1
"""An offset is below this share of the reference: full scale, or the largest reading."""
_STICKS_OUT = 6.0
"""... no taxel lies further from the pad's median than so many robust standard deviations,"""
_ROUGH = 0.5
"""... and neighbours differ by at least this share of what two taxels drawn at random differ (Geary's ratio).
Offsets of 24 taxels fall below it 3 times in 10,000; a contact does, unless it is about as narrow as a taxel."""
_SUSPECT, _SUSPECT_ROUGH = 4.5, 0.8
"""A pad with a taxel that sticks out this far must be that rough."""
_FEWEST_NEIGHBOURS = 8
"""With fewer pairs of neighbours a pad's shape cannot be judged."""


def learn_offset(
    windows: Floats, noise: Floats, masked: Bools, neighbours: NDArray[np.int64], reference: float
) -> Floats | None:
    """Offset of one pad (taxels,) in its own readings, or None if no window of it was idle.

    windows: (windows, scans, taxels) of this pad, NaN where missing. noise, masked: (taxels,). neighbours: (pairs, 2)
    of taxels. reference: same unit as the readings.
    """
    complete = windows[(np.isfinite(windows) | masked).all(axis=(1, 2))]
    if not complete.size:
        complete = _patched(windows, masked)
    if not complete.size:
        return None
    live = complete[:, :, ~masked]
    with np.errstate(over="ignore", invalid="ignore"):
        sums = live.mean(axis=1).sum(axis=1)
        tolerance = _STICKS_OUT * np.sqrt(np.sum(noise[~masked] ** 2) / live.shape[1])
    idle = live[sums <= sums.min() + tolerance]
    offset = np.zeros(len(masked))
    offset[~masked] = idle.mean(axis=(0, 1))
    settled = float(noise.max()) / np.sqrt(idle.shape[0] * idle.shape[1])
    if np.abs(offset).max() > _SMALL * reference or not shapeless(offset, masked, neighbours, settled):
        return None
    return offset


def _patched(windows: Floats, masked: Bools) -> Floats:
    """Windows for a pad that is never complete: a reading that is missing now and then takes its window's mean."""
    known = np.isfinite(windows)
    count = known.sum(axis=1, keepdims=True)
    mean = np.sum(windows, axis=1, keepdims=True, where=known) / np.maximum(count, 1)
    heard = (2 * count[:, 0] > windows.shape[1]) | masked
    patched: Floats = np.where(known, windows, mean)[heard.all(axis=1)]
    return patched


def shapeless(offset: Floats, masked: Bools, neighbours: NDArray[np.int64], settled: float) -> bool:
    """Whether this is what electronics leave behind. settled: standard deviation of the offset itself."""
    live = offset[~masked]
    far = np.abs(live - np.median(live))
    spread = 1.4826 * float(np.median(far))
    if far.max() > _STICKS_OUT * max(spread, settled):
        return False
    pairs = neighbours[~masked[neighbours].any(axis=1)]
    if len(pairs) < _FEWEST_NEIGHBOURS:
        return bool(np.abs(live).max() <= _STICKS_OUT * settled)
    variance = float(np.var(live))
    if variance <= (2 * settled) ** 2:
        return True  # flat: there is nothing but the mean's own noise
    difference = float(np.mean((offset[pairs[:, 0]] - offset[pairs[:, 1]]) ** 2)) / 2
    suspect = far.max() > _SUSPECT * max(spread, settled)
    return difference >= (_SUSPECT_ROUGH if suspect else _ROUGH) * variance
