"""Poses beside a rest, see `rest_hypothesis`: the mean of rest and motion, and the covariance that holds both."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import AMBIGUOUS, OK, Bools, Bytes, Floats
from taxelflow.numerics.rounding import BLURRED, LEAST_VARIANCE_M2
from taxelflow.numerics.small_linalg import eigenvalues2
from taxelflow.runtime.compiling import kernel, routine

if TYPE_CHECKING:
    from numpy.typing import NDArray


@kernel
def weigh_rest(
    pose: Floats,
    origin_m: Floats,
    shifted: Floats,
    held: Floats,
    motion: tuple[Bools, Bools, NDArray[np.int64]],
    slid: NDArray[np.int64],
    rests: Floats,
    pitch_m: Floats,
    covariance: Floats,
    quality: Bytes,
) -> None:
    """Make poses (scans, pads, 3) of objects that may rest the mean of both hypotheses, see `share_of_motion`, and add
    their distance from the references (scans, pads, 2) to their covariances (scans, pads, 3, 3); where they have moved,
    what the load does to them, shifted (scans, pads, 2, 2). quality (scans, pads) follows.

    held: (scans, pads, 2, 2), see `HeldShift`. motion: (scans, pads), whether they have moved, whether they slip, and
    the number of the excursion. slid: (pads,), the last one in which they slipped, brought up to date. rests: (scans,
    pads), log odds of rest by the pattern. pitch_m: (pads,).
    """
    moved, slipping, excursion = motion
    for scan in range(len(pose)):
        for pad in range(len(pitch_m)):
            x = pose[scan, pad, 0] - origin_m[scan, pad, 0]
            y = pose[scan, pad, 1] - origin_m[scan, pad, 1]
            if np.isnan(x):
                continue
            if slipping[scan, pad]:
                slid[pad] = excursion[scan, pad]
            own, more, most = covariance[scan, pad], shifted[scan, pad], (BLURRED * pitch_m[pad]) ** 2
            xx, yy, xy = x * x, y * y, x * y
            if moved[scan, pad]:
                xx, yy, xy = more[0, 0], more[1, 1], more[0, 1]
            elif slid[pad] != excursion[scan, pad]:
                share = share_of_motion(x, y, own, rests[scan, pad], most)
                pose[scan, pad, 0] = origin_m[scan, pad, 0] + share * x
                pose[scan, pad, 1] = origin_m[scan, pad, 1] + share * y
            more = held[scan, pad]
            xx, yy, xy = xx + more[0, 0], yy + more[1, 1], xy + more[0, 1]
            own[0, 0] += xx
            own[1, 1] += yy
            own[0, 1] += xy
            own[1, 0] += xy
            blurred = xx + yy > most or eigenvalues2(own[0, 0], own[1, 1], own[0, 1])[1] > most
            if blurred and quality[scan, pad] == OK:
                quality[scan, pad] = AMBIGUOUS


@routine
def share_of_motion(x: float, y: float, cov: Floats, rests: float, most_m2: float) -> float:
    """The share of a distance x, y from the reference that an object has gone, mean of two hypotheses: it rests, or it
    is where its pose says.

    cov: (2 or more, 2 or more), of the distance. rests: log odds of rest, by all but the distance. most_m2: variance at
    most, or if it is unknown: a place that is open is no reason for rest.
    """
    square = x * x + y * y
    if square == 0.0:
        return 1.0
    variance = (x * x * cov[0, 0] + 2.0 * x * y * cov[0, 1] + y * y * cov[1, 1]) / square
    variance = max(variance, LEAST_VARIANCE_M2) if variance < most_m2 else most_m2
    return float(1.0 / (1.0 + np.exp(rests - 0.5 * square / variance)))
