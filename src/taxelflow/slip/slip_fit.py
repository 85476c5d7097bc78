"""Motion of a whole slip: weighted least squares of its poses over time, by a path of straight segments.

Between the slip's dates the pose is a continuous, piecewise linear function of time (a linear spline). Each scan has
the inverse of its pose's covariance as weight. Most slips are one segment of constant velocity. A knot is added where
it lowers the Bayesian information criterion (Schwarz, Ann. Stat. 6, 1978): where the object turns round or changes its
speed. The residuals scale the covariance: by their chi-square, and by their autocorrelation, which lowers the number of
independent scans (Bayley & Hammersley, J. R. Stat. Soc. Suppl. 8, 1946).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, nan, sin, sqrt

import numpy as np

from taxelflow.messages import Floats
from taxelflow.slip.measurement import MIN_STD_M, MIN_STD_RAD, UNOBSERVABLE_M, UNOBSERVABLE_RATIO
from taxelflow.slip.slip_knots import knots_of

_NORMAL = "ni,nj,nab->iajb"
"""Normal equations of a linear spline (scans, knots) of several coordinates with weights (scans, axes, axes)."""
_MAX_CORRELATION = 0.95
"""Upper limit of the estimated autocorrelation, against division by 0."""


@dataclass(frozen=True, slots=True)
class SlipMotion:
    """Motion of one slip in the pad's frame; NaN where unknown.

    path_m: length of the path. direction_rad: of the net displacement. turn_rad: net rotation. duration_s: between the
    slip's dates. speed_m_s: path over duration. std_*: standard deviations.
    """

    path_m: float = nan
    speed_m_s: float = nan
    direction_rad: float = nan
    turn_rad: float = nan
    duration_s: float = nan
    std_path_m: float = nan
    std_speed_m_s: float = nan
    std_turn_rad: float = nan
    std_duration_s: float = nan


def fit_slip(t: Floats, pose: Floats, covariance: Floats, start_s: float, end_s: float) -> SlipMotion:
    """Motion between two dates, s, from at least three poses in between.

    t: (scans,), increasing. pose: (scans, 3), x and y known. covariance: (scans, 3, 3). Raises
    numpy.linalg.LinAlgError for covariances that are not positive definite, or unknown along x and y.
    """
    axes = _observable_axes(pose, covariance)
    if not axes or axes[0] == 2:
        raise np.linalg.LinAlgError("no position with a covariance")
    weight = _information(covariance, axes)
    moved = pose[:, axes] - pose[0, axes]
    knots = knots_of(t, moved, weight, start_s, end_s)
    basis = _hat_functions(t, knots)
    coefficients, inverse, chi_square = _solve(basis, moved, weight)
    scale = _scale(moved - basis @ coefficients, weight, chi_square, coefficients.size)
    return _motion(knots, coefficients, scale * inverse, weight, axes)


def integrate_slip(displacement: Floats, covariance: Floats, start_s: float, end_s: float) -> SlipMotion:
    """Motion between two dates, s, as the sum of displacements (scans, 3) with covariances (scans, 3, 3).

    For slips of one or two scans, and for methods without a pose.
    """
    duration_s = end_s - start_s
    known = np.isfinite(displacement[:, 0])
    steps, own = displacement[known], covariance[known]
    scan_s = duration_s / max(len(displacement), 1)
    std_duration_s = scan_s / sqrt(6.0)  # each date is uniform within a scan
    if not known.any() or duration_s <= 0.0:
        return SlipMotion(duration_s=max(duration_s, 0.0), std_duration_s=std_duration_s)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    path_m, net = float(lengths.sum()), steps.sum(axis=0)
    direction_rad = atan2(net[1], net[0])
    along = np.array([cos(direction_rad), sin(direction_rad)])
    std_m = sqrt(float(along @ own[:, :2, :2].sum(axis=0) @ along))
    turns = bool(np.isfinite(steps[:, 2]).all())
    return SlipMotion(
        path_m,
        path_m / duration_s,
        direction_rad,
        float(net[2]) if turns else nan,
        duration_s,
        std_m,
        float(np.hypot(std_m, path_m / duration_s * std_duration_s)) / duration_s,
        sqrt(float(own[:, 2, 2].sum())) if turns else nan,
        std_duration_s,
    )


def _observable_axes(pose: Floats, covariance: Floats) -> list[int]:
    """Coordinates that are known in all scans and observable."""
    variance = np.median(np.diagonal(covariance, axis1=1, axis2=2), axis=0)
    most = max(UNOBSERVABLE_RATIO**2 * float(np.min(variance[:2])), UNOBSERVABLE_M**2)
    known = np.isfinite(pose).all(axis=0) & np.isfinite(variance)
    known[:2] &= ~(variance[:2] > most)
    return np.flatnonzero(known).tolist()


def _information(covariance: Floats, axes: list[int]) -> Floats:
    """(scans, axes, axes), inverse of the covariances with a lower limit of their variances."""
    own = covariance[:, axes][:, :, axes]
    least = np.array([MIN_STD_M, MIN_STD_M, MIN_STD_RAD])[axes] ** 2
    inverse: Floats = np.linalg.inv(own + np.diag(least)).astype(np.float64)
    return inverse


def _hat_functions(t: Floats, knots: Floats) -> Floats:
    """(scans, knots), linear interpolation between knots."""
    return np.stack([np.interp(t, knots, unit) for unit in np.eye(len(knots))], axis=1)


def _solve(basis: Floats, moved: Floats, weight: Floats) -> tuple[Floats, Floats, float]:
    """Positions at the knots (knots, axes), their covariance (knots * axes, knots * axes), and chi-square."""
    knots, axes = basis.shape[1], moved.shape[1]
    weighted = np.einsum("nab,nb->na", weight, moved)
    terms = (_NORMAL, basis, basis, weight)
    path, _ = np.einsum_path(*terms, optimize="greedy")  # found here, einsum takes half the time
    normal = np.einsum(*terms, optimize=path).reshape(knots * axes, knots * axes)
    right = (basis.T @ weighted).reshape(-1)
    inverse = np.linalg.inv(normal)
    solution = inverse @ right
    return solution.reshape(knots, axes), inverse, float(np.sum(weighted * moved) - right @ solution)


def _scale(residual: Floats, weight: Floats, chi_square: float, parameters: int) -> float:
    """Factor on the covariance, at least 1, by the residuals (scans, axes) and their autocorrelation."""
    freedom = residual.size - parameters
    if freedom <= 0:
        return 1.0
    scale = max(chi_square / freedom, 1.0)
    white = np.einsum("nab,nb->na", np.linalg.cholesky(weight).transpose(0, 2, 1), residual)
    square = float(np.sum(white**2))
    correlation = float(np.sum(white[1:] * white[:-1])) / square if square > 0 else 0.0
    correlation = min(max(correlation, 0.0), _MAX_CORRELATION)
    return scale * (1.0 + correlation) / (1.0 - correlation)


def _motion(knots: Floats, position: Floats, covariance: Floats, weight: Floats, axes: list[int]) -> SlipMotion:
    """Length, speed and turn of a path with positions (knots, axes) at its knots."""
    duration_s = float(knots[-1] - knots[0])
    steps = np.diff(position, axis=0)
    plane = [place for place, axis in enumerate(axes) if axis < 2]
    lengths = np.sqrt(np.sum(steps[:, plane] ** 2, axis=1))
    path_m = float(lengths.sum())
    along = np.zeros_like(steps)
    along[:, plane] = steps[:, plane] / np.maximum(lengths, MIN_STD_M)[:, np.newaxis]
    gradient = np.zeros_like(position)
    gradient[1:] += along
    gradient[:-1] -= along
    variance = float(gradient.reshape(-1) @ covariance @ gradient.reshape(-1))
    rates = steps / np.diff(knots)[:, np.newaxis]
    scan_s = duration_s / len(weight)
    dates = [_date_variance(rates[end], weight[end], scan_s, duration_s) for end in (0, -1)]
    ends = (np.hypot(*rates[end][plane]) if len(plane) > 1 else abs(rates[end][plane[0]]) for end in (0, -1))
    variance_dates = sum(float(speed) ** 2 * own for speed, own in zip(ends, dates, strict=True))
    net = dict(zip(axes, position[-1] - position[0], strict=True))
    turn_rad = std_turn_rad = nan
    if 2 in net:
        turns = np.zeros_like(position)
        turns[-1, -1], turns[0, -1] = 1.0, -1.0
        turn_rad = float(net[2])
        std_turn_rad = sqrt(float(turns.reshape(-1) @ covariance @ turns.reshape(-1)))
    return SlipMotion(
        path_m,
        path_m / duration_s,
        atan2(net.get(1, 0.0), net.get(0, 0.0)),
        turn_rad,
        duration_s,
        sqrt(variance + variance_dates),
        sqrt(variance) / duration_s,
        std_turn_rad,
        sqrt(sum(dates)),
    )


def _date_variance(rate: Floats, weight: Floats, scan_s: float, duration_s: float) -> float:
    """Variance of a date, s^2: uniform within a scan, and the pose's noise over its rate (axes,)."""
    noise = 1.0 / max(float(rate @ weight @ rate), duration_s**-2)
    return scan_s**2 / 12.0 + noise
