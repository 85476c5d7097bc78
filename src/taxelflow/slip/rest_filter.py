"""Kalman filter of an object at rest: position, displacement by load, creep, and the scale of the pose noise.

Per axis x, y, theta, with l the logarithm of the load and r[k] the variance of the pose z[k]:

    a[k] = a[k-1] + b[k-1] (l[k] - l[k-1]) + c[k-1] (t[k] - t[k-1]) + w[k],
    z[k] = a[k] + v[k],      v[k] ~ N(0, s^2 r[k]),      w[k] ~ N(0, s^2 q[k]).

a is the position, b the displacement per unit of l, c the creep, w the walk of a sum of steps (see `walk`). b and c are
first-order Gauss-Markov processes of mean 0. All axes share one state covariance and one gain: noise that is k times
larger along one axis makes the position k times less certain there. Innovations, whitened by the covariance of the
noise, are u ~ N(0, s^2 I). s^2 and the lag-1 autocorrelation of u are learned.
"""

from __future__ import annotations

from math import exp
from typing import NamedTuple

import numpy as np

from taxelflow.messages import Floats
from taxelflow.numerics.records import Vector
from taxelflow.runtime.compiling import routine
from taxelflow.slip.covariance import Cholesky, factorize, translation_axes, translation_variance, whiten
from taxelflow.slip.measurement import Measurement, Parameters


class _Scale(NamedTuple):
    """How the scale s^2 of the noise is learned, and applied."""

    prior: float = 20.0
    """Weight of the reported covariance in the scale s^2, in components of u: about seven poses."""
    memory: float = 3000.0
    """Components of u over which s^2 is averaged: about a thousand poses."""
    most: float = 25.0
    """Upper limit of s^2: a covariance too small by more than a factor of 5 in standard deviation is not learned."""
    least: float = 0.9
    """Lower limit of s^2 as applied: a covariance that is too large is corrected by 5 % in standard deviation only."""
    least_learned: float = 0.01
    """Lower limit of s^2 as learned, so that a method that repeats its pose recovers from it."""
    steady_variance: float = 0.05
    """Variance of the log load below which s^2 may be less than 1. A covariance that is too large under high load may
    be right under low load."""


_SCALE = _Scale()


class _Inflation(NamedTuple):
    """Inflation of the variance of correlated poses."""

    poses: int = 16
    """Products of consecutive u count one block of poses later: the last block may contain a slip not detected yet."""
    most: float = 9.0
    """Largest variance inflation: that of an autocorrelation of 0.8."""


_INFLATION = _Inflation()
_RELAXATION_S = 1.0
"""Time constant of the Gauss-Markov processes b and c."""
_YAW_POSES = 20
"""Poses in a row at which theta must be known before it is used again."""


class Innovation:
    """What the last pose added to the rest filter."""

    load_change: float
    """Change of the log load since the pose before."""
    decay: float
    """Factor by which b and c decayed since the pose before."""
    gain_a: float
    gain_b: float
    gain_c: float
    """Kalman gains of a (1), b (1) and c (1/s)."""
    std_ratio: float
    """Standard deviation of the noise over that of the innovation."""
    variance: float
    """s^2 r: variance of the noise of a translation, m^2."""
    axes: int
    """How many of x and y are known."""
    yaw_used: bool
    """Theta is used."""
    factor: Cholesky
    """Cholesky factor of the covariance of the noise."""
    whitened: Vector
    """u."""


class RestState:
    """State of the rest filter of one pad."""

    position: Vector
    """a, m, m, rad."""
    load_gain: Vector
    """b, m, m, rad per unit of log load."""
    creep: Vector
    """c, m/s, m/s, rad/s."""
    p_aa: float
    p_ab: float
    p_ac: float
    p_bb: float
    p_bc: float
    p_cc: float
    """Covariance of (a, b, c) of a translation, m^2 and m^2/s, m^2/s^2."""
    log_load: float
    """Log load at the last pose."""
    yaw_poses: int
    """Poses in a row at which theta was known, at most `_YAW_POSES`; theta is used from there on."""
    square_sum: float
    """Sum of u^2 with exponential forgetting; over `components` it is s^2."""
    components: float
    """Number of components in `square_sum`; 0 before the first pose."""
    product_sum: float
    """Sum of the products u[k]'u[k-1] of completed blocks but the last, with the same forgetting."""
    last_block: float
    """The same sum over the last completed block, which is not in `product_sum` yet."""
    this_block: float
    block_poses: int
    """The same sum over the block that is not completed, and its number of poses."""
    previous: Vector
    """u[k-1]."""
    mean_log_load: float
    load_variance: float
    """Mean and variance of the log load, with exponential forgetting."""
    innovation: Innovation


@routine
def noise_scale(rest: RestState) -> float:
    """s^2: variance of the observed noise over that of the reported covariance. Below 1 only at steady load."""
    if rest.components == 0.0:
        return 1.0
    least = _SCALE.least if rest.load_variance < _SCALE.steady_variance else 1.0
    return float(min(max(rest.square_sum / rest.components, least), _SCALE.most))


@routine
def correlation_inflation(rest: RestState) -> float:
    """Variance of a mean of many u over that of independent u: (1 + r) / (1 - r) for an autocorrelation r, at least 1.

    r is reduced by one standard deviation of its estimate from independent noise.
    """
    r = rest.product_sum / rest.square_sum - 1.0 / np.sqrt(rest.components)
    if r <= 0.0:
        return 1.0
    return float((1.0 + r) / (1.0 - r)) if r < (_INFLATION.most - 1.0) / (_INFLATION.most + 1.0) else _INFLATION.most


@routine
def start_rest(position: Floats, variance: float, log_load: float, parameters: Parameters, rest: RestState) -> None:
    """The object rests at a position (3,) of this variance, m^2; b and c have their prior."""
    for axis in range(3):
        rest.position[axis], rest.load_gain[axis], rest.creep[axis] = position[axis], 0.0, 0.0
        rest.previous[axis] = 0.0
    rest.p_ab = rest.p_ac = rest.p_bc = 0.0
    rest.p_aa, rest.p_bb, rest.p_cc = variance, parameters.load_m**2, parameters.creep_m_s**2
    rest.log_load, rest.yaw_poses = log_load, _YAW_POSES
    rest.last_block, rest.this_block, rest.block_poses = 0.0, 0.0, 0
    if rest.components == 0.0:
        rest.square_sum = rest.components = _SCALE.prior


@routine
def discount_noise_scale(rest: RestState) -> None:
    """Reduce what was learned of the noise to the weight of the prior; keep s^2 only if it is above 1."""
    rest.square_sum = _SCALE.prior * max(noise_scale(rest), 1.0)
    rest.components = _SCALE.prior
    rest.product_sum = rest.mean_log_load = rest.load_variance = 0.0


@routine
def update_rest(measurement: Measurement, parameters: Parameters, rest: RestState) -> None:
    """Predict to the time of a measurement, fill `rest.innovation`, update.

    Where theta is known but not used yet, its variance in the measurement becomes NaN.
    """
    step, noise = rest.innovation, measurement.covariance
    step.load_change = measurement.log_load - rest.log_load
    rest.log_load = measurement.log_load
    _predict(measurement.t_s - measurement.previous_s, parameters, rest)
    step.variance, step.axes = translation_variance(noise) * noise_scale(rest), translation_axes(noise)
    rest.p_aa += measurement.walk * step.variance
    total = rest.p_aa + step.variance
    step.gain_a, step.gain_b, step.gain_c = rest.p_aa / total, rest.p_ab / total, rest.p_ac / total
    step.std_ratio = np.sqrt(step.variance / total)
    _update_load_statistics(measurement.log_load, rest)
    step.yaw_used = _use_yaw(measurement, rest)
    factorize(noise, step.factor)
    _correct(measurement, rest)
    _update_noise_statistics(whiten(step.factor, step.whitened), rest)


@routine
def _predict(dt_s: float, parameters: Parameters, rest: RestState) -> None:
    """Time update of state and covariance; b and c decay towards their prior."""
    change = rest.innovation.load_change
    keep = exp(-dt_s / _RELAXATION_S)
    fresh = 1.0 - keep * keep
    rest.innovation.decay = keep
    for axis in range(3):
        rest.position[axis] += change * rest.load_gain[axis] + dt_s * rest.creep[axis]
        rest.load_gain[axis] *= keep
        rest.creep[axis] *= keep
    aa, ab, ac, bb, bc, cc = rest.p_aa, rest.p_ab, rest.p_ac, rest.p_bb, rest.p_bc, rest.p_cc
    to_b, to_c = ab + change * bb + dt_s * bc, ac + change * bc + dt_s * cc
    rest.p_aa = aa + change * ab + dt_s * ac + change * to_b + dt_s * to_c
    rest.p_ab, rest.p_ac, rest.p_bc = keep * to_b, keep * to_c, keep * keep * bc
    rest.p_bb = keep * keep * bb + fresh * parameters.load_m**2
    rest.p_cc = keep * keep * cc + fresh * parameters.creep_m_s**2


@routine
def _correct(measurement: Measurement, rest: RestState) -> None:
    """Measurement update of state and covariance; `whitened` becomes the innovation, not whitened yet."""
    step, noise = rest.innovation, measurement.covariance
    for axis in range(3):
        known = not np.isnan(noise.variance[axis])
        residual = measurement.position[axis] - rest.position[axis] if known else 0.0
        step.whitened[axis] = residual * step.std_ratio
        rest.position[axis] += step.gain_a * residual
        rest.load_gain[axis] += step.gain_b * residual
        rest.creep[axis] += step.gain_c * residual
    aa, ab, ac = rest.p_aa, rest.p_ab, rest.p_ac
    rest.p_aa -= step.gain_a * aa
    rest.p_ab -= step.gain_a * ab
    rest.p_ac -= step.gain_a * ac
    rest.p_bb -= step.gain_b * ab
    rest.p_bc -= step.gain_b * ac
    rest.p_cc -= step.gain_c * ac


@routine
def _use_yaw(measurement: Measurement, rest: RestState) -> bool:
    """Whether theta was known for long enough to be used; until then its position is the mean since it is known."""
    variance = measurement.covariance.variance
    if np.isnan(variance[2]):
        rest.yaw_poses = 0
        return False
    if rest.yaw_poses == _YAW_POSES:
        return True
    rest.yaw_poses += 1
    rest.position[2] += (measurement.position[2] - rest.position[2]) / rest.yaw_poses
    variance[2] = np.nan
    return False


@routine
def _update_load_statistics(log_load: float, rest: RestState) -> None:
    """Mean and variance of the log load, with the memory of the noise scale at two components a pose."""
    if rest.components == _SCALE.prior:
        rest.mean_log_load = log_load
    weight, residual = 2.0 / _SCALE.memory, log_load - rest.mean_log_load
    rest.mean_log_load += weight * residual
    rest.load_variance = (1.0 - weight) * (rest.load_variance + weight * residual * residual)


@routine
def _update_noise_statistics(square: float, rest: RestState) -> None:
    """Scale and autocorrelation of the noise, from the last u and its squared length."""
    step = rest.innovation
    components = step.axes + (1 if step.yaw_used else 0)
    keep = 1.0 - components / _SCALE.memory
    rest.components = keep * rest.components + components
    total = keep * rest.square_sum + square
    rest.square_sum = min(max(total, _SCALE.least_learned * rest.components), _SCALE.most * rest.components)
    rest.product_sum *= keep
    for axis in range(3):
        rest.this_block += step.whitened[axis] * rest.previous[axis]
        rest.previous[axis] = step.whitened[axis]
    rest.block_poses += 1
    if rest.block_poses == _INFLATION.poses:
        rest.product_sum += rest.last_block
        rest.last_block, rest.this_block, rest.block_poses = rest.this_block, 0.0, 0
