"""One scan of the whole hand in one call: its pads registered, and their row of estimates filled in.

The call keeps Python's lock. It takes some microseconds; had it to get the lock back from the thread that learns, it
could take as long as that thread holds it, milliseconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import brief_kernel
from taxelflow.estimation.template.online.output import report
from taxelflow.estimation.template.online.track_state import FLAG, NOTHING
from taxelflow.estimation.template.online.tracking import follow

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats

FOLLOW, REPORT, BOTH = range(1, 4)
"""What to do with a scan."""
DONE, ELSEWHERE, ASKS = range(3)
"""What came of it: nothing more to do; not reported, because a scan fits where it was not looked for; a pad's FLAG is
set."""


@brief_kernel
def follow_hand(
    job: int,
    k: int,
    t: float,
    reading: Floats,
    variance: Floats,
    ceiling: Floats,
    contact: Bools,
    places: Floats,
    delay: Floats,
    at_border: Bools,
    starts: NDArray[np.int64],
    pitch_m: Floats,
    lead: Floats,
    memory: Floats,
    states: Floats,
    information: Floats,
    steps: Floats,
    rests: Floats,
    before: Floats,
    before_cov: Floats,
    before_t: Floats,
    keyframes: Floats,
    last_reading: Floats,
    last_variance: Floats,
    patterns: Floats,
    doubts: Floats,
    pose: Floats,
    covariance: Floats,
    displacement: Floats,
    displacement_covariance: Floats,
    span: Floats,
    lag: Floats,
    disturbance: Floats,
    quality: NDArray[np.uint8],
) -> int:
    """Do FOLLOW, REPORT or BOTH with one scan (entries,), into row k of pose ... quality (scans, pads, ...), whatever
    stood there.

    See `tracking.follow` and `output.report` for the arrays. lead: (pads,), how much
    later than its time a scan is read, see `observations.delays_of`. If not all pads fit, BOTH stops before the report.
    """
    if job & FOLLOW:
        fits = follow(
            t,
            reading,
            variance,
            ceiling,
            places,
            delay,
            at_border,
            starts,
            contact,
            patterns,
            doubts,
            memory,
            states,
            information,
            steps,
            rests,
        )
        if job == FOLLOW or not fits:
            return DONE if fits else ELSEWHERE
    for row in (pose[k], displacement[k]):
        row[:] = np.nan
    for block in (covariance[k], displacement_covariance[k]):
        block[:] = np.nan
    for column in (span[k], lag[k], disturbance[k]):
        column[:] = np.nan
    quality[k] = 0
    report(
        t,
        contact,
        pitch_m,
        memory,
        states,
        information,
        steps,
        before,
        before_cov,
        before_t,
        keyframes,
        pose[k],
        covariance[k],
        displacement[k],
        displacement_covariance[k],
        span[k],
        quality[k],
    )
    asks = False
    for pad in range(len(contact)):
        if not np.isnan(pose[k, pad, 0]):
            lag[k, pad] = -lead[pad]
        asks = asks or memory[pad, FLAG] != NOTHING
    last_reading[:] = reading
    last_variance[:] = variance
    return ASKS if asks else DONE
