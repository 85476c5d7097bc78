"""Noise of each taxel, estimated from the scans themselves by their likelihood, with the quantisation as a floor.

Two sources determine it: unloaded readings scatter about their level, also where half are clipped (`resting.py`);
a taxel that is loaded steadily differs from scan to scan: second differences within a window of 12 scans remove what
changes linearly. Motion only ever adds to a window's variance: it is the noise's, or larger by any factor.
Both give a likelihood of the noise for each taxel. Taxels of a pad are alike, and so are pads of a sensor: the levels
are estimated together (empirical Bayes on a tree), so that a taxel that has shown nothing has its pad's noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import gammainc, gammaln, logsumexp

from taxelflow.condition.converter import MIN_NOISE_SHARE, UNKNOWN_NOISE, floor_of, levels_of, range_of, step_of
from taxelflow.condition.resting import far_from_loads, rest_likelihood
from taxelflow.messages import Bools, Floats

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class _Levels:
    """Levels of noise before anything is seen."""

    ratio: float = 1.25
    """Ratio of neighbouring noise levels that are compared: the posterior's mean interpolates between them."""
    largest: float = 0.25
    """Largest noise that is considered, as a share of the range of the readings."""
    likely: float = 0.005
    likely_log_std: float = 1.5
    """Noise, as a share of the range, before anything is seen: within 0.02 and 10 % of it by two standard
    deviations."""
    alike_log_std: float = 0.25
    """Standard deviation of the logarithm of the noise among the taxels of a pad, and among pads."""
    strange: float = 1e-3
    """Share of taxels whose noise is not like the others': it may have any level."""


_LEVELS = _Levels()


@dataclass(frozen=True, slots=True)
class _Steady:
    """Windows in which a taxel is loaded steadily."""

    freedom: float = 0.514
    """Degrees of freedom of the mean square of second differences, a difference: 6^2 / (6^2 + 2 (4^2 + 1^2)) = 36 / 70,
    as neighbouring ones have covariances of -4 and 1 beside a variance of 6."""
    line_ratio: float = 2.5
    """In a steady window the variance about a line is at most this ratio to that by second differences; noise that is
    independent from scan to scan exceeds it in 3 % of the windows, a passing object hardly ever falls below."""
    differences: int = 8
    """Second differences that a window needs, if any window has as many."""
    clipped: float = 0.1
    """A window in which a taxel reads its lowest value, or saturates, in a larger share of scans shows clipping, not
    noise."""
    windows: int = 96
    """Windows of second differences, at most, evenly from the sample: with five degrees of freedom each, for 4 %."""


_STEADY = _Steady()
_SECOND_DIFFERENCE_VARIANCE = 1.0**2 + 2.0**2 + 1.0**2
"""Variance of a - 2 b + c over that of one reading."""
_QUIET_SHARES = np.array([0.05, 0.3, 0.9])
"""Shares of windows in which a taxel is loaded steadily: equally likely before anything is seen."""


@dataclass(frozen=True, slots=True)
class _Rest:
    """Readings of a taxel while it is unloaded."""

    clipped: float = 0.9
    """A taxel that is clipped in a larger share of its scans shows no noise while unloaded: what is left are light
    loads."""
    neumann_ratio: float = 0.5
    """Mean squared difference of neighbouring scans over that of any two, below which unloaded readings are light
    loads: independent ones fall below it in 2 % of 20 scans."""
    fewest: int = 4
    """Readings from which a taxel's level, share and noise are estimated: of fewer, some are close by chance."""
    scans: int = 96
    readings: int = 12_000
    """Scans and readings that are searched for unloaded ones, at most: for 1 % of a noise common to all."""


_REST = _Rest()


def estimate_noise(
    windows: Floats,
    masked: Bools,
    pads: NDArray[np.int64],
    near: NDArray[np.int64],
    *,
    step: float = 0.0,
    unknown: float = 0.0,
    ceiling: Floats | float = np.inf,
    lowest: Floats | None = None,
) -> Floats:
    """(windows, scans, taxels) of raw pressure, NaN where missing -> (taxels,) standard deviation; 0 where masked.

    pads: (taxels,), the pad of each. near: (taxels, most), see `near_taxels`. step: quantisation step of the sensor, if
    declared. unknown: the noise to assume while all readings are alike. ceiling: (taxels,), where readings saturate.
    lowest: (taxels,), where they are clipped below; at the lowest of all if left out.
    """
    noise = np.zeros(len(masked))
    live = _without_repeats(np.where(np.isfinite(windows) & ~masked, windows, np.nan))
    levels = levels_of(live)
    if not len(levels):
        return noise
    found_step, reach = step_of(levels) or _step_of_noise(live, levels), range_of(levels)
    floor = max(floor_of(found_step, reach), step / 12**0.5)
    if reach <= 0.0:
        noise[~masked] = floor if floor > UNKNOWN_NOISE else max(unknown, UNKNOWN_NOISE)
        return noise
    live[live >= np.broadcast_to(ceiling, masked.shape)] = np.inf  # loaded, by how much is not known
    grid = floor * _LEVELS.ratio ** np.arange(
        1 + max(1.0, np.log(_LEVELS.largest * reach / floor) / np.log(_LEVELS.ratio))
    )
    bottom = np.full(len(masked), levels[0]) if lowest is None else lowest
    cut = bottom + 0.5 * max(found_step, step) if lowest is None else lowest
    rest = _rest_likelihood(live, near, grid, cut, reach)
    steady, weight = _steady_likelihood(live, grid, bottom, pads)
    prior = -0.5 * (np.log(grid / (_LEVELS.likely * reach)) / _LEVELS.likely_log_std) ** 2
    found = _pooled(rest + steady, rest + weight * steady, pads, grid, prior)
    noise[~masked] = np.maximum(found, floor)[~masked]
    return noise


def _step_of_noise(live: Floats, levels: Floats) -> float:
    """The step of a converter of which windows (windows, scans, taxels) show few levels, as only noise moved them.

    0 where most taxels do not scatter, or the levels are no multiples of a step apart: it may be an image's.
    """
    seen = np.isfinite(live).any(axis=(0, 1))
    with np.errstate(over="ignore", invalid="ignore"):
        scatter = _independent(live)
    if len(levels) < 2 or 2 * np.count_nonzero(scatter) <= np.count_nonzero(seen):
        return 0.0
    gaps = np.diff(levels)
    step = float(gaps.min())
    return step if (np.abs(gaps / step - np.round(gaps / step)) <= MIN_NOISE_SHARE).all() else 0.0


def _without_repeats(live: Floats) -> Floats:
    """Windows (windows, scans, taxels) in which scans equal to the one before, bit for bit, are left out.

    A logger may have written them twice; where the sensor itself repeats, all its taxels are clipped, or constant.
    """
    same = (live[:, 1:] == live[:, :-1]) | (np.isnan(live[:, 1:]) & np.isnan(live[:, :-1]))
    repeats = np.concatenate([np.zeros((len(live), 1), dtype=np.bool_), same.all(axis=2)], axis=1)
    order = np.argsort(repeats, axis=1, kind="stable")
    kept: Floats = np.take_along_axis(live, order[:, :, np.newaxis], axis=1)
    kept[np.take_along_axis(repeats, order, axis=1)] = np.nan
    return kept


def _rest_likelihood(live: Floats, near: NDArray[np.int64], grid: Floats, cut: Floats, reach: float) -> Floats:
    """(taxels, grid), logarithm, by the unloaded readings of windows (windows, scans, taxels); 0 for what has none."""
    per_window = live.shape[1]
    some = live[:: 1 + len(live) * per_window // _REST.scans]
    readings = far_from_loads(some.reshape(-1, live.shape[2]), near)
    known = np.isfinite(readings)
    clipped = np.sum(readings <= cut, axis=0, where=known)
    usable = (known.sum(axis=0) >= _REST.fewest) & (clipped <= _REST.clipped * known.sum(axis=0))
    usable = np.flatnonzero(usable & _independent(readings.reshape(some.shape)))
    usable = _evenly(readings, usable, _REST.readings // len(readings))
    likelihood = np.zeros((live.shape[2], len(grid)))
    if len(usable):
        likelihood[usable] = rest_likelihood(readings[:, usable], grid, cut[usable], reach)
    return likelihood


def _evenly(readings: Floats, usable: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """Every n-th of the usable taxels by the scatter of their readings (scans, taxels), about as many as `most`.

    Not by their number: which taxels are chosen must not depend on the order in which a sensor lists them.
    """
    every = 1 + len(usable) // max(most, 1)
    if every == 1:
        return usable
    own = readings[:, usable]
    known = np.isfinite(own)
    mean = own.sum(axis=0, where=known) / known.sum(axis=0)
    square = (np.where(known, own - mean, 0.0) ** 2).sum(axis=0) / known.sum(axis=0)
    return usable[np.lexsort((mean, square))][every // 2 :: every]


def _independent(far: Floats) -> Bools:
    """(taxels,): neighbouring scans of windows (windows, scans, taxels) differ as much as any two of them.

    By the ratio of J. von Neumann, Annals of Mathematical Statistics 12, 1941, which clipping does not change.
    """
    known = np.isfinite(far)
    mean = far.sum(axis=(0, 1), where=known) / np.maximum(known.sum(axis=(0, 1)), 1)
    variance = (np.where(known, far - mean, 0.0) ** 2).sum(axis=(0, 1)) / np.maximum(known.sum(axis=(0, 1)) - 1, 1)
    both = known[:, 1:] & known[:, :-1]
    change = np.where(both, far[:, 1:] - far[:, :-1], 0.0) ** 2
    ratio_above = change.sum(axis=(0, 1)) > _REST.neumann_ratio * 2 * variance * both.sum(axis=(0, 1))
    independent: Bools = ratio_above & (variance > 0)
    return independent


def _steady_likelihood(live: Floats, grid: Floats, bottom: Floats, pads: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """(taxels, grid), logarithm, by the second differences of windows; and the weight (taxels, 1) that makes all taxels
    of a pad count like one: they move together.
    """
    some = live[:: 1 + len(live) // _STEADY.windows]
    variance, freedom, is_line = _window_variances(some, bottom)
    window, taxel = np.nonzero(np.isfinite(variance))
    value, dof, line = variance[window, taxel], freedom[window, taxel], is_line[window, taxel]
    ratio = np.log(np.maximum(value, grid[0] ** 2))[:, np.newaxis] - 2 * np.log(grid)  # constant: within a step
    half = 0.5 * dof[:, np.newaxis]
    quiet = half * np.log(half) - gammaln(half) + half * (ratio - np.exp(np.minimum(ratio, 50.0)))
    moving = np.log(gammainc(half, half * np.exp(np.minimum(ratio, 50.0))) + 1e-300) - np.log(
        2 * np.log(grid[-1] / grid[0]) + 1.0
    )
    quiet[~line] = -np.inf
    likelihood = np.zeros((len(_QUIET_SHARES), live.shape[2], len(grid)))
    for share, own in zip(_QUIET_SHARES, likelihood, strict=True):
        np.add.at(own, taxel, np.logaddexp(np.log(share) + quiet, np.log1p(-share) + moving))
    seen = np.unique(taxel)
    count = np.bincount(pads[seen], minlength=int(pads.max(initial=0)) + 1)
    weight = 1.0 / np.maximum(count[pads], 1.0)
    return np.asarray(logsumexp(likelihood, axis=0)), weight[:, np.newaxis]


def _window_variances(live: Floats, bottom: Floats) -> tuple[Floats, Floats, Bools]:
    """(windows, taxels): variance by second differences, NaN where clipped; its degrees of freedom; whether the
    readings lie on a line.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # a reading beyond all range makes its window unusable, no more
        difference = (live[:, :-2] - 2 * live[:, 1:-1] + live[:, 2:]) ** 2
        known = np.isfinite(difference)
        count = known.sum(axis=1)
        enough = max(min(_STEADY.differences, int(count.max(initial=1))), 1)
        variance = np.sum(difference, axis=1, where=known) / np.maximum(count, 1) / _SECOND_DIFFERENCE_VARIANCE
        clipped = (live <= bottom).mean(axis=1) >= _STEADY.clipped
        saturated = np.isposinf(live).mean(axis=1) >= _STEADY.clipped
        about_line = _variance_about_line(live)
    usable = (count >= enough) & ~clipped & ~saturated & np.isfinite(variance)
    usable &= variance > 0  # constant: clipped above a lowest glitch, stuck, or quieter than the step
    return np.where(usable, variance, np.nan), _STEADY.freedom * count, about_line <= _STEADY.line_ratio * variance


def _variance_about_line(live: Floats) -> Floats:
    """(windows, taxels) of the known readings of windows (windows, scans, taxels) about their regression line."""
    known = np.isfinite(live)
    count = np.maximum(known.sum(axis=1), 3)
    t = np.where(known, np.arange(live.shape[1], dtype=np.float64)[:, np.newaxis], 0.0)
    y = np.where(known, live, 0.0)
    t = np.where(known, t - (t.sum(axis=1) / count)[:, np.newaxis], 0.0)
    y = np.where(known, y - (y.sum(axis=1) / count)[:, np.newaxis], 0.0)
    slope = (t * y).sum(axis=1) / np.maximum((t * t).sum(axis=1), 1e-9)
    about: Floats = ((y - slope[:, np.newaxis] * t) ** 2).sum(axis=1) / (count - 2)
    return about


def _pooled(own: Floats, shared: Floats, pads: NDArray[np.int64], grid: Floats, prior: Floats) -> Floats:
    """(taxels,) noise: each taxel's posterior mean on a tree of sensor, pads and taxels, exact on the grid.

    own, shared: (taxels, grid), the logarithm of the likelihood for the taxel itself, and for its pad. prior: (grid,),
    of the sensor's level.
    """
    steps = np.arange(len(grid))
    like = np.exp(-0.5 * ((steps - steps[:, np.newaxis]) * np.log(_LEVELS.ratio) / _LEVELS.alike_log_std) ** 2)
    like /= like.sum(axis=1, keepdims=True)
    alike = (1 - _LEVELS.strange) * like + _LEVELS.strange / len(grid)
    to_pad = _passed(shared, alike)
    of_pads = np.zeros((int(pads.max(initial=0)) + 1, len(grid)))
    np.add.at(of_pads, pads, to_pad)
    to_sensor = _passed(of_pads, alike)
    sensor = prior + to_sensor.sum(axis=0)
    pad = of_pads + _passed(sensor - to_sensor, alike.T)
    belief = own + _passed(pad[pads] - to_pad, alike.T)
    belief = np.exp(belief - belief.max(axis=1, keepdims=True))
    noise: Floats = np.exp(belief @ np.log(grid) / belief.sum(axis=1))
    return noise


def _passed(belief: Floats, alike: Floats) -> Floats:
    """The message (n, grid) that a belief (n, grid) sends along the tree; both are logarithms."""
    top = belief.max(axis=1, keepdims=True)
    passed: Floats = np.log(np.exp(belief - top) @ alike.T + 1e-300) + top
    return passed
