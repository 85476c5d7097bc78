"""The offset of idle taxels, found without ever taking a steady contact for one.

A pad was idle where its sum is lowest, and only if what is left there is small (all taxels under a share of the
reference) and has no shape (no taxel sticks out of the others). A pad that is loaded from the first to the last
scan, or that never changes, fails the first test and keeps its readings as they are.
"""

from __future__ import annotations

import numpy as np

from taxelflow.messages import Bools, Floats

_SMALL = 0.1
"""An offset is below this share of the reference: the largest change seen, or full scale in a stream."""
_STICKS_OUT = 6.0
"""... and no taxel lies further from the pad's median than so many robust standard deviations."""


def learn_offset(windows: Floats, noise: Floats, masked: Bools, reference: float) -> Floats | None:
    """Offset of one pad (taxels,) in its own readings, or None if no window of it was idle.

    windows: (windows, scans, taxels) of this pad. noise, masked: (taxels,). reference: same unit.
    """
    live = windows[:, :, ~masked]
    complete = live[np.isfinite(live).all(axis=(1, 2))]
    if not complete.size:
        return None
    means = complete.mean(axis=1)
    sums = means.sum(axis=1)
    tolerance = _STICKS_OUT * np.sqrt(np.sum(noise[~masked] ** 2) / complete.shape[1])
    idle = complete[sums <= sums.min() + tolerance]
    offset = idle.mean(axis=(0, 1))
    settled = noise[~masked].max() * _STICKS_OUT / np.sqrt(idle.shape[0] * idle.shape[1])
    middle = np.median(offset)
    spread = 1.4826 * np.median(np.abs(offset - middle))
    small = np.abs(offset).max() <= _SMALL * reference
    shapeless = np.abs(offset - middle).max() <= max(_STICKS_OUT * spread, settled)
    if not (small and shapeless):
        return None
    whole = np.zeros(len(masked))
    whole[~masked] = offset
    return whole
