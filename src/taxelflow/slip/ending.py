"""End of a slip: the posterior odds that the object has stopped against that it still slips.

Slipping is a Kalman filter of position and velocity. Hypothesis j is that the object stopped after scan j: its position
is constant since. With L_j the likelihood ratio of hypothesis j to slipping, the odds are the sum over j of
rate_j (t_j+1 - t_j) L_j (Shiryaev). The rate of a stop is that of the object, and unknown. With a gamma prior of shape
n and mean n / T_0 it is n / (T_0 + T) after a slip that has lasted T: one that has lasted is likely to go on. With a
constant rate a slow slip, whose poses exclude a stop only after seconds, ended by prior alone. A late report of a stop
costs a scan or two; an early one can be withdrawn until the odds are clear.
"""

from __future__ import annotations

from math import exp, log
from typing import Annotated, NamedTuple

import numpy as np

from taxelflow.messages import Floats
from taxelflow.numerics.records import Records, Vector
from taxelflow.runtime.compiling import routine
from taxelflow.slip.covariance import (
    Cholesky,
    factorize,
    translation_axes,
    translation_variance,
    whiten,
)
from taxelflow.slip.hypotheses import merge_closest
from taxelflow.slip.measurement import Measurement
from taxelflow.slip.onset import MAX_EXPONENT, SlipEstimate


class _Slip(NamedTuple):
    """Prior of a slip, and of its end."""

    stops: float = 3.0
    prior_s: float = 1.0
    """n and T_0 of the rate of a stop: a slip lasts a third of a second."""
    velocity_walk: float = 0.002
    """Random walk of the velocity of a slip, m/s per root s."""
    path_error: float = 0.1
    """Error of a displacement as a share of its length, beyond the noise of an object at rest."""
    creeps: float = 3.0
    """A slip is faster than this multiple of the creep of `SlipMonitor`."""


_SLIP = _Slip()


class _Stops(NamedTuple):
    """Stops that are tested at a time."""

    most: int = 12
    recent: int = 6
    """The latest stops, which are never merged."""


_STOPS = _Stops()


class Stop:
    """Hypothesis that the object stopped after a scan."""

    start_s: float
    """Time of that scan."""
    since_s: float
    """When it stopped: half-way to the next scan."""
    weight: float
    """Time that it stands for, s; of merged hypotheses the sum."""
    log_ratio: float
    """log L."""
    position: Vector
    variance: float
    """Of the position, m^2."""


class StopEstimate:
    """Where and since when the object rests, by the most likely hypothesis."""

    since_s: float
    position: Vector
    variance: float
    """Of the position, m^2."""


class SlideState:
    """State of a slipping object on one pad."""

    position: Vector
    """m, m, rad."""
    velocity: Vector
    """m/s, m/s, rad/s."""
    q_pp: float
    q_pv: float
    q_vv: float
    """Covariance of position and velocity of a translation, m^2, m^2/s, m^2/s^2."""
    start_s: float
    origin: Vector
    """Time and position of the onset."""
    stop_reported: bool
    """A stop is reported, but its odds do not exclude that the slip continues."""
    reported_s: float
    earlier_odds: float
    later_evidence: float
    """Time of the scan in which it was reported; odds of the stops up to then; those of later ones beyond a priori."""
    yaw_lost: bool
    """Theta was unknown at some time since the onset and is not used."""
    factor: Cholesky
    residual: Vector
    """Scratch values of `stop_odds`."""
    count: int
    """Stops in use, oldest first."""
    stops: Annotated[Records, Stop, _STOPS.most]
    stop: StopEstimate


@routine
def start_slide(measurement: Measurement, slip: SlipEstimate, variance: float, slide: SlideState) -> None:
    """Start from the slip that the onset detector found.

    variance: of the position, m^2, without the part of the velocity.
    """
    t_s, start_s = measurement.t_s, slip.start_s
    slide.start_s, slide.count = start_s, 0
    slide.stop_reported = slide.yaw_lost = False
    for axis in range(3):
        slide.position[axis], slide.velocity[axis] = slip.position[axis], slip.velocity[axis]
        slide.origin[axis] = slip.position[axis] - (t_s - start_s) * slip.velocity[axis]
    lag_s = slip.cross_covariance / slip.velocity_variance
    slide.q_pp, slide.q_pv = variance + lag_s * slip.cross_covariance, slip.cross_covariance
    unsure = 0.5 * (t_s - measurement.previous_s) / (t_s - start_s)  # the slip started between two poses
    slide.q_vv = slip.velocity_variance + (unsure * unsure) * (slide.velocity[0] ** 2 + slide.velocity[1] ** 2)


@routine
def start_stopped(
    measurement: Measurement, way: tuple[float, float], start_s: float, end_s: float, dt_s: float, slide: SlideState
) -> None:
    """Start from a slip that is over, as the jump test found it: one hypothesis of a stop, at the measurement.

    way: (x, y) of the slip, m. dt_s: between scans.
    """
    y, variance = measurement.position, translation_variance(measurement.covariance)
    slide.start_s, slide.count = start_s, 1
    slide.stop_reported, slide.yaw_lost = False, True
    slide.position[2] = slide.origin[2] = y[2]
    slide.velocity[2] = 0.0
    for axis in range(2):
        slide.position[axis], slide.origin[axis] = y[axis], y[axis] - way[axis]
        slide.velocity[axis] = way[axis] / (end_s - start_s)
    slide.q_pp, slide.q_pv, slide.q_vv = variance, 0.0, 0.0
    stop: Stop = slide.stops[0]
    stop.start_s, stop.since_s = end_s - 0.5 * dt_s, end_s
    stop.weight, stop.log_ratio = dt_s, 0.0
    stop.variance = variance
    for axis in range(3):
        stop.position[axis] = y[axis]


@routine
def stop_odds(measurement: Measurement, creep_m_s: float, slide: SlideState) -> float:
    """Odds that the object has stopped, after one more measurement; infinite if the slip is slower than creep.

    Fills `slide.stop` from the most likely stop. The covariance of the measurement includes the learned scale.
    """
    t_s, noise, stop = measurement.t_s, measurement.covariance, slide.stop
    own = translation_variance(noise)
    yaw_used = factorize(noise, slide.factor)
    axes = translation_axes(noise) + (1 if yaw_used else 0)
    _start_stop(t_s, measurement.previous_s, slide)
    slipping = _update_slide(measurement, own, axes, slide)
    _estimate_stop(t_s, slide.q_pp, slide.position, stop)
    odds = most = slide.earlier_odds = slide.later_evidence = 0.0
    for j in range(slide.count):
        each: Stop = slide.stops[j]
        _update_stop(measurement, own, axes, slipping, each, slide)
        rate_hz = _SLIP.stops / (_SLIP.prior_s + max(each.start_s - slide.start_s, 0.0))
        share = rate_hz * each.weight * exp(min(each.log_ratio, MAX_EXPONENT))
        odds += share
        if each.start_s < slide.reported_s:
            slide.earlier_odds += share
        else:
            slide.later_evidence += share - rate_hz * each.weight
        if share > most:
            most = share
            _estimate_stop(each.since_s, each.variance, each.position, stop)
    turn_m = slide.velocity[2] * np.sqrt(own / noise.variance[2]) if yaw_used else 0.0
    speed = np.sqrt(slide.velocity[0] ** 2 + slide.velocity[1] ** 2 + turn_m**2) + np.sqrt(slide.q_vv)
    return odds if speed > _SLIP.creeps * creep_m_s else np.inf


@routine
def _update_slide(measurement: Measurement, own: float, axes: int, slide: SlideState) -> float:
    """Kalman filter of position and velocity; the log likelihood of the measurement, relative to its noise."""
    dt, e = measurement.t_s - measurement.previous_s, slide.residual
    pp, pv, vv = slide.q_pp, slide.q_pv, slide.q_vv + _SLIP.velocity_walk**2 * dt
    way = dt * np.hypot(slide.velocity[0], slide.velocity[1])
    pp, pv = pp + 2.0 * dt * pv + dt * dt * vv + (_SLIP.path_error * way) ** 2, pv + dt * vv
    total = pp + own
    for axis in range(3):
        slide.position[axis] += dt * slide.velocity[axis]
        known = not np.isnan(measurement.covariance.variance[axis])
        e[axis] = measurement.position[axis] - slide.position[axis] if known else 0.0
        slide.position[axis] += pp / total * e[axis]
        slide.velocity[axis] += pv / total * e[axis]
    slide.q_pp, slide.q_pv, slide.q_vv = pp * own / total, pv * own / total, vv - pv * pv / total
    return _log_likelihood(slide.factor, e, own, total, axes)


@routine
def _update_stop(
    measurement: Measurement, own: float, axes: int, slipping: float, stop: Stop, slide: SlideState
) -> None:
    """Kalman filter of a constant position, and its likelihood ratio. slipping: log likelihood that it slips."""
    total, e = stop.variance + own, slide.residual
    for axis in range(3):
        known = not np.isnan(measurement.covariance.variance[axis])
        e[axis] = measurement.position[axis] - stop.position[axis] if known else 0.0
        stop.position[axis] += stop.variance / total * e[axis]
    stop.log_ratio += _log_likelihood(slide.factor, e, own, total, axes) - slipping
    stop.variance *= own / total


@routine
def _log_likelihood(factor: Cholesky, residual: Floats, own: float, total: float, axes: int) -> float:
    """Log likelihood of a residual (3,) of variance `total` with noise `own`; the residual is whitened in place."""
    return float(-0.5 * whiten(factor, residual) * own / total - 0.5 * axes * log(total / own))


@routine
def _estimate_stop(since_s: float, variance: float, position: Floats, stop: StopEstimate) -> None:
    stop.since_s, stop.variance = since_s, variance
    for axis in range(3):
        stop.position[axis] = position[axis]


@routine
def _start_stop(t_s: float, previous_s: float, slide: SlideState) -> None:
    """Add a stop between the measurement before and this one; its position is uniform over the path in between."""
    dt = t_s - previous_s
    if slide.count == _STOPS.most:
        merge_closest(t_s, slide.count, _STOPS.recent, slide.stops)
        slide.count -= 1
    stop: Stop = slide.stops[slide.count]
    stop.start_s, stop.since_s = previous_s, previous_s + 0.5 * dt
    stop.weight, stop.log_ratio = dt, 0.0
    way = dt * np.hypot(slide.velocity[0], slide.velocity[1])
    stop.variance = slide.q_pp + way * way / 12.0
    for axis in range(3):
        stop.position[axis] = slide.position[axis] + 0.5 * dt * slide.velocity[axis]
    slide.count += 1
