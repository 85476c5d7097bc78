"""Detection of gaps in time: a step far above the usual one, the median of the steps before it.

There are two kinds: a step between stamps, and one between new scans, if a sensor hangs while its logger goes on.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taxelflow.condition.stream_state import STEPS, StreamState
from taxelflow.messages import Floats
from taxelflow.numerics.ring import put
from taxelflow.runtime.compiling import routine


class _Gap(NamedTuple):
    """A gap between scans."""

    ratio: float = 3.0
    """A time step longer than this many usual ones is a gap: 3 lost scans are one, jitter and a single lost scan are
    not."""
    steps: int = 3
    """Fewer steps have no usual one."""


GAP = _Gap()


@routine
def judge_stamp(step_s: float, stream: StreamState) -> None:
    """Recognise a gap between stamps; mean and variance of the other steps."""
    if step_s > GAP.ratio * _median(stream.recent_steps_s, stream.stamps):
        add_gap(step_s, stream)
    else:
        add_step(step_s, stream)
    put(stream.recent_steps_s, stream.stamps, step_s)
    stream.stamps += 1


@routine
def judge_new_step(step_s: float, stream: StreamState) -> None:
    """Recognise a sensor that hung while its logger went on. Both scans of the step are evidence."""
    hung = step_s > GAP.ratio * _median(stream.recent_new_steps_s, stream.new_stamps)
    if hung and stream.dropped_since_kept > 0 and not stream.gap_pending:
        add_gap(step_s, stream)
    put(stream.recent_new_steps_s, stream.new_stamps, step_s)
    stream.new_stamps += 1
    if not stream.gap_pending:
        stream.new_steps_s += step_s
        stream.new_steps += 1


@routine
def add_step(step_s: float, stream: StreamState) -> None:
    """One more step that is no gap: mean and squared deviations (Welford's algorithm)."""
    stream.steps += 1
    deviation = step_s - stream.step_mean_s
    stream.step_mean_s += deviation / stream.steps
    stream.step_squares_s2 += deviation * (step_s - stream.step_mean_s)


@routine
def add_gap(step_s: float, stream: StreamState) -> None:
    """Time was lost before the next new scan."""
    stream.gap_pending = True
    stream.gaps += 1
    stream.longest_gap_s = max(stream.longest_gap_s, step_s)


@routine
def _median(ring: Floats, written: int) -> float:
    """Median of the recent steps, by rank: quick to compile, and as fast as a sort; infinite while they are too few."""
    if written < GAP.steps:
        return np.inf
    count, low, high = min(written, STEPS), np.nan, np.nan
    for i in range(count):
        below = same = 0
        for j in range(count):
            below += 1 if ring[j] < ring[i] else 0
            same += 1 if ring[j] == ring[i] else 0
        if below <= (count - 1) // 2 < below + same:
            low = ring[i]
        if below <= count // 2 < below + same:
            high = ring[i]
    return 0.5 * (low + high)
