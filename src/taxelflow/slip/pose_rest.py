"""Bins in which the pose excludes a slip, whatever the pattern does.

A load that wanders changes the pattern of a soft skin as a slip does. Where the poses are `ok` throughout, do not move
and are precise, their covariance speaks for rest. A slip shorter than they resolve is left to the pattern.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import OK, Bools, Floats
from taxelflow.numerics.rounding import SIGNIFICANT
from taxelflow.numerics.small_linalg import eigenvalues2
from taxelflow.runtime.compiling import kernel

if TYPE_CHECKING:
    from taxelflow.messages import Slips

_SHARE = 0.25
"""Of a pitch: a motion that poses must exclude. On 19 recordings of a real finger whose poses are `ok` in slips of 4 mm
and more, their three standard deviations are 0.35 pitches and more."""


class PoseRest:
    """Looks at the last pose of each bin."""

    def __init__(self, pitch_m: Floats, window_bins: int) -> None:
        """pitch_m: (pads, 2). window_bins: bins in which a pattern is compared."""
        self._most_m, self._bins = _SHARE * pitch_m.min(axis=1), 0
        self._window = np.full((window_bins + 1, len(pitch_m), 3), np.nan)

    def step(self, slips: Slips, scan: int, slipped: Bools) -> Bools:
        """(pads,), whether the poses of the window that ends with this scan exclude a slip.

        slipped: (pads,), by the pose in any scan of the last bin.
        """
        known = (slips.quality[scan] == OK) & ~slipped
        variance = slips.covariance[scan] if slips.unseen is None else slips.covariance[scan] + slips.unseen[scan]
        now = self._bins % len(self._window)
        self._bins += 1
        excluded: Bools = np.empty_like(known)
        _exclude(slips.pose[scan], variance, known, self._window, now, self._most_m, excluded)
        return excluded


@kernel
def _exclude(
    pose: Floats, covariance: Floats, known: Bools, window: Floats, now: int, most_m: Floats, excluded: Bools
) -> None:
    """Fill excluded (pads,): whether the poses in a window (bins, pads, 3), of x, y and largest standard deviation, m,
    exclude a motion by more than most_m (pads,). First the poses (pads, 3) of its bin `now` are written into it.
    """
    for pad in range(len(known)):
        row, variance = window[now, pad], covariance[pad]
        row[0], row[1] = pose[pad, 0], pose[pad, 1]
        usable = known[pad] and not np.isnan(row[0] + row[1])
        row[2] = np.sqrt(eigenvalues2(variance[0, 0], variance[1, 1], variance[0, 1])[1]) if usable else np.nan
        left, right, low, high, widest = np.inf, -np.inf, np.inf, -np.inf, 0.0
        for k in range(len(window)):
            x, y, deviation = window[k, pad, 0], window[k, pad, 1], window[k, pad, 2]
            left, right, low, high = min(left, x), max(right, x), min(low, y), max(high, y)
            widest = max(widest, deviation) if deviation >= 0.0 else np.inf
        way_m = np.sqrt((right - left) ** 2 + (high - low) ** 2)
        excluded[pad] = way_m + SIGNIFICANT * widest < most_m[pad]
