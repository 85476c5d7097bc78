"""Slips by the pose that are only suspected and go on: reported again whenever the pose has moved on.

What load and tilt explain as well as a slip may still be an object that falls, so it must not stay silent. A pose that
rocks with its load comes back, and is not reported for each swing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np

from taxelflow.messages import Bools, Floats
from taxelflow.numerics.clock import SAME_S
from taxelflow.numerics.records import Records, records
from taxelflow.numerics.rounding import BLURRED
from taxelflow.runtime.compiling import kernel, routine

if TYPE_CHECKING:
    from taxelflow.messages import Slips

_AGAIN_S = 0.5
"""Time between reports of one slip: a fast one is not reported for each scan."""


class Follow:
    """State of one pad: whether its slip is only suspected, and since when; way since then, and its length at the next
    report; time of the last report.
    """

    suspected: bool
    since_s: float
    way_m: Annotated[Floats, 2]
    next_m: float
    last_s: float


class Suspicion:
    """Follows the poses of all pads while a slip of theirs is only suspected."""

    def __init__(self, pitch_m: Floats) -> None:
        """pitch_m: (pads, 2)."""
        self._reach_m = BLURRED * np.sqrt(pitch_m.prod(axis=1))
        self._states = records(Follow, len(pitch_m))
        self._goes_on = True  # the first call compiles the kernel

    def step(self, slips: Slips, suspected: Bools) -> dict[tuple[int, int], float]:
        """Scan and pad at which a suspected slip is reported again, with the time since when it is suspected, s.

        suspected: (scans, pads), slipping by the pose alone. A slip is reported again where its pose has moved by a
        quarter of a pitch further from where it was suspected first than at the last report, half a second ago.
        """
        if not (self._goes_on or np.count_nonzero(suspected)):
            return {}
        again = np.empty(suspected.shape)
        self._goes_on, reported = _follow(suspected, slips.t_s, slips.displacement, self._reach_m, self._states, again)
        if not reported:
            return {}
        places = zip(*np.nonzero(np.isfinite(again)), strict=True)
        return {(int(scan), int(pad)): float(again[scan, pad]) for scan, pad in places}


@kernel
def _follow(
    suspected: Bools, t_s: Floats, displacement: Floats, reach_m: Floats, states: Records, again: Floats
) -> tuple[bool, bool]:
    """Fill again (scans, pads), NaN where nothing is reported; whether a slip is still suspected, and whether one is
    reported. states: (pads,) of `Follow`.
    """
    goes_on = reported = False
    for scan in range(suspected.shape[0]):
        for pad in range(suspected.shape[1]):
            state: Follow = states[pad]
            again[scan, pad] = np.nan
            if suspected[scan, pad]:
                again[scan, pad] = _go_on(t_s[scan], displacement[scan, pad], reach_m[pad], state)
            state.suspected = suspected[scan, pad]
            reported |= not np.isnan(again[scan, pad])
            goes_on |= suspected[scan, pad] and scan == len(suspected) - 1
    return goes_on, reported


@routine
def _go_on(t_s: float, displacement: Floats, reach_m: float, state: Follow) -> float:
    """One more scan (3,) of a suspected slip: since when it is, s, if it is reported again, else NaN."""
    if not state.suspected:
        state.since_s = state.last_s = t_s
        state.next_m = reach_m
        state.way_m[0] = state.way_m[1] = 0.0
        return np.nan
    for axis in range(2):
        state.way_m[axis] += 0.0 if np.isnan(displacement[axis]) else displacement[axis]
    length_m = np.hypot(state.way_m[0], state.way_m[1])
    if length_m <= state.next_m or t_s < state.last_s + _AGAIN_S - SAME_S:
        return np.nan
    state.last_s, state.next_m = t_s, reach_m * (length_m // reach_m + 1.0)
    return state.since_s
