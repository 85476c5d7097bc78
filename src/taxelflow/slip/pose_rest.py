"""Bins in which the pose excludes a slip, whatever the pattern does.

A load that wanders changes the pattern of a soft skin as a slip does. Where the poses are `ok` throughout, do not move
and are precise, their covariance speaks for rest. A slip shorter than they resolve is left to the pattern.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import OK
from taxelflow.numerics.rounding import SIGNIFICANT

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats, Slips

_SHARE = 0.25
"""Of a pitch: a motion that poses must exclude. On 19 recordings of a real finger whose poses are `ok` in slips of 4 mm
and more, their three standard deviations are 0.35 pitches and more."""


class PoseRest:
    """Looks at the last pose of each bin."""

    def __init__(self, pitch_m: Floats, window_bins: int) -> None:
        """pitch_m: (pads, 2). window_bins: bins in which a pattern is compared."""
        self._most_m = _SHARE * pitch_m.min(axis=1)
        self._poses: deque[tuple[Floats, Floats]] = deque(maxlen=window_bins + 1)

    def step(self, slips: Slips, scan: int, slipped: Bools) -> Bools:
        """(pads,), whether the poses of the window that ends with this scan exclude a slip.

        slipped: (pads,), by the pose in any scan of the last bin.
        """
        known = (slips.quality[scan] == OK) & ~slipped
        place_m = np.where(known[:, np.newaxis], slips.pose[scan, :, :2], np.nan)
        variance = slips.covariance[scan] if slips.unseen is None else slips.covariance[scan] + slips.unseen[scan]
        xx, xy, yy = variance[:, 0, 0], variance[:, 0, 1], variance[:, 1, 1]
        largest = 0.5 * (xx + yy + np.hypot(xx - yy, 2 * xy))
        self._poses.append((place_m, np.sqrt(largest)))
        if len(self._poses) < (self._poses.maxlen or 0):
            return np.zeros_like(known)
        places = np.stack([place for place, _ in self._poses])
        deviations = np.stack([deviation for _, deviation in self._poses])
        way_m = np.hypot(*(places.max(axis=0) - places.min(axis=0)).T)
        excluded: Bools = way_m + SIGNIFICANT * deviations.max(axis=0) < self._most_m
        return excluded
