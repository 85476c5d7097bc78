"""Slips by the pose that are only suspected and go on: reported again whenever the pose has moved on.

What load and tilt explain as well as a slip may still be an object that falls, so it must not stay silent. A pose that
rocks with its load comes back, and is not reported for each swing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import Bools, Floats
from taxelflow.numerics.rounding import BLURRED
from taxelflow.runtime.compiling import kernel, routine

if TYPE_CHECKING:
    from taxelflow.messages import Slips


class Suspicion:
    """Follows the poses of all pads while a slip of theirs is only suspected."""

    def __init__(self, pitch_m: Floats) -> None:
        """pitch_m: (pads, 2)."""
        count = len(pitch_m)
        self._reach_m = BLURRED * np.sqrt(pitch_m.prod(axis=1))
        self._before = np.zeros((1, count), dtype=np.bool_)
        self._way_m, self._next_m, self._since_s = np.zeros((count, 2)), np.zeros(count), np.zeros(count)

    def step(self, slips: Slips, suspected: Bools) -> Floats:
        """(scans, pads), where a suspected slip is reported again, since when it is suspected, s; else NaN.

        suspected: (scans, pads), slipping by the pose alone. A slip is reported again where its pose has moved by a
        quarter of a pitch further from where it was suspected first than at the last report.
        """
        again = np.full(suspected.shape, np.nan)
        state = (self._before, self._way_m, self._next_m, self._since_s)
        _follow(suspected, slips.t_s, slips.displacement, self._reach_m, state, again)
        self._before = suspected[-1:]
        return again


@kernel
def _follow(
    suspected: Bools,
    t_s: Floats,
    displacement: Floats,
    reach_m: Floats,
    state: tuple[Bools, Floats, Floats, Floats],
    again: Floats,
) -> None:
    """Fill again (scans, pads). state: suspected before, (1, pads); way since then, (pads, 2), the length of it at the
    next report, and since when, (pads,).
    """
    before, way_m, next_m, since_s = state
    for scan in range(suspected.shape[0]):
        for pad in range(suspected.shape[1]):
            was = suspected[scan - 1, pad] if scan > 0 else before[0, pad]
            if suspected[scan, pad] and not was:
                since_s[pad], next_m[pad] = t_s[scan], reach_m[pad]
                way_m[pad, 0] = way_m[pad, 1] = 0.0
            elif suspected[scan, pad]:
                length_m = _go_on(displacement[scan, pad], way_m[pad])
                again[scan, pad] = since_s[pad] if length_m > next_m[pad] else np.nan
                next_m[pad] = max(next_m[pad], reach_m[pad] * (length_m // reach_m[pad] + 1.0))


@routine
def _go_on(displacement: Floats, way_m: Floats) -> float:
    """Add the known part of a displacement to a way, (2,) each; its length."""
    for axis in range(2):
        step = displacement[axis]
        way_m[axis] += 0.0 if np.isnan(step) else step
    return float(np.hypot(way_m[0], way_m[1]))
