"""Unloaded readings of each taxel: their level and the likelihood of their noise, with clipping at 0.

A taxel's readings are a mixture: unloaded ones scatter about its level by the noise, and what falls below the lowest
value that the sensor reads is clipped to it (J. Tobin, Econometrica 26, 1958); loads lie above the level, small ones as
often as large ones on a scale of ratios. For a given noise, level and share are found by expectation maximisation
(A. P. Dempster et al., Journal of the Royal Statistical Society B 39, 1977).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import log_ndtr

from taxelflow.condition.converter import MIN_NOISE_SHARE
from taxelflow.numerics.robust import MAD_TO_SIGMA
from taxelflow.numerics.rounding import CERTAIN

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats
    from taxelflow.sensors.layout import Layout

NEAR_LOAD_SHARE = 0.1
"""Beside a load above this share of the sensor's range, no reading counts as unloaded: the skirt of a contact is not
noise. Nor is a load within the usual scatter, in a sensor without any."""


@dataclass(frozen=True, slots=True)
class _Level:
    """How the level of the unloaded readings is searched for."""

    scatters: float = 0.5
    """Share of scans in which the reading of a taxel that scatters changes: clipped ones do not show the noise."""
    iterations: int = 5
    """Of the level: the last one changes it by less than a tenth of the noise."""
    start_quantile: float = 0.1
    start_place: int = 2
    """Where the search for the level starts: at this quantile, not below the third lowest reading: a taxel may be
    unloaded in few scans."""
    lowest_level: float = -1.5
    """Lowest level that is considered, in standard deviations from the lowest reading: farther below, all is
    clipped."""
    stray: float = 1e-3
    """Probability, relative to that of a light load, of a reading below the level that noise does not explain."""
    least_log_odds: float = -50.0
    """Logarithm of the odds that a reading is unloaded, at least: below, it is loaded, to rounding."""
    even: float = 1.0
    """Readings of either kind that are added to the share: a taxel may be loaded in all scans that were seen."""
    together: int = 6_000
    """Readings, times noises, that are computed at once: few calls of NumPy, whose arrays stay in the CPU's cache."""


_LEVEL = _Level()


@dataclass(frozen=True, slots=True, eq=False)
class Resting:
    """level: (taxels,) of unloaded readings. unloaded: (scans, taxels), probability; 0 where the reading is missing.
    likelihood: (taxels,), logarithm of that of the noise, the level being unknown.
    """

    level: Floats
    unloaded: Floats
    likelihood: Floats


def near_taxels(layout: Layout) -> NDArray[np.int64]:
    """(taxels, most neighbours): the neighbours of each taxel on its pad, filled up with the taxel itself."""
    near: list[list[int]] = [[] for _ in range(layout.taxels)]
    for pad in range(layout.pad_count):
        start = layout.of_pad(pad).start
        for one, other in (start + layout.neighbours(pad)).tolist():
            near[one].append(other)
            near[other].append(one)
    most = max(map(len, near), default=0)
    return np.array(
        [[*some, *[taxel] * (most - len(some))] for taxel, some in enumerate(near)], dtype=np.int64
    ).reshape(len(near), most)


def far_from_loads(readings: Floats, near: NDArray[np.int64]) -> Floats:
    """A copy of readings (scans, taxels) with NaN where a taxel or a neighbour is loaded, judged without any noise."""
    lowest = np.min(readings, axis=0, initial=np.inf, where=np.isfinite(readings))
    with np.errstate(invalid="ignore", over="ignore"):
        load = readings - lowest
        change = np.abs(readings[:-2] - 2 * readings[1:-1] + readings[2:])
    both = np.isfinite(readings[1:]) & np.isfinite(readings[:-1])
    scatters = np.sum(both & (readings[1:] != readings[:-1]), axis=0) > _LEVEL.scatters * both.sum(axis=0)
    change = change[:, scatters]
    change = change[np.isfinite(change)]
    scatter = MAD_TO_SIGMA * float(np.median(change)) / 6**0.5 if change.size else 0.0
    most = float(np.max(load, initial=0.0, where=np.isfinite(load)))
    loaded = ~(load <= max(NEAR_LOAD_SHARE * most, CERTAIN * scatter)) & ~np.isnan(readings)
    beside: Bools = loaded.copy()
    for column in near.T:
        beside |= loaded[:, column]
    far: Floats = np.where(beside, np.nan, readings)
    return far


def find_rest(readings: Floats, noise: Floats | float, cut: Floats | float, reach: float) -> Resting:
    """Level of the unloaded readings, and which ones are, given the noise.

    readings: (scans, taxels), NaN where missing. noise, cut: (taxels,) or one for all; readings that would be lower
    than cut are clipped. reach: the largest load there may be.
    """
    sigma = np.broadcast_to(np.asarray(noise, dtype=np.float64), (1, readings.shape[1]))
    rest = _find_rest(_Readings.of(readings, cut), sigma, reach)
    return Resting(rest.level[0], rest.unloaded[0], rest.likelihood[0])


def rest_likelihood(readings: Floats, noises: Floats, cut: Floats | float, reach: float) -> Floats:
    """(taxels, noises): `Resting.likelihood` for each of the noises (noises,) common to all taxels; see `find_rest`."""
    prepared = _Readings.of(readings, cut)
    likelihood = np.empty((readings.shape[1], len(noises)))
    together = max(1, _LEVEL.together // max(1, readings.size))
    for start in range(0, len(noises), together):
        some = noises[start : start + together]
        sigma = np.broadcast_to(some[:, np.newaxis], (len(some), readings.shape[1]))
        likelihood[:, start : start + together] = _find_rest(prepared, sigma, reach).likelihood.T
    return likelihood


@dataclass(frozen=True, slots=True, eq=False)
class _Readings:
    """What does not depend on the noise: y (scans, taxels), `cut` where missing; known, clipped: which of them are;
    count, level: (taxels,) of known ones, and where the search for the level starts.
    """

    y: Floats
    known: Bools
    clipped: Bools
    count: NDArray[np.int64]
    level: Floats
    cut: Floats | float

    @classmethod
    def of(cls, readings: Floats, cut: Floats | float) -> _Readings:
        known = np.isfinite(readings)
        y = np.where(known, readings, cut)
        ranked = np.sort(np.where(known, y, np.inf), axis=0)
        count = known.sum(axis=0)
        place = np.minimum(np.maximum(_LEVEL.start_quantile * count, _LEVEL.start_place), count - 1).astype(int)
        level = ranked[np.maximum(place, 0), np.arange(y.shape[1])]
        return cls(y, known, known & (y <= cut), count, np.where(count > 0, level, cut), cut)


def _find_rest(readings: _Readings, sigma: Floats, reach: float) -> Resting:
    """Fields of `Resting` with a first axis, the noises: sigma is (noises, taxels).

    The odds of a reading that it is unloaded take one exponential; logarithms are for the likelihood only.
    """
    y, known, clipped, count, cut = readings.y, readings.known, readings.clipped, readings.count, readings.cut
    level, share = np.broadcast_to(readings.level, sigma.shape), np.full(sigma.shape, 0.5)
    light = -np.log(sigma * np.log1p(reach / sigma))  # density of a light load, beside which is 1 / (1 + z)
    stray = light + np.log(_LEVEL.stray)
    scale = _each(-0.5 * np.log(2 * np.pi) - np.log(sigma) - light)
    is_clipped = bool(clipped.any())
    for _ in range(_LEVEL.iterations):
        edge = (cut - level) / sigma
        below = log_ndtr(edge)
        z = (y - _each(level)) / _each(sigma)
        odds = z * z
        odds *= -0.5
        odds += scale
        np.exp(np.maximum(odds, _LEVEL.least_log_odds, out=odds), out=odds)
        odds *= np.where(z < 0, 1.0 / _LEVEL.stray, 1.0 + z)
        if is_clipped:
            of_clipped = np.exp(np.maximum(below - stray, _LEVEL.least_log_odds))
            odds = np.where(clipped, _each(of_clipped), odds)
        odds *= _each(share / (1 - share))
        loaded = np.log1p(-share)
        unloaded = odds / (1 + odds)
        unloaded *= known
        total = unloaded.sum(axis=1)
        if is_clipped:
            largest = np.log1p(np.maximum(-edge, 0.0))  # rounding exceeds it far below, and then overflows
            mills = np.exp(np.minimum(-0.5 * edge**2 - 0.5 * np.log(2 * np.pi) - below, largest))
            weighed = np.where(clipped, _each(level - sigma * mills), y)
            weighed *= unloaded
        else:
            weighed = unloaded * y
        mean = weighed.sum(axis=1) / np.maximum(total, 1e-9)
        level = np.maximum(np.where(total > 0, mean, level), cut + _LEVEL.lowest_level * sigma)
        share = (total + _LEVEL.even) / (count + 2 * _LEVEL.even)
    log_load = np.where((z < 0) | clipped, _each(stray), _each(light) - np.log1p(np.maximum(z, 0.0)))
    likelihood = np.where(known, log_load + np.log1p(odds), 0.0).sum(axis=1) + count * loaded
    levels = sigma / (MIN_NOISE_SHARE * reach)  # that a converter may send within the noise: of no unit
    return Resting(level, unloaded, likelihood + np.log(levels) * np.minimum(total, 1.0))


def _each(of_taxels: Floats) -> Floats:
    """(noises, taxels) as (noises, 1, taxels): the same for each scan."""
    return of_taxels[:, np.newaxis]
