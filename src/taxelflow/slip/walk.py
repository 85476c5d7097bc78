"""Walk of a pose at rest: how much of the noise of a sum of steps stays in it.

Where a contact shows detail, the noise of a scan enters two successive steps with opposite signs, and the pose of an
object at rest stays where it is. Where it shows little, as on a flat face that covers the pad, part of each step's
noise remains: the pose walks, and its reported covariance grows. With the variance q of that walk per pose, and r of
what does not remain, a step has the variance q + 2 r.

The growth is learned while the object rests: motion disturbs the fit of a scan, and a scan that does not fit reports
a large covariance. It is inversely proportional to the square of the load, as all errors by noise are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.numerics.records import Vector
from taxelflow.runtime.compiling import routine

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.slip.covariance import Covariance


class _Walk(NamedTuple):
    """How the walk of a pose is learned."""

    weight: float = 0.02
    most_growth: float = 4.0
    """Weight of a pose in the mean growth (about 50 poses), and the multiple of the mean at which its growth is cut."""
    least_share: float = 0.01
    """Share of a pose's variance that is a walk worth learning: less is lost in creep and load."""
    most_share: float = 1.8
    """Largest walk over half the variance of a step, for which it may be 2 at most: then nothing would be left for
    r."""


_WALK = _Walk()


class Walk:
    """State of one pad.

    last: variances of the last pose, m^2, m^2, rad^2; NaN where unknown. growth: mean growth of these per pose at a
    load of 1. poses: how many it has been learned from.
    """

    last: Vector
    growth: Vector
    poses: int


@routine
def begin_walk(walk: Walk) -> None:
    """A contact begins."""
    walk.poses = 0
    for axis in range(3):
        walk.last[axis], walk.growth[axis] = np.nan, 0.0


@routine
def learn_walk(matrix: Floats, usual: Floats, log_load: float, rests: bool, walk: Walk) -> None:
    """Add a pose with the covariance matrix (3, 3). usual: (3,), mean variances at rest. rests: learn from it."""
    square = np.exp(2.0 * log_load)
    first = np.isnan(walk.last[0]) and np.isnan(walk.last[1])
    if rests and not first:
        walk.poses += 1
    weight = max(1.0 / max(walk.poses, 1), _WALK.weight)
    for axis in range(3):
        before, now = walk.last[axis], matrix[axis, axis]
        walk.last[axis] = now
        if rests and not (np.isnan(before) or np.isnan(now)):
            mean = walk.growth[axis]
            most = _WALK.most_growth * max(mean, _WALK.least_share * usual[axis] * square)
            walk.growth[axis] += weight * (min(max((now - before) * square, -most), most) - mean)


@routine
def split_walk(noise: Covariance, log_load: float, walk: Walk) -> float:
    """Take the walk out of the noise of an object at rest, half the variance of a step; the rest's share q / r.

    The rest filter has one share for all axes: the least of x and y, so that an axis with detail stays as good as it
    is. Where the walk is larger, the noise is raised to what has that share.
    """
    shares, square, least, largest = np.zeros(3), np.exp(-2.0 * log_load), np.inf, 0.0
    for axis in range(3):
        if not np.isnan(noise.variance[axis]):
            part = min(max(walk.growth[axis], 0.0) * square / noise.variance[axis], _WALK.most_share)
            shares[axis] = part / (1.0 - part / 2.0)
            largest = max(largest, shares[axis])
            if axis < 2:
                least = min(least, shares[axis])
    if largest < _WALK.least_share:
        return 0.0
    least = max(least, _WALK.least_share)
    for axis in range(3):
        shares[axis] = np.sqrt(max(1.0, shares[axis] / least) / (1.0 + shares[axis] / 2.0))
        noise.variance[axis] *= shares[axis] ** 2
    noise.xy *= shares[0] * shares[1]
    noise.xt *= shares[0] * shares[2]
    noise.yt *= shares[1] * shares[2]
    return float(least)
