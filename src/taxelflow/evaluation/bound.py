"""The Cramér-Rao bound of a scenario: the least error of the object's pose in each scan, for any unbiased method.

A reading is g_k q(R(theta_k)^T (r_i - x_k)) + b_k + n: pattern q, and of scan k pose x_k, theta_k, gain g_k and a
baseline b_k common to the pad, both free in every scan; n has the variance of the noise and of the quantisation,
noise_pa^2 + step^2 / 12. Dead and saturated taxels have no information. Other effects of the rig (gain spread, wobble,
drift) are not included. With J the readings' derivatives by the parameters, the information is J^T J / variance;
gain, baseline and pattern are eliminated by Schur complements.

- Pattern known: each scan stands alone.
- Pattern unknown: the coefficients of a cubic B-spline on knots at half the pitch, where the object presses at all,
  are parameters too, shared by all scans of a contact. Pattern and poses may then be moved against each other by any
  rigid motion; the bound is that of the errors left after the best such motion was taken off (weights: information
  with the pattern known). It is None where the pattern does not stay the same, but for a gain, while the object moves.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import starmap
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import NdBSpline
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.sparse import bsr_array, csr_array

from taxelflow.errors import NameUnknown, ParameterInvalid
from taxelflow.numerics.geometry import rotation
from taxelflow.numerics.rounding import LINE_POINTS, ROUNDING
from taxelflow.numerics.spans import spans
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.simulation.load import state_at
from taxelflow.simulation.motion import move
from taxelflow.simulation.sensing import delays
from taxelflow.simulation.simulate import pressures

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats
    from taxelflow.sensors.layout import Layout
    from taxelflow.simulation.scenario import Scenario


@dataclass(frozen=True, slots=True)
class _Step:
    """Steps of the central differences, in pitches."""

    place: float = 5e-3
    edge: float = 0.05
    """A turn moves the object's farthest edge by this. About the resolution of a scan, so that structure too fine to be
    observed (the cells of the elastic solver's fields) has little effect."""


_STEP = _Step()
_LOOSE = np.diag([1.0, 1.0, 1e-2])
"""Information added to every pose, of 1 m and 10 rad: keeps the matrices of scans without information invertible."""
_SPINS_RAD = 0.2
"""Median standard deviation above which the angle is not observable, as of a round contact."""
_PRESSED = 0.01
"""Share of the largest pressure above which a taxel lies on the object."""
_FREE = 10.0
"""Prior standard deviation of the pattern's coefficients, over the largest pressure: practically no prior."""


@dataclass(frozen=True, slots=True)
class Bound:
    """Bounds of all scans of one pad.

    pose: (scans, 3), the true one. known, unknown: (scans, 3) standard deviations in m, m, rad with the pattern known
    and unknown; NaN for a turn that cannot be observed, and (unknown) for scans that are not scored. scored: (scans,),
    the known bound is below a quarter of a pitch along both axes: other scans hardly determine a position. since_known,
    since_unknown: (scans, 3), of the object's motion since the first scored scan of its contact; NaN in that one.
    """

    pose: Floats
    known: Floats
    unknown: Floats
    scored: Bools
    since_known: Floats
    since_unknown: Floats


@dataclass(frozen=True, slots=True)
class Model:
    """Readings over their noise, and derivatives: pressure (scans, taxels), by_pose (scans, taxels, 3), both with gain
    and baseline projected out but for `nuisance` (scans, taxels, 2), an orthonormal basis of what was.

    points: (scans, taxels, 2), the taxels in the object's frame, m. weight: (scans, taxels), 1 over noise, 0 where
    blind. gain: (scans, taxels).
    """

    pressure: Floats
    by_pose: Floats
    nuisance: Floats
    points: Floats
    weight: Floats
    gain: Floats


def bound_of(scenario: Scenario, t_s: Floats, *, jointly: bool = True) -> Bound:
    """Bounds at the true times (scans,) of a scenario on one pad. Raises NameUnknown, ParameterInvalid.

    jointly: with the pattern unknown too, which is slow for a thousand scans; else `unknown` is NaN.
    """
    layout = load_sensor(scenario.sensor).layout
    pads = layout.pads[: layout.pad_count]
    if scenario.pad not in pads:
        if scenario.pad == "hand":
            raise ParameterInvalid("pad", scenario.pad, "be one pad: choose a scenario on a single pad")
        raise NameUnknown("pad", scenario.pad, pads)
    pad = pads.index(scenario.pad)
    pitch = layout.pitch_m[pad]
    model = modelled(scenario, layout, pad, t_s)
    pose = move(scenario.motion, t_s, scenario.seed).pose
    information = np.swapaxes(model.by_pose, 1, 2) @ model.by_pose
    known, axes = _deviations(information), slice(3)
    fixed = _deviations(information, 2)
    placed = (fixed < pitch / 4).all(axis=1)
    if not placed.any() or np.median(known[placed, 2]) > _SPINS_RAD:
        known, axes = np.concatenate([fixed, np.full((len(t_s), 1), np.nan)], axis=1), slice(2)
    scored = (known[:, :2] < pitch / 4).all(axis=1)
    unknown, since_known, since_unknown = (np.full_like(known, np.nan) for _ in range(3))
    alone = _covariances(information, axes.stop)
    for contact in starmap(np.arange, spans(scored)):
        if len(contact) < LINE_POINTS:  # nothing is left of fewer when offset and angle are taken off
            continue
        own, later = alone[contact], contact[1:]
        since_known[later, axes] = _since(pose[contact, 2], own, np.zeros_like(own))
        if jointly and _stays_the_same(scenario):
            knot_m = float(pitch.min()) / 2
            found = _jointly(model, pose, known[:, axes], contact, knot_m)
            unknown[contact, axes], since_unknown[later, axes] = found
    return Bound(pose, known, unknown, scored, since_known, since_unknown)


def _covariances(information: Floats, axes: int) -> Floats:
    return np.asarray(np.linalg.inv((information + _LOOSE)[:, :axes, :axes]), dtype=np.float64)


def _deviations(information: Floats, axes: int = 3) -> Floats:
    return np.sqrt(np.diagonal(_covariances(information, axes), axis1=1, axis2=2))


def _since(theta: Floats, own: Floats, with_first: Floats) -> Floats:
    """Standard deviations (scans - 1, axes) of motions since the first scan, in which a body point is what it is.

    A pose that errs by e0 in the first scan errs by the turned e0 in all that are counted from it. own: (scans, axes,
    axes), covariances. with_first: (scans, axes, axes), of each scan's error with that of the first.
    """
    turned = np.zeros_like(own)
    turned[:, :2, :2] = rotation(theta - theta[0])
    turned[:, 2:, 2:] = 1.0
    crossed = with_first @ np.swapaxes(turned, 1, 2)
    whole = own + turned @ own[0] @ np.swapaxes(turned, 1, 2) - crossed - np.swapaxes(crossed, 1, 2)
    deviation: Floats = np.sqrt(np.diagonal(whole, axis1=1, axis2=2)[1:])
    return deviation


def _stays_the_same(scenario: Scenario) -> bool:
    load = scenario.load
    shape = load.growth or load.tilt or load.roll_m or scenario.contact.deform_1_m
    return not shape and (scenario.solver == "analytic" or load.kind == "constant")


def modelled(scenario: Scenario, layout: Layout, pad: int, t_s: Floats) -> Model:
    """Readings of a pad at the true times (scans,), and their derivatives by the object's pose in the pad's frame."""
    own, sensing = layout.of_pad(pad), scenario.sensing
    taxels = np.arange(layout.taxels)[own]
    pressure = pressures(scenario, layout, [pad], t_s)[:, own]
    pitch_m = layout.pitch_m[pad]
    steps = np.array([*(_STEP.place * pitch_m), _STEP.edge * pitch_m.min() / scenario.contact.reach_m])
    there, back = (
        np.stack([pressures(scenario, layout, [pad], t_s, shift)[:, own] for shift in np.diag(way)], axis=-1)
        for way in (steps, -steps)
    )
    by_pose = (there - back) / (2 * steps)
    step_pa = sensing.full_scale_pa / (2**sensing.bits - 1)
    weight = np.full(pressure.shape, 1 / np.hypot(sensing.noise_pa, step_pa / np.sqrt(12)))
    weight[:, np.isin(taxels, sensing.dead)] = 0.0
    weight[pressure + np.mean(sensing.baseline_pa) >= sensing.full_scale_pa] = 0.0
    nuisance, _ = np.linalg.qr(weight[..., np.newaxis] * np.stack([pressure, np.ones_like(pressure)], axis=-1))
    by_pose = weight[..., np.newaxis] * by_pose
    by_pose -= nuisance @ (np.swapaxes(nuisance, 1, 2) @ by_pose)
    late = delays(sensing, layout.taxels)[own] if sensing.scan_share else np.zeros(1)
    when = t_s[:, np.newaxis] + late
    path = move(scenario.motion, when, scenario.seed, scenario.contact.reach_m)
    gain = state_at(scenario.load, scenario.motion, when, np.zeros_like(when)).force
    lever = np.stack([layout.x_m[own], layout.y_m[own]], axis=-1) - path.pose[..., :2]
    points = (rotation(-path.pose[..., 2]) @ lever[..., np.newaxis])[..., 0]
    return Model(pressure, by_pose, nuisance, points, weight, np.broadcast_to(gain, pressure.shape))


def _jointly(
    model: Model, pose: Floats, known: Floats, contact: NDArray[np.int64], knot_m: float
) -> tuple[Floats, Floats]:
    """Standard deviations of one contact with the pattern unknown: (scans, axes) of its poses, and (scans - 1, axes) of
    its motions since the first scan. known: those with the pattern known.
    """
    scans, axes = len(contact), known.shape[1]
    scale = known[contact]
    by_pose = model.by_pose[contact][..., :axes] * scale[:, np.newaxis]  # poses in units of their known bound
    pattern = _pattern(model, contact, knot_m)
    by_nuisance = (_blocks(model.nuisance[contact]).T @ pattern).toarray()
    among = (pattern.T @ pattern).toarray() - by_nuisance.T @ by_nuisance
    factor, _ = cho_factor(among + np.eye(len(among)) / _FREE**2, lower=True)
    crossed = solve_triangular(factor, (pattern.T @ _blocks(by_pose)).toarray(), lower=True)
    information = _blocks(np.swapaxes(by_pose, 1, 2) @ by_pose).toarray() - crossed.T @ crossed
    gauge = _gauge(pose[contact, 2], scale)
    # The common motion of all poses has hardly any information.
    whole = cho_factor(information + ROUNDING * np.eye(scans * axes), lower=True)
    covariance = cho_solve(whole, np.eye(scans * axes))
    variance = _without(gauge, (scale / _spread(scale)).reshape(-1, 1) ** 2, covariance)
    deviation: Floats = np.sqrt(variance).reshape(scans, axes) * scale
    blocks = covariance.reshape(scans, axes, scans, axes).swapaxes(1, 2)
    own = blocks[np.arange(scans), np.arange(scans)] * scale[:, :, np.newaxis] * scale[:, np.newaxis]
    with_first = blocks[:, 0] * scale[:, :, np.newaxis] * scale[0]
    return deviation, _since(pose[contact, 2], own, with_first)


def _without(gauge: Floats, weight: Floats, covariance: Floats) -> Floats:
    """Variances (n,) of what is left of errors after the best combination of gauge (n, axes) was taken off."""
    taken = gauge @ np.linalg.inv(gauge.T @ (weight * gauge))
    seen = covariance @ (weight * gauge)
    both = (weight * gauge).T @ seen
    left: Floats = np.diagonal(covariance) + np.sum(taken @ both * taken - 2 * taken * seen, axis=1)
    return left


def _gauge(theta: Floats, scale: Floats) -> Floats:
    """(scans * axes, axes): what a rigid motion of the pattern does to the poses, in units of scale (scans, axes)."""
    scans, axes = scale.shape
    gauge = np.zeros((scans, axes, axes))
    gauge[:, :2, :2] = rotation(theta)
    gauge[:, 2:, 2:] = 1.0
    return np.asarray((gauge / scale[..., np.newaxis]).reshape(-1, axes), dtype=np.float64)


def _spread(scale: Floats) -> Floats:
    """(scans, axes): one deviation for both axes of position, since a gauge turns one into the other."""
    spread = scale.copy()
    spread[:, :2] = np.hypot(scale[:, 0], scale[:, 1])[:, np.newaxis]
    return spread


def _pattern(model: Model, contact: NDArray[np.int64], knot_m: float) -> csr_array[np.float64]:
    """Readings by coefficients (scans * taxels, coefficients), sparse, coefficients over the largest pressure."""
    points, pressure = model.points[contact].reshape(-1, 2), model.pressure[contact].reshape(-1)
    most = pressure.max()
    pressed = pressure > _PRESSED * most
    low, high = points[pressed].min(axis=0) - knot_m, points[pressed].max(axis=0) + knot_m
    counts = np.ceil((high - low) / knot_m).astype(int)
    knots = tuple(edge + knot_m * np.arange(-3, count + 4) for edge, count in zip(low, counts, strict=True))
    near = np.flatnonzero(((points >= low) & (points <= low + counts * knot_m)).all(axis=1))
    basis = NdBSpline.design_matrix(points[near], knots, 3)
    touched = np.flatnonzero(np.asarray(abs(basis[pressed[near]]).sum(axis=0)).ravel() > 0)
    factor = most * (model.gain[contact] * model.weight[contact]).reshape(-1)[near]
    rows = csr_array((factor, (near, np.arange(len(near)))), shape=(len(points), len(near)))
    return rows @ csr_array(basis)[:, touched]


def _blocks(parts: Floats) -> csr_array[np.float64]:
    """(n, rows, columns) as a sparse block-diagonal matrix."""
    n, rows, columns = parts.shape
    return bsr_array((parts, np.arange(n), np.arange(n + 1)), shape=(n * rows, n * columns)).tocsr()
