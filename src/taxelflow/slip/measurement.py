"""Input of the slip detector: scans of a pad as records, and the measurement of its pose that the filters use."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, NamedTuple

import numpy as np

from taxelflow.messages import AMBIGUOUS, LOST, OK, UNRESOLVED, Bools, Bytes, Floats, Slips
from taxelflow.numerics.clock import ROUNDING_S
from taxelflow.numerics.records import Records, Vector, record_dtype
from taxelflow.numerics.rounding import BLIND_M, SIGNIFICANT
from taxelflow.runtime.blocks import is_block
from taxelflow.runtime.compiling import kernel, routine
from taxelflow.slip.covariance import Covariance

UNOBSERVABLE_RATIO = 100.0
"""An axis x or y is not observable if its standard deviation exceeds this multiple of the other's, and `BLIND_M`. The
centroid of a line of taxels has no variance across the line, which is no evidence about motion along it."""


class _Mean(NamedTuple):
    """The mean variance at rest."""

    weight: float = 0.05
    most_ratio: float = 4.0
    """Weight of a pose in the mean variance at rest (about 20 poses), and the multiple of the mean at which it is
    cut."""


_MEAN = _Mean()


class _LeastStd(NamedTuple):
    """Lower limit of the standard deviation of a pose, below any sensor's; some methods report 0."""

    m: float = 1e-6
    rad: float = 1e-5


LEAST_STD = _LeastStd()


class Parameters:
    """Fields of `SlipMonitor`."""

    alarm_interval_s: float
    """Accepted mean time between false alarms."""
    load_m: float
    creep_m_s: float
    settle_s: float


def parameter_records(alarms_per_hour: float, load_m: float, creep_m_s: float, settle_s: float) -> Records:
    """(1,) of `Parameters`, from the fields of `SlipMonitor`: numba takes 8 us to type a record alone."""
    values = (3600.0 / alarms_per_hour, load_m, creep_m_s, settle_s)
    return np.array([values], dtype=record_dtype(Parameters))


class Observation:
    """One scan of one pad: fields of `Slips`."""

    t_s: float
    contact: bool
    displacement: Vector
    displacement_covariance: Annotated[Floats, 3, 3]
    pose: Vector
    pose_covariance: Annotated[Floats, 3, 3]
    lag_s: float
    load: float
    disturbance: float
    quality: int


_OBSERVATION = record_dtype(Observation)
_FIELDS = sorted({field.name for field in fields(Slips)} & set(_OBSERVATION.names or ()) - {"t_s"})
"""What is called the same in both."""


class Measurement:
    """Pose of a pad relative to its first scan, with its noise."""

    t_s: float
    previous_s: float
    """Time of this measurement and of the one before."""
    log_load: float
    """Logarithm of the load; 0 if it is unknown."""
    position: Vector
    """Accumulated displacement."""
    covariance: Covariance
    """Noise of the accumulated displacement of an object at rest; NaN variance where a coordinate is not used."""
    walk: float
    """Variance by which the pose of an object at rest has walked since the one before, over that of its noise."""
    pose_covariance: Covariance
    """Covariance of the absolute pose."""


def observations(slips: Slips) -> Records:
    """(scans, pads) records of `Observation`."""
    found = np.empty(slips.contact.shape, dtype=_OBSERVATION)
    if is_block(len(slips), _observe):
        found["t_s"] = slips.t_s[:, np.newaxis]
        found["pose_covariance"] = slips.covariance
        for name in _FIELDS:
            found[name] = getattr(slips, name)
        return found
    seen = (slips.pose, slips.covariance, slips.displacement, slips.displacement_covariance)
    _observe(slips.t_s, slips.contact, seen, (slips.lag_s, slips.load, slips.disturbance), slips.quality, found)
    return found


@kernel
def _observe(
    t_s: Floats,
    contact: Bools,
    seen: tuple[Floats, Floats, Floats, Floats],
    scalars: tuple[Floats, Floats, Floats],
    quality: Bytes,
    found: Records,
) -> None:
    """Fill found (scans, pads) of `Observation`. seen: pose and displacement, each with its covariance. scalars: lag,
    load and disturbance.
    """
    pose, covariance, displacement, displacement_covariance = seen
    lag_s, load, disturbance = scalars
    for scan in range(found.shape[0]):
        for pad in range(found.shape[1]):
            one: Observation = found[scan, pad]
            one.t_s, one.contact, one.quality = t_s[scan], contact[scan, pad], quality[scan, pad]
            one.lag_s, one.load, one.disturbance = lag_s[scan, pad], load[scan, pad], disturbance[scan, pad]
            _copy(
                displacement[scan, pad],
                displacement_covariance[scan, pad],
                one.displacement,
                one.displacement_covariance,
            )
            _copy(pose[scan, pad], covariance[scan, pad], one.pose, one.pose_covariance)


@routine
def _copy(place: Floats, spread: Floats, to_place: Floats, to_spread: Floats) -> None:
    """Copy (3,) and (3, 3)."""
    for a in range(3):
        to_place[a] = place[a]
        for b in range(3):
            to_spread[a, b] = spread[a, b]


@routine
def has_pose(scan: Observation, partial: bool) -> bool:
    """Whether the displacement of a scan can be used.

    partial: the contact is what remained after a sudden loss of load. It may be drift and not a contact, so its
    quality must be ok, or ambiguous with one observable axis.
    """
    if np.isnan(scan.displacement[0]) or scan.quality == LOST:
        return False
    on_line = scan.quality == AMBIGUOUS and _one_observable_axis(scan.displacement_covariance)
    return not partial or scan.quality == OK or on_line


@routine
def measure(scan: Observation, measurement: Measurement) -> bool:
    """Add a scan's displacement; fill in the measurement and return True if it is independent of the one before.

    A pose with a lag is the mean of two scans and shares one of them with the next pose: every second one is used.
    """
    for axis in range(3):
        step = scan.displacement[axis]
        measurement.position[axis] += step if not np.isnan(step) else 0.0
    shared = scan.lag_s > 0.0
    if shared and not scan.t_s - 2.0 * scan.lag_s > measurement.previous_s + ROUNDING_S:
        return False
    measurement.t_s = scan.t_s
    # A displacement is the difference of two poses: half of its covariance is that of one pose.
    factor = _quality_factor(scan) * (1.0 if shared else 0.5)
    _set_covariance(scan.displacement_covariance, factor, measurement.covariance)
    _drop_unobservable_axis(measurement.covariance)
    return True


@routine
def measure_pose(scan: Observation, noise_scale: float, measurement: Measurement) -> None:
    """Fill in the covariance of the absolute pose, times the learned scale of the noise."""
    _set_covariance(scan.pose_covariance, _quality_factor(scan) * noise_scale, measurement.pose_covariance)


@routine
def raise_to_mean(poses: int, mean_variance: Floats, covariance: Covariance) -> None:
    """Raise the covariance of an object at rest to its mean over the last poses, axis by axis.

    A reported covariance belongs to the place where noise put the pose. Where the covariance differs between places, an
    outlier may report a small one. An object at rest has one place, and one covariance.
    poses: number of poses since the contact began. mean_variance: (3,), updated; an axis of 0 has no mean yet.
    """
    if poses == 1:
        mean_variance[:] = 0.0
    weight = max(1.0 / poses, _MEAN.weight)
    x = _raise_axis(covariance.variance, 0, weight, mean_variance)
    y = _raise_axis(covariance.variance, 1, weight, mean_variance)
    theta = _raise_axis(covariance.variance, 2, weight, mean_variance)
    covariance.xy *= x * y
    covariance.xt *= x * theta
    covariance.yt *= y * theta


@routine
def _raise_axis(variance: Floats, axis: int, weight: float, mean: Floats) -> float:
    """Update the mean variance of an axis and raise the variance to it; the factor on the standard deviation."""
    own = variance[axis]
    if np.isnan(own):
        return 1.0
    before = mean[axis] if mean[axis] > 0.0 else own
    mean[axis] = before + weight * (min(own, _MEAN.most_ratio * before) - before)
    factor = np.sqrt(max(mean[axis] / own, 1.0))
    variance[axis] *= factor * factor
    return float(factor)


@routine
def _quality_factor(scan: Observation) -> float:
    """Factor on the variance of a pose by its quality: errors of a scan that does not fit its model are significant."""
    return SIGNIFICANT**2 if scan.quality == UNRESOLVED else 1.0


@routine
def _set_covariance(matrix: Floats, factor: float, covariance: Covariance) -> None:
    """Fill in `factor` times a (3, 3) covariance plus the smallest variance of a pose."""
    covariance.variance[0] = factor * matrix[0, 0] + LEAST_STD.m**2
    covariance.variance[1] = factor * matrix[1, 1] + LEAST_STD.m**2
    covariance.variance[2] = factor * matrix[2, 2] + LEAST_STD.rad**2
    covariance.xy = factor * matrix[0, 1]
    covariance.xt = factor * matrix[0, 2]
    covariance.yt = factor * matrix[1, 2]


@routine
def _one_observable_axis(matrix: Floats) -> bool:
    """Whether exactly one of x and y is observable, by a (3, 3) covariance."""
    xx, yy = matrix[0, 0], matrix[1, 1]
    return _unobservable(xx, yy) or _unobservable(yy, xx)


@routine
def _unobservable(own: float, other: float) -> bool:
    """Whether an axis is not observable, by the variances along it and along the other axis, m^2."""
    return bool(own > max(UNOBSERVABLE_RATIO**2 * other, BLIND_M**2))


@routine
def _drop_unobservable_axis(covariance: Covariance) -> None:
    """Mark x or y as unknown if it is not observable."""
    if _unobservable(covariance.variance[0], covariance.variance[1]):
        covariance.variance[0], covariance.xy, covariance.xt = np.nan, 0.0, 0.0
    if _unobservable(covariance.variance[1], covariance.variance[0]):
        covariance.variance[1], covariance.xy, covariance.yt = np.nan, 0.0, 0.0
