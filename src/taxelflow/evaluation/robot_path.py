"""A robot's logged positions -> a smooth path, whose slope in time is that of the motion.

An offset between two clocks is found from the slope of the path. Straight lines between the samples have the slope of
the log's noise: 0.3 mm at 200 Hz makes it ten times that of a slow motion, and the offset would seem that certain.
Between the samples of a slow log they cut the corners, and gains come out too small. So positions are smoothed and
joined by cubics.

Smoothing is the natural cubic spline of Reinsch (1967), the least of sum |y - f|^2 + penalty integral |f''|^2, with the
penalty by generalized cross-validation. A log without noise stays as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.interpolate import Akima1DInterpolator, CubicSpline, PPoly
from scipy.linalg import solveh_banded

if TYPE_CHECKING:
    from collections.abc import Callable

    from taxelflow.acquire.trajectory import Trajectory
    from taxelflow.messages import Floats


class _Smoothing(NamedTuple):
    """Widths that are tried, in median intervals of the log."""

    fewest: int = 12
    """Samples below which there is no smoothing."""
    widths: tuple[float, ...] = tuple(np.geomspace(0.25, 512.0, 23).tolist())
    gain: float = 0.99
    """A width is taken only if it lowers the squared error of prediction to this share."""
    most: float = 0.04
    """What smoothing takes away is at most this share of the path's variance: else it is the motion."""
    gap: float = 4.0
    """Median intervals from which a wait for the next sample is a gap."""
    closest: float = 0.1
    """Samples closer than this share of the median interval are averaged: between them noise is all slope."""
    per_scan: float = 8.0
    """And those closer than the scans' interval over this: a log of 1 kHz holds more than scans can use."""


_SMOOTHING = _Smoothing()


@dataclass(frozen=True, slots=True, eq=False)
class RobotPath:
    """Positions at any time within the log. t_s: (2,), its first and last time, robot's clock."""

    t_s: Floats
    _knots_s: Floats
    _knots_m: Floats
    _smooth: Callable[[Floats], Floats]

    def at(self, t_s: Floats) -> Floats:
        """(times, 2), m; before and after the log its ends."""
        places: Floats = self._smooth(np.clip(t_s, self._knots_s[0], self._knots_s[-1]))
        return places

    def doubt(self, t_s: Floats) -> Floats:
        """(times, 1), m along any axis: how far the path may be off between distant samples: cubics less lines."""
        apart = self.at(t_s) - _lines(self._knots_s, self._knots_m, t_s)
        doubt: Floats = np.sqrt(np.mean(apart**2, axis=1, keepdims=True))
        return doubt


def robot_path(truth: Trajectory, interval_s: float) -> RobotPath:
    """The smoothed path of a log, for scans at this interval."""
    t, place = _thinned(truth.t_s, truth.place_m, interval_s)
    smooth = _smoothed(t, place, _width_s(t, place))
    return RobotPath(truth.t_s[[0, -1]], t, smooth, _cubics(t, smooth))


def _thinned(t_s: Floats, place_m: Floats, interval_s: float) -> tuple[Floats, Floats]:
    """Samples that are too close together, averaged; the ends stay."""
    step = max(_SMOOTHING.closest * float(np.median(np.diff(t_s))), interval_s / _SMOOTHING.per_scan)
    bins = np.floor((t_s - t_s[0]) / step + 0.5)
    first = np.flatnonzero(np.diff(bins, prepend=-1.0))
    if len(first) == len(t_s) or len(first) < _SMOOTHING.fewest:
        return t_s, place_m
    count = np.diff(first, append=len(t_s))
    t, place = np.add.reduceat(t_s, first) / count, np.add.reduceat(place_m, first) / count[:, np.newaxis]
    return t, place


def _width_s(t: Floats, place: Floats) -> float:
    """The width of smoothing by generalized cross-validation (Craven and Wahba 1979), of evenly spaced samples."""
    if len(t) < _SMOOTHING.fewest:
        return 0.0
    unit = float(np.median(np.diff(t)))
    angle = (np.arange(256) + 0.5) * np.pi / 256
    stiff = 48.0 * np.sin(angle / 2) ** 4 / (2.0 + np.cos(angle))
    spread = _SMOOTHING.most * float(np.mean(np.var(place, axis=0)))
    least, best = np.inf, 0.0
    for width in _SMOOTHING.widths:
        left = float(np.mean((place - _smoothed(t, place, width * unit)) ** 2))
        if left > spread:
            break
        score = left / np.mean(1.0 - 1.0 / (1.0 + width**4 * stiff)) ** 2
        if score < _SMOOTHING.gain * least:
            least, best = float(score), width
    return best * unit if best > _SMOOTHING.widths[0] else 0.0


def _smoothed(t: Floats, place: Floats, width_s: float) -> Floats:
    """(samples, 2), values of the smoothing spline at its samples; its kernel is about this wide on each side."""
    if width_s <= 0:
        return place
    unit = float(np.median(np.diff(t)))
    penalty, h = (width_s / unit) ** 4, np.diff(t) / unit
    before, after = 1.0 / h[:-1], 1.0 / h[1:]  # the columns of Q, whose product with the positions is their bend
    middle = -before - after
    bands = np.zeros((3, len(t) - 2))
    bands[2] = (h[:-1] + h[1:]) / 3 + penalty * (before**2 + middle**2 + after**2)
    bands[1, 1:] = h[1:-1] / 6 + penalty * (middle[:-1] * before[1:] + after[:-1] * middle[1:])
    bands[0, 2:] = penalty * after[:-2] * before[2:]
    slope = np.diff(place, axis=0) / h[:, np.newaxis]
    bend = solveh_banded(bands, np.diff(slope, axis=0))
    jump = np.diff(np.pad(bend, ((1, 1), (0, 0))), axis=0) / h[:, np.newaxis]
    smooth: Floats = place - penalty * np.diff(np.pad(jump, ((1, 1), (0, 0))), axis=0)
    return smooth


def _cubics(t: Floats, place: Floats) -> Callable[[Floats], Floats]:
    """The natural cubic spline, in gaps the modified Akima cubics, which do not swing; lines between few samples."""
    if len(t) < _SMOOTHING.fewest:
        return lambda t_s: _lines(t, place, t_s)
    spline, calm = CubicSpline(t, place, bc_type="natural"), Akima1DInterpolator(t, place, method="makima")
    gap = np.diff(t) > _SMOOTHING.gap * np.median(np.diff(t))
    return PPoly(np.where(gap[:, np.newaxis], calm.c, spline.c), t)


def _lines(t: Floats, place: Floats, t_s: Floats) -> Floats:
    return np.stack([np.interp(t_s, t, axis) for axis in place.T], axis=1)
