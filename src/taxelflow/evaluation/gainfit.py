"""The gains of one pad from the positions of a method and those of a robot.

Model, for scan k and axis a of the pad:  m_ka = p_ka / g_a + error,  p_k = R(phi) q(t_k + offset) + s,  with m the
method's position at gain 1, q the robot's trajectory, (s, phi) the pose of the robot's frame in the pad's and offset
the robot's clock less the sensor's. The truth is smoothed, then taken as exact, so the gain divides it: on the noisy
side it would come out too small. Robust least squares (soft L1); standard errors from the Jacobian there, with

- the scatter that noise does not explain (sampling by taxels), from the scans furthest from the edge's reach;
- the correlation of consecutive residuals: one centroid is part of two indices, and sampling errors last;
- for the gains, what residuals have in common at one place: no further pass averages it out.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from taxelflow.errors import GainsUnknown
from taxelflow.evaluation.gain_errors import by_place, inflation
from taxelflow.evaluation.robot_path import RobotPath, robot_path
from taxelflow.numerics.geometry import rotation, transform

if TYPE_CHECKING:
    from taxelflow.acquire.trajectory import Trajectory
    from taxelflow.messages import Bools, Floats


@dataclass(frozen=True, slots=True)
class _Search:
    """Limits of the fit of the gains."""

    fewest: int = 8
    starts: int = 4
    flat: float = 0.15
    """A path whose width is below this share of its length is a line, which determines one gain, not two."""
    unsure: float = 0.1
    """A gain with a larger relative standard deviation is called not observed."""
    fine: int = 400
    largest_gain: float = 20.0
    """And its inverse the smallest: beyond, lengths are in another unit."""


_SEARCH = _Search()


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """Positions of the object by a method at gain 1, in the pad's frame.

    t_s: (scans,), times that the positions refer to, sensor's clock. place_m: (scans, 2). noise_m, edge_m: (scans, 2),
    standard deviations by the taxels' noise and by the pad's edge.
    """

    t_s: Floats
    place_m: Floats
    noise_m: Floats
    edge_m: Floats

    def __len__(self) -> int:
        return len(self.t_s)

    def chosen(self, which: Bools) -> Sightings:
        """Some of them."""
        return Sightings(self.t_s[which], self.place_m[which], self.noise_m[which], self.edge_m[which])


@dataclass(frozen=True, slots=True, eq=False)
class GainFit:
    """gain, std: (2,) along x, y, std NaN where not observed. T_pad_robot, std_frame: (3,). Times in s.

    residual_m: (scans used, 2), in index positions. cost: of the least squares. used: (scans,), scans within the
    trajectory. note: what to know.
    """

    gain: Floats
    std: Floats
    T_pad_robot: Floats
    std_frame: Floats
    offset_s: float
    std_offset_s: float
    residual_m: Floats
    cost: float
    used: Bools = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    note: str = ""


def fit_gains(seen: Sightings, truth: Trajectory, pitch_m: Floats, search_s: float) -> GainFit:
    """Gains, frames and time offset (within +-search_s). Raises GainsUnknown."""
    path = robot_path(truth, float(np.median(np.diff(seen.t_s))) if len(seen) > 1 else 0.0)
    offset = _coarse_offset(seen, path, search_s)
    used = _covered(seen, path, offset)
    if used.sum() < _SEARCH.fewest:
        raise GainsUnknown(
            f"only {used.sum()} scans have a position within the trajectory's times",
            f"give at least {_SEARCH.fewest}, and check that both clocks agree within the search (now {search_s:g} s)",
        )
    problem = _Problem(seen.chosen(used), path, pitch_m, search_s, path.doubt(seen.t_s[used] + offset))
    length, width = problem.spread(offset)
    _check_length(length, float(np.hypot(*problem.places_std())), float(pitch_m.max()))
    plane = width > _SEARCH.flat * length
    if plane:
        problem.refuse_mirror(offset)
    fit = problem.refined(offset, tied=not plane)
    note = "" if plane else "the path is a line: one gain for both axes"
    if plane and (fit.std > _SEARCH.unsure * fit.gain).any():
        lost = int(np.argmax(fit.std / fit.gain))
        fit = problem.refined(offset, tied=True)
        fit.std[lost] = np.nan
        note = f"the gain along {'xy'[lost]} is not observed: that of the other axis"
    elif not plane:
        moved = problem.along(fit)
        fit.std[moved < _SEARCH.flat * moved.max()] = np.nan
    if not (fit.std < 3 * _SEARCH.unsure * fit.gain).any():
        raise GainsUnknown(_words(fit), "let the object move further, away from the pad's border")
    if fit.std_offset_s > search_s / 2 > 0:
        note += ("; " if note else "") + "the time offset is not observed: let the object go to and fro"
    return replace(fit, used=used, note=note)


def _check_length(trajectory_m: float, seen_m: float, pitch_m: float) -> None:
    """Refuse a trajectory that is far longer than what the pad has seen, or shorter than a taxel; standard deviations.

    Raises GainsUnknown.
    """
    if trajectory_m > _SEARCH.largest_gain * max(seen_m, 0.1 * pitch_m):
        lengths = f"the trajectory spans {trajectory_m:.3g} m, the positions on the pad {seen_m:.3g} m"
        remedy = "give the trajectory in m, and check that it is that of the object on this pad"
        raise GainsUnknown(f"{lengths} (standard deviations)", remedy)
    if trajectory_m < 0.3 * pitch_m:
        seen_mm = f"the object's path spans only {1e3 * trajectory_m:.2g} mm within the pad's interior"
        raise GainsUnknown(seen_mm, "move it over at least two taxels, away from the border")


def _words(fit: GainFit) -> str:
    """The gains along both axes, as far as they are observed."""
    return ", ".join(
        f"the gain along {axis} " + (f"would be {gain:.3g} ± {std:.2g}" if np.isfinite(std) else "is not observed")
        for axis, gain, std in zip("xy", fit.gain.tolist(), fit.std.tolist(), strict=True)
    )


class _Problem:
    """Least squares over (gain_x, gain_y, phi, s_x, s_y, offset), lengths in units of 1 cm to be of one size."""

    def __init__(self, seen: Sightings, path: RobotPath, pitch_m: Floats, search_s: float, model_m: Floats) -> None:
        self._seen, self._path, self._model_m = seen, path, model_m
        self._pitch_m, self._search_s = pitch_m, search_s
        self._deviation = np.sqrt(seen.noise_m**2 + seen.edge_m**2 + model_m**2)

    def _robot(self, offset: float) -> Floats:
        return self._path.at(self._seen.t_s + offset)

    def spread(self, offset: float) -> tuple[float, float]:
        """Length and width of the robot's way, weighted by how well the scans see it: standard deviations, m."""
        q = self._robot(offset)
        weight = 1.0 / np.min(self._deviation, axis=1) ** 2
        apart = q - np.average(q, axis=0, weights=weight)
        moments = np.linalg.eigvalsh(apart.T @ (weight[:, np.newaxis] * apart) / weight.sum())
        width, length = np.sqrt(np.clip(moments, 0.0, None))
        return float(length), float(width)

    def places_std(self) -> Floats:
        """(2,) standard deviations of the positions seen, m."""
        spread: Floats = self._seen.place_m.std(axis=0)
        return spread

    def along(self, fit: GainFit) -> Floats:
        """(2,) standard deviations of the way along the pad's axes."""
        spread: Floats = transform(fit.T_pad_robot, self._robot(fit.offset_s)).std(axis=0)
        return spread

    def refuse_mirror(self, offset: float) -> None:
        """A trajectory seen from within the skin is a mirror image, which no rotation undoes."""
        ways = self._affine(offset)
        if np.linalg.det(ways) < -0.3 * np.abs(ways).max() ** 2:
            raise GainsUnknown(
                "the trajectory is the mirror image of what the pad sees", "give it as seen from outside the skin"
            )

    def _affine(self, offset: float) -> Floats:
        """(2, 2), how the positions seen follow the robot's."""
        q = np.column_stack([self._robot(offset), np.ones(len(self._seen))])
        rows = [
            np.linalg.lstsq(q / d[:, np.newaxis], m / d, rcond=None)[0][:2]
            for m, d in zip(self._seen.place_m.T, self._deviation.T, strict=True)
        ]
        return np.array(rows)

    def refined(self, offset: float, *, tied: bool) -> GainFit:
        """Twice: the first fit shows how much scatter there is besides noise."""
        first = self._best(offset, tied)
        clean = _clean(self._seen.edge_m)
        # Scatter beyond the taxels' noise, seen where the edge cannot do much.
        beyond = [
            max(0.0, float(np.mean(r[c] ** 2 - n[c] ** 2)))
            for r, c, n in zip(first.residual_m.T, clean.T, self._seen.noise_m.T, strict=True)
        ]
        doubt_m = np.hypot(self._model_m, np.sqrt(beyond))
        again = _Problem(self._seen, self._path, self._pitch_m, self._search_s, doubt_m)
        fit = again._best(first.offset_s, tied)
        return replace(fit, std=np.hypot(fit.std, self._sampling_std(fit, clean, tied)))

    def _sampling_std(self, fit: GainFit, clean: Bools, tied: bool) -> Floats:
        """(2,) of the gains, by errors that belong to a place between taxels: all passes have them alike, so that only
        the taxels on the way average them out, not the scans.
        """
        std, spread = np.zeros(2), np.zeros(2)
        for axis, (left, pitch_m) in enumerate(zip(fit.residual_m.T, self._pitch_m.tolist(), strict=True)):
            place = self._seen.place_m[:, axis] - left
            spread[axis] = max(float(place.std()), 1e-3 * pitch_m)
            taxels = len(np.unique(np.floor(place / pitch_m)))
            std[axis] = fit.gain[axis] * by_place(left, place / pitch_m, clean[:, axis]) / spread[axis] / taxels**0.5
        known = spread**2 * np.mean(self._deviation**-2.0, axis=0)
        return np.full(2, np.hypot(*(known * std)) / known.sum()) if tied else std

    def _best(self, offset: float, tied: bool) -> GainFit:
        """From several first angles, since the angle makes the problem many-valleyed."""
        starts = np.arange(_SEARCH.starts) * 2 * np.pi / _SEARCH.starts
        return min((self._solve(phi, offset, tied) for phi in starts), key=lambda fit: fit.cost)

    def _solve(self, phi: float, offset: float, tied: bool) -> GainFit:
        s = (self._seen.place_m.mean(axis=0) - rotation(phi) @ self._robot(offset).mean(axis=0)) / 0.01
        gains = 1 if tied else 2
        limit = max(self._search_s, 1e-9)
        start = np.array([*np.ones(gains), phi, *s, np.clip(offset, -0.999 * limit, 0.999 * limit)])
        free = np.full(len(start), np.inf)
        lower, upper = -free, free.copy()
        lower[:gains], upper[:gains] = 1.0 / _SEARCH.largest_gain, _SEARCH.largest_gain
        lower[-1], upper[-1] = -limit, limit
        for loss in ("linear", "soft_l1"):  # from afar, robust steps end before the valley of angle and offset does
            found = least_squares(
                self._residuals, start, bounds=(lower, upper), loss=loss, args=(limit,), x_scale="jac", max_nfev=100
            )
            start = found.x
        jacobian = np.asarray(found.jac, dtype=np.float64)
        normal = jacobian.T @ jacobian
        residual = self._left(found.x)
        whitened = residual / self._deviation
        covariance = np.linalg.pinv(normal, hermitian=True) * inflation(whitened)
        std = np.sqrt(np.diag(covariance))
        std[gains + 1 : gains + 3] *= 0.01
        gain, gain_std = (np.array(np.broadcast_to(part[:gains], 2)) for part in (found.x, std))
        x, y = 0.01 * found.x[gains + 1 : gains + 3]
        turn = float(np.arctan2(np.sin(found.x[gains]), np.cos(found.x[gains])))
        pose = np.array([x, y, turn])
        std_pose = np.array([*std[gains + 1 : gains + 3], std[gains]])
        return GainFit(gain, gain_std, pose, std_pose, float(found.x[-1]), float(std[-1]), residual, float(found.cost))

    def _left(self, x: Floats) -> Floats:
        """(scans, 2) what the model leaves of the positions seen, m."""
        gain, phi, s, offset = x[:-4], x[-4], x[-3:-1], x[-1]
        p = transform(np.array([*(0.01 * s), phi]), self._robot(float(offset)))
        left: Floats = self._seen.place_m - p / gain
        return left

    def _residuals(self, x: Floats, limit: float) -> Floats:
        """All in standard deviations; the last holds the offset within the search."""
        return np.append((self._left(x) / self._deviation).ravel(), x[-1] / limit)


def _covered(seen: Sightings, path: RobotPath, offset: float) -> Bools:
    when = seen.t_s + offset
    inside: Bools = (when >= path.t_s[0]) & (when <= path.t_s[-1])
    return inside


def _coarse_offset(seen: Sightings, path: RobotPath, search_s: float) -> float:
    """The offset of the best affine map between the two ways, by trial."""
    if search_s <= 0 or len(seen) < _SEARCH.fewest:
        return 0.0
    step = max(float(np.median(np.diff(seen.t_s))) / 2, 2 * search_s / _SEARCH.fine)
    trials = step * np.arange(-int(search_s / step), int(search_s / step) + 1)
    costs = [_affine_cost(seen, path, trial) for trial in trials.tolist()]
    return float(trials[int(np.argmin(costs))]) if np.isfinite(costs).any() else 0.0


def _affine_cost(seen: Sightings, path: RobotPath, offset: float) -> float:
    """Mean squared residual per scan of the best affine map, in standard deviations."""
    used = _covered(seen, path, offset)
    if used.sum() < max(_SEARCH.fewest, len(seen) // 4):
        return float("inf")
    part = seen.chosen(used)
    q = np.column_stack([path.at(part.t_s + offset), np.ones(len(part))])
    total = 0.0
    for m, noise, edge in zip(part.place_m.T, part.noise_m.T, part.edge_m.T, strict=True):
        weight = 1.0 / np.sqrt(noise**2 + edge**2)
        left = (m - q @ np.linalg.lstsq(q * weight[:, np.newaxis], m * weight, rcond=None)[0]) * weight
        total += float(np.mean(left**2))
    return total


def _clean(edge_m: Floats) -> Bools:
    """(scans, 2), per axis the quarter of the scans (at least 8) that the edge can do least to."""
    share = max(0.25, _SEARCH.fewest / len(edge_m))
    clean: Bools = edge_m <= np.quantile(edge_m, share, axis=0)
    return clean
