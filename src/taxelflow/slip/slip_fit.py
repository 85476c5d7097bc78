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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from taxelflow.messages import Floats
from taxelflow.numerics.records import Records, Vector, records
from taxelflow.numerics.rounding import BLIND_M
from taxelflow.numerics.small_linalg import factor_small, solve_factored
from taxelflow.runtime.compiling import kernel, routine
from taxelflow.runtime.settled import Settled
from taxelflow.slip.measurement import LEAST_STD, UNOBSERVABLE_RATIO
from taxelflow.slip.slip_knots import Knot, Spline, Sums, add_up, backward, forward, place_knots

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


class Path:
    """Of one fit. net: of x, y and theta. dates_s2, dates_m2: variances of both dates together, and of the length by
    them; variance_m2: of the length by the noise. turn_variance: by both.
    """

    duration_s: float
    length_m: float
    variance_m2: float
    net: Vector
    turn_variance: float
    dates_s2: float
    dates_m2: float


class Held(NamedTuple):
    """Scans of a slip: t (scans,), s since its begin; pose (scans, 3); covariance (scans, 3, 3); the axes that are
    observable. Then room: moved (scans, axes), weight (scans, axes, axes), root (axes, axes), and sums, which come in
    as 0.
    """

    t: Floats
    pose: Floats
    covariance: Floats
    axes: NDArray[np.int64]
    moved: Floats
    weight: Floats
    root: Floats
    sums: Sums


def fit_slip(t: Floats, pose: Floats, covariance: Floats, start_s: float, end_s: float) -> SlipMotion:
    """Motion between two dates, s, from at least three poses in between.

    t: (scans,), increasing. pose: (scans, 3), x and y known. covariance: (scans, 3, 3). Raises
    numpy.linalg.LinAlgError for covariances that are not positive definite, or unknown along x and y, and for dates
    that are not one after the other.
    """
    axes = _observable_axes(pose, covariance)
    if not axes or axes[0] == 2:
        raise np.linalg.LinAlgError("no position with a covariance")
    rows = records(Path, 1)
    duration_s = end_s - start_s
    scanned = _room_for(t - start_s, pose, covariance, axes)
    if not duration_s > 0 or not _fit(scanned, duration_s, records(Spline, 1), rows):
        raise np.linalg.LinAlgError("covariances are not positive definite")
    _, length_m, variance_m2, net, turn_variance, dates_s2, dates_m2 = rows[0].tolist()
    turns = axes[-1] == 2
    return SlipMotion(
        length_m,
        length_m / duration_s,
        atan2(net[1], net[0]),
        float(net[2]) if turns else nan,
        duration_s,
        sqrt(variance_m2 + dates_m2),
        sqrt(variance_m2) / duration_s,
        sqrt(turn_variance) if turns else nan,
        sqrt(dates_s2),
    )


def integrate_slip(displacement: Floats, covariance: Floats, start_s: float, end_s: float, scan_s: float) -> SlipMotion:
    """Motion between two dates, s, as the sum of displacements (scans, 3) with covariances (scans, 3, 3).

    For slips of one or two scans, and for methods without a pose. scan_s: between scans. Dates that are closer do
    not determine the time that a displacement took: its speed is the mean over its scan.
    """
    duration_s = max(end_s - start_s, scan_s)
    known = np.isfinite(displacement[:, 0])
    steps, own = displacement[known], covariance[known]
    std_duration_s = scan_s / sqrt(6.0)  # each date is uniform within a scan
    if not known.any():
        return SlipMotion(duration_s=duration_s, std_duration_s=std_duration_s)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    path_m, net = float(lengths.sum()), steps.sum(axis=0)
    direction_rad = atan2(net[1], net[0])
    along = np.array([cos(direction_rad), sin(direction_rad)])
    std_m = sqrt(max(float(along @ own[:, :2, :2].sum(axis=0) @ along), 0.0))  # rounding may leave less of certain axes
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
    variance = _median(np.diagonal(covariance, axis1=1, axis2=2))
    most = max(UNOBSERVABLE_RATIO**2 * float(np.min(variance[:2])), BLIND_M**2)
    known = np.isfinite(pose).all(axis=0) & np.isfinite(variance)
    known[:2] &= ~(variance[:2] > most)
    return np.flatnonzero(known).tolist()


def _median(values: Floats) -> Floats:
    """(columns,), of values (rows, columns), NaN where one is; `np.median` takes five times as long."""
    ordered = np.sort(values, axis=0)
    middle: Floats = 0.5 * (ordered[(len(values) - 1) // 2] + ordered[len(values) // 2])
    middle[np.isnan(ordered[-1])] = np.nan
    return middle


def _room_for(t: Floats, pose: Floats, covariance: Floats, axes: list[int]) -> Held:
    """Scans, and room for what is computed from them: a kernel that makes no array is compiled sooner."""
    scans, count = len(t), len(axes)
    moved, weight, root = np.empty((scans, count)), np.empty((scans, count, count)), np.empty((count, count))
    sums = Sums(np.zeros((3, scans + 1, count, count)), np.zeros((2, scans + 1, count)))
    return Held(t, pose, covariance, np.array(axes), moved, weight, root, sums)


@kernel
def fit_path(scanned: Held, duration_s: float, splines: Records, paths: Records) -> bool:
    """Fill paths (1,) of `Path`; False if a covariance is not positive definite. splines: (1,) of `Spline`, all 0."""
    path: Path = paths[0]
    spline: Spline = splines[0]
    path.duration_s = duration_s
    t, axes, moved, weight, root = scanned.t, scanned.axes, scanned.moved, scanned.weight, scanned.root
    scans, count = moved.shape
    for n in range(scans):
        for a in range(count):
            moved[n, a] = scanned.pose[n, axes[a]] - scanned.pose[0, axes[a]]
        if not _invert(scanned.covariance[n], axes, weight[n], root):
            return False
    add_up(t, moved, weight, scanned.sums, spline)
    end: Knot = spline.knots[1]
    end.t_s, end.scan = duration_s, scans
    held, chi_square = place_knots(t, scanned.sums, scans * count, spline)
    if chi_square == np.inf:
        return False
    for i in range(held * count):
        spline.position[i] = spline.right[i]
    backward(spline.band, spline.position, held * count, 2 * count)
    _measure(held, axes, spline, path)
    scale = _scale(scanned, held, chi_square, spline)
    path.variance_m2 *= scale
    path.turn_variance *= scale
    _date(0, axes, weight[0], duration_s / scans, spline, path)
    _date(held - 2, axes, weight[scans - 1], duration_s / scans, spline, path)
    return True


_fit = Settled(fit_path)


@routine
def _invert(covariance: Floats, axes: NDArray[np.int64], inverse: Floats, factor: Floats) -> bool:
    """Fill the inverse (axes, axes) of a covariance (3, 3) with a lower limit of its variances; factor: scratch."""
    count = len(axes)
    for a in range(count):
        least = LEAST_STD.m if axes[a] < 2 else LEAST_STD.rad
        for b in range(count):
            factor[a, b] = covariance[axes[a], axes[b]] + (least * least if a == b else 0.0)
    if not factor_small(factor, count):
        return False
    for a in range(count):
        for b in range(count):
            inverse[a, b] = 1.0 if a == b else 0.0
        solve_factored(factor, inverse[a], count)
    return True


@routine
def _measure(held: int, axes: NDArray[np.int64], spline: Spline, path: Path) -> None:
    """Length, net motion, and their variances for a scale of the noise of 1, of a path with a position at each knot."""
    count, gradient, position = len(axes), spline.right, spline.position
    for i in range(held * count):
        gradient[i] = 0.0
    for segment in range(held - 1):
        begin, end = segment * count, (segment + 1) * count
        square = 0.0
        for a in range(count):
            square += (position[end + a] - position[begin + a]) ** 2 if axes[a] < 2 else 0.0
        length_m = np.sqrt(square)
        path.length_m += length_m
        for a in range(count):
            if axes[a] < 2:
                along = (position[end + a] - position[begin + a]) / max(length_m, LEAST_STD.m)
                gradient[end + a] += along
                gradient[begin + a] -= along
    path.variance_m2 = forward(spline.band, gradient, held * count, 2 * count)
    last = (held - 1) * count
    for a in range(count):
        path.net[axes[a]] = position[last + a] - position[a]
    for i in range(held * count):
        gradient[i] = 0.0
    gradient[last + count - 1], gradient[count - 1] = 1.0, -1.0
    path.turn_variance = forward(spline.band, gradient, held * count, 2 * count)


@routine
def _scale(scanned: Held, held: int, chi_square: float, spline: Spline) -> float:
    """Factor on the covariance, at least 1, by the residuals (scans, axes) and their autocorrelation."""
    t, knots, position = scanned.t, spline.knots, spline.position
    root, white, before = scanned.root, spline.white, spline.before
    scans, count = scanned.moved.shape
    freedom = scans * count - held * count
    if freedom <= 0:
        return 1.0
    square = product = 0.0
    segment = 0
    for n in range(scans):
        while segment < held - 2 and n >= knots[segment + 1].scan:
            segment += 1
        share = (t[n] - knots[segment].t_s) / (knots[segment + 1].t_s - knots[segment].t_s)
        for a in range(count):
            low, high = position[segment * count + a], position[(segment + 1) * count + a]
            white[a] = scanned.moved[n, a] - low - share * (high - low)
        for ab in range(count * count):
            root[ab // count, ab % count] = scanned.weight[n, ab // count, ab % count]
        factor_small(root, count)
        for a in range(count):  # upwards: those after it are residuals still
            for b in range(a + 1, count):
                white[a] += root[b, a] * white[b]
            white[a] *= np.sqrt(root[a, a])
            square += white[a] * white[a]
            product += white[a] * before[a]
            before[a] = white[a]
    correlation = min(max(product / square if square > 0.0 else 0.0, 0.0), _MAX_CORRELATION)
    return float(max(chi_square / freedom, 1.0) * (1.0 + correlation) / (1.0 - correlation))


@routine
def _date(segment: int, axes: NDArray[np.int64], weight: Floats, scan_s: float, spline: Spline, path: Path) -> None:
    """Add the variance of a date: uniform within a scan, and the noise of its scan's pose over the segment's rate."""
    knots, position = spline.knots, spline.position
    count, span_s = len(axes), knots[segment + 1].t_s - knots[segment].t_s
    square = turned = information = 0.0
    for a in range(count):
        rate = (position[(segment + 1) * count + a] - position[segment * count + a]) / span_s
        square += rate * rate if axes[a] < 2 else 0.0
        turned += rate * rate if axes[a] == 2 else 0.0
        for b in range(count):
            other = (position[(segment + 1) * count + b] - position[segment * count + b]) / span_s
            information += rate * weight[a, b] * other
    variance_s2 = scan_s * scan_s / 12.0 + 1.0 / max(information, 1.0 / path.duration_s**2)
    path.dates_s2 += variance_s2
    path.dates_m2 += square * variance_s2
    path.turn_variance += turned * variance_s2
