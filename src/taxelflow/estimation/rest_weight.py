"""Poses beside a rest, see `rest_hypothesis`: the mean of rest and motion, and the covariance that holds both."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.messages import AMBIGUOUS, OK, Bools, Bytes, Floats
from taxelflow.numerics.rounding import BLURRED, LEAST_VARIANCE_M2
from taxelflow.numerics.small_linalg import eigenvalues2
from taxelflow.runtime.compiling import kernel, routine

if TYPE_CHECKING:
    from numpy.typing import NDArray


class Beside(NamedTuple):
    """What is known of rest and motion, (scans, pads) each.

    origin_m: (scans, pads, 2), places of the references. shifted, held: (scans, pads, 2, 2), what the load does to
    poses that have moved, and see `HeldShift`. moved, slipping: whether they have moved, and slip. excursion: its
    number. rests: log odds of rest by the pattern.
    """

    origin_m: Floats
    shifted: Floats
    held: Floats
    moved: Bools
    slipping: Bools
    excursion: NDArray[np.int64]
    rests: Floats


@kernel
def weigh_rest(
    beside: Beside, slid: NDArray[np.int64], pitch_m: Floats, pose: Floats, covariance: Floats, quality: Bytes
) -> None:
    """Make poses (scans, pads, 3) of objects that may rest the mean of both hypotheses, see `share_of_motion`, and add
    their distance from the references to their covariances (scans, pads, 3, 3); where they have moved, what the load
    does to them. quality (scans, pads) follows.

    slid: (pads,), the last excursion in which they slipped, brought up to date. pitch_m: (pads,).
    """
    origin_m, excursion = beside.origin_m, beside.excursion
    for scan in range(len(pose)):
        for pad in range(len(pitch_m)):
            x = pose[scan, pad, 0] - origin_m[scan, pad, 0]
            y = pose[scan, pad, 1] - origin_m[scan, pad, 1]
            if np.isnan(x):
                continue
            if beside.slipping[scan, pad]:
                slid[pad] = excursion[scan, pad]
            own, more, most = covariance[scan, pad], beside.shifted[scan, pad], (BLURRED * pitch_m[pad]) ** 2
            xx, yy, xy = x * x, y * y, x * y
            if beside.moved[scan, pad]:
                xx, yy, xy = more[0, 0], more[1, 1], more[0, 1]
            elif slid[pad] != excursion[scan, pad]:
                share = share_of_motion(x, y, own, beside.rests[scan, pad], most)
                pose[scan, pad, 0] = origin_m[scan, pad, 0] + share * x
                pose[scan, pad, 1] = origin_m[scan, pad, 1] + share * y
            more = beside.held[scan, pad]
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
