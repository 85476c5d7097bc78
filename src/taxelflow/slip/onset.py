"""Onset of a slip: a Shiryaev-Roberts change detector on the innovations of the rest filter.

A slip that starts at t_j with velocity v adds v f_jk to the whitened innovation u_k, where f_jk is the response of the
filter's innovation to a unit ramp from t_j, over the standard deviation of the innovation (Willsky and Jones, 1976).
With prior v ~ N(0, (s reach / dt)^2) along each axis of u, and both v and s integrated out, the likelihood ratio is

    L_j = (1 + F_j / g)^(-n/2) (1 - Q_j / E)^(-nu/2),   F_j = sum f^2,  h_j = sum f u,  g = (dt / reach)^2,
    Q_j = |h_j|^2 / (F_j + g),   E = sum |u|^2 over nu components,   n = 1 to 3 components of a pose.

The alarm is raised when R = sum over j of (t_j+1 - t_j) L_j exceeds a threshold, s. At rest each L_j has mean 1, so R
minus the elapsed time is a martingale, and the mean time to a false alarm is at least the threshold at any scan rate
(Pollak, 1987). `alarm_threshold` corrects for the overshoot.
"""

from __future__ import annotations

from math import exp, log
from typing import Annotated, NamedTuple

import numpy as np

from taxelflow.numerics.records import Records, Vector
from taxelflow.numerics.rounding import NEGLIGIBLE
from taxelflow.runtime.compiling import routine
from taxelflow.slip.hypotheses import merge_closest, remove
from taxelflow.slip.measurement import Measurement
from taxelflow.slip.rest_filter import RestState, correlation_inflation, noise_scale


class _Ramps(NamedTuple):
    """Ramps that the onset detector tests: slips that began at some time."""

    reach: float = 2.0
    """Prior standard deviation of a slip's motion from scan to scan, in standard deviations of a pose. Slower and
    faster slips are found too, a few scans later."""
    most: int = 20
    """Start times that are tested at a time."""
    recent: int = 8
    """The latest start times, which are never merged."""
    age_s: float = 2.0
    age_scans: int = 64
    """The oldest start time is dropped at the larger of these ages, in s and in mean scans of the time between the last
    two. Merged instead, it would gain weight as long as the object rests, and so would the rate of alarms."""
    visible: float = 0.1
    """Smallest share of F that the rest filter must leave of a ramp: a third of its path. The rest of a slip that the
    filter attributes to the load follows the noise of the load, which correlates with that of the pose."""


RAMPS = _Ramps()
MAX_EXPONENT = 600.0
"""Upper limit of a log likelihood ratio: exp is finite up to 709."""
_OVERSHOOT = ((0.235, 0.050), (0.143, 0.052), (0.130, 0.066))
"""(c, p) for 1, 2, 3 components of a pose: R exceeds a threshold of h scans by far, so that false alarms come every
h / (c h^-p) scans. Fitted to a simulation of the test, see tests/slip/test_rate.py."""


class Ramp:
    """Hypothesis that a slip started at a time."""

    start_s: float
    weight: float
    """Time since the scan before, s; of merged hypotheses the sum."""
    response_a: float
    response_b: float
    response_c: float
    """State (a, b, c) of the rest filter after a ramp of 1 m/s: s, s, 1."""
    information: float
    """F of a translation, s^2: information on the velocity in units of the noise's."""
    yaw_information: float
    """F of theta, s^2: without poses at which theta is not used."""
    raw_information: float
    """F of a translation if the rest filter did not respond, s^2."""
    prior_information: float
    """g, s^2."""
    score: Vector
    """h, s."""


class SlipEstimate:
    """Maximum a posteriori motion of the most likely ramp."""

    start_s: float
    position: Vector
    """Now; m, m, rad."""
    velocity: Vector
    """m/s, m/s, rad/s."""
    velocity_variance: float
    """Of a translation, m^2/s^2."""
    cross_covariance: float
    """Of position and velocity, m^2/s."""
    explained: float
    """Q: part of the sum of u^2 that the slip explains."""


class OnsetState:
    """State of the change detector of one pad."""

    count: int
    """Ramps in use, oldest first."""
    ramps: Annotated[Records, Ramp, RAMPS.most]
    slip: SlipEstimate


@routine
def likelihood_ratio(ramp: Ramp, square_sum: float, components: float, axes: int) -> tuple[float, float]:
    """L and Q of one ramp. square_sum: E; components: nu; axes: how many of x and y are known."""
    place, yaw, g = ramp.information, ramp.yaw_information, ramp.prior_information
    h = ramp.score
    q = (h[0] * h[0] + h[1] * h[1]) / (place + g) + h[2] * h[2] / (yaw + g)
    left = max(1.0 - q / square_sum, NEGLIGIBLE)
    power = -0.5 * axes * log(1.0 + place / g) - 0.5 * log(1.0 + yaw / g) - 0.5 * components * log(left)
    return exp(min(power, MAX_EXPONENT)), q


@routine
def shiryaev_roberts(measurement: Measurement, rest: RestState, onset: OnsetState) -> float:
    """Shiryaev-Roberts statistic R, s, after one more update of the rest filter.

    Starts a ramp at the measurement before and fills `onset.slip` from the most likely ramp. Needs a free ramp: call
    `prune` afterwards.
    """
    t_s, dt_s = measurement.t_s, measurement.t_s - measurement.previous_s
    square_sum = rest.components * noise_scale(rest) * correlation_inflation(rest)
    _start_ramp(measurement.previous_s, dt_s, onset.ramps[onset.count])
    onset.count += 1
    statistic = most = 0.0
    likeliest = 0
    for j in range(onset.count):
        ramp: Ramp = onset.ramps[j]
        _extend(t_s, dt_s, rest, ramp)
        ratio, q = likelihood_ratio(ramp, square_sum, rest.components, rest.innovation.axes)
        ratio *= ramp.weight if ramp.information > RAMPS.visible * ramp.raw_information else 0.0
        statistic += ratio
        if ratio > most:
            most, likeliest, onset.slip.explained = ratio, j, q
    _estimate(t_s, onset.ramps[likeliest], rest, onset.slip)
    return statistic


@routine
def _start_ramp(start_s: float, dt_s: float, ramp: Ramp) -> None:
    ramp.start_s, ramp.weight, ramp.prior_information = start_s, dt_s, (dt_s / RAMPS.reach) ** 2
    ramp.response_a = ramp.response_b = ramp.response_c = 0.0
    ramp.information = ramp.yaw_information = ramp.raw_information = 0.0
    for axis in range(3):
        ramp.score[axis] = 0.0


@routine
def _extend(t_s: float, dt_s: float, rest: RestState, ramp: Ramp) -> None:
    """Add the last innovation to a ramp: run the rest filter on a unit ramp and correlate."""
    step = rest.innovation
    ramp.response_a += step.load_change * ramp.response_b + dt_s * ramp.response_c
    ramp.response_b *= step.decay
    ramp.response_c *= step.decay
    f = t_s - ramp.start_s - ramp.response_a
    ramp.response_a += step.gain_a * f
    ramp.response_b += step.gain_b * f
    ramp.response_c += step.gain_c * f
    f *= step.std_ratio
    ramp.information += f * f
    ramp.raw_information += ((t_s - ramp.start_s) * step.std_ratio) ** 2
    if step.yaw_used:
        ramp.yaw_information += f * f
    for axis in range(3):
        ramp.score[axis] += f * step.whitened[axis]


@routine
def _estimate(t_s: float, ramp: Ramp, rest: RestState, slip: SlipEstimate) -> None:
    """Fill in the motion of a slip along a ramp. The velocity is L h / (F + g) with the Cholesky factor L."""
    step, root, h, g = rest.innovation, rest.innovation.factor, ramp.score, ramp.prior_information
    vx, vy, vt = h[0] / (ramp.information + g), h[1] / (ramp.information + g), h[2] / (ramp.yaw_information + g)
    slip.start_s = ramp.start_s
    slip.velocity[0] = root.xx * vx if root.xx < np.inf else 0.0
    slip.velocity[1] = root.yx * vx + root.yy * vy if root.yy < np.inf else 0.0
    slip.velocity[2] = root.tx * vx + root.ty * vy + root.tt * vt if root.tt < np.inf else 0.0
    slip.velocity_variance = step.variance / (ramp.information + g)
    lag_s = t_s - ramp.start_s - ramp.response_a  # the rest filter has followed the slip, but late
    slip.cross_covariance = lag_s * slip.velocity_variance
    for axis in range(3):
        slip.position[axis] = rest.position[axis] + lag_s * slip.velocity[axis]


@routine
def alarm_threshold(interval_s: float, dt_s: float, components: int) -> float:
    """Threshold of R, s, for a mean time between false alarms of `interval_s` at scans `dt_s` apart.

    components: of a pose, 1 to 3.
    """
    c, p = _OVERSHOOT[components - 1]
    return float(dt_s * (c * interval_s / dt_s) ** (1.0 / (1.0 + p)))


@routine
def prune(t_s: float, onset: OnsetState) -> None:
    """Make room for one more ramp: drop the oldest if it is too old, else merge two."""
    if onset.count < RAMPS.most:
        return
    count, ramps = onset.count, onset.ramps
    if t_s - ramps[0].start_s > max(RAMPS.age_s, RAMPS.age_scans * (t_s - ramps[count - 1].start_s)):
        remove(0, count, ramps)
    else:
        merge_closest(t_s, count, RAMPS.recent, ramps)
    onset.count -= 1
