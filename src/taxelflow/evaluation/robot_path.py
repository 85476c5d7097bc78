"""A robot's logged positions -> a smooth path, whose slope in time is that of the motion.

An offset between two clocks is found from the slope of the path. Straight lines between the samples have the slope of
the log's noise: 0.3 mm at 200 Hz makes it ten times that of a slow motion, and the offset would seem that certain.
Between the samples of a slow log they cut the corners, and gains come out too small. So positions are smoothed and
joined by cubics.

Smoothing is by the natural cubic spline of the least sum |y - f|^2 + penalty integral |f''|^2, with the penalty by
generalized cross-validation (Craven and Wahba 1979). A log without noise stays as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.interpolate import Akima1DInterpolator, CubicSpline, PPoly, make_smoothing_spline

if TYPE_CHECKING:
    from collections.abc import Callable

    from taxelflow.acquire.trajectory import Trajectory
    from taxelflow.messages import Floats


class _Smoothing(NamedTuple):
    """When a log is smoothed."""

    fewest: int = 12
    """Samples below which there is no smoothing."""
    most: float = 0.04
    """What smoothing takes away is at most this share of the path's variance: else it is the motion."""
    gap: float = 4.0
    """Median intervals from which a wait for the next sample is a gap."""
    closest: float = 0.1
    """Samples closer than this share of the median interval are averaged: between them noise is all slope."""
    per_scan: float = 4.0
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
    smooth = _smoothed(t, place)
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


def _smoothed(t: Floats, place: Floats) -> Floats:
    """(samples, 2), values of the smoothing spline at its samples."""
    if len(t) < _SMOOTHING.fewest:
        return place
    when, smooth = t / float(np.median(np.diff(t))), place.copy()
    for axis, own in enumerate(place.T):
        values = make_smoothing_spline(when, own)(when)
        if np.mean((values - own) ** 2) <= _SMOOTHING.most * np.var(own):
            smooth[:, axis] = values
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
