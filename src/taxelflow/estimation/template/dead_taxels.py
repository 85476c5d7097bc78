"""Detection of dead taxels: by their silence among loaded ones before there is a pattern, and by the pattern."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.template.map import fill
from taxelflow.numerics.bspline import state_of
from taxelflow.numerics.cut import IN_LINE
from taxelflow.numerics.near_pairs import near_pairs
from taxelflow.numerics.rounding import SIGNIFICANT

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.estimation.template.bundle_adjustment import Fit
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.solution import Solved
    from taxelflow.messages import Bools, Floats


class _Silence(NamedTuple):
    """Taxels that stay silent beside loaded ones."""

    beside: float = 1.25
    strong: float = 10.0
    silent: float = 0.1
    """Neighbours lie within this many pitches, are loaded above this many standard deviations, and a silent taxel reads
    less than this share of theirs."""
    high: float = 0.2
    """Neighbours count that read more than this share of the largest reading: between feet, all get a little."""
    further: float = 2.0
    """A contact that has gone over silent taxels went this many pitches further than they reach: it did not rock."""
    enclosed: float = 0.5
    """A taxel is enclosed if the mean of the directions to its neighbours is shorter: at a corner an object may end."""


_SILENCE = _Silence()


class _Fault(NamedTuple):
    """Taxels that read too little for the model."""

    dead: float = 0.5
    """A taxel is dead if its reading over the model is less, both by its regression on the model and by the largest of
    each; ..."""
    loaded_enough: float = 400.0
    """... and if the variance of that regression is less than one over this: its standard deviation, than 0.05."""


_FAULT = _Fault()


def unanswering(scanned: Scanned, fit: Fit) -> int | None:
    """The taxel with the least response to a load by the pattern that is certain, if that is too little; else None."""
    known = (scanned.variance > 0) & (fit.model > 0)
    model = np.where(known, fit.model, 0.0)
    power = (model**2).sum(axis=0)
    answer = (model * scanned.readings).sum(axis=0)
    noise = (model**2 * scanned.variance).sum(axis=0)
    most = scanned.readings.max(axis=0, initial=0.0)
    silent = (most < _FAULT.dead * model.max(axis=0, initial=0.0)) & ~_answered(scanned)
    sure = silent & (power**2 > _FAULT.loaded_enough * noise)
    share = np.where(sure, answer / np.maximum(power, 1e-300), np.inf)
    worst = int(np.argmin(share))
    return worst if share[worst] < _FAULT.dead else None


def working(readings: Floats, noise: Floats) -> Bools:
    """(taxels,), which clearly respond to a load in scans (scans, taxels) of their pad, of whatever contact.

    noise: (taxels,), standard deviations. Light scans count for nothing: cross-talk is a large share of their readings.
    """
    largest = readings.max(axis=1, initial=0.0, keepdims=True)
    clear = (readings > _SILENCE.silent * largest) & (readings > _SILENCE.strong * noise)
    found: Bools = np.any(clear & (largest > _SILENCE.high * largest.max(initial=0.0)), axis=0)
    return found


def answers(reading: Floats, variance: Floats, dead: NDArray[np.int64]) -> NDArray[np.int64]:
    """The taxels among `dead` that clearly respond to a load in a scan (taxels,) of their pad."""
    least = np.maximum(_SILENCE.silent * reading.max(), _SILENCE.strong * np.sqrt(variance[dead]))
    alive: NDArray[np.int64] = dead[(reading[dead] > least) & (variance[dead] > 0)]
    return alive


def explained(scanned: Scanned, variance: Floats, solved: Solved, taxels: NDArray[np.int64]) -> Bools:
    """(n,), whether a pattern learned without n taxels explains their silence, as where the object has a gap.

    variance: (scans, n), of their readings, that of `scanned` being 0. What is predicted has the error that the fit
    leaves of others: at the side of a gap a smooth pattern predicts a little where there is nothing. Not on a sensor
    with unseen errors, which are most of what is left there: they would hide dead taxels.
    """
    model = np.empty((len(scanned), len(taxels)))
    for k, state in enumerate(solved.states):
        pressure = solved.pattern.read(scanned.places, state, scanned.bends[k])[taxels, 0]
        model[k] = state_of(state).gain * np.maximum(np.nan_to_num(pressure), 0.0)
    model[variance == 0] = 0.0
    power, read = (model**2).sum(axis=0), (model * scanned.readings[:, taxels]).sum(axis=0)
    error = 0.0 if scanned.unseen_error else solved.error * scanned.amplitude
    sure = power**2 > _FAULT.loaded_enough * (model**2 * (variance + error**2)).sum(axis=0)
    answered: Bools = ~sure | (read >= _FAULT.dead * power)
    return answered


def denied(scanned: Scanned, solved: Solved) -> int | None:
    """The silent taxel that a pattern learned without it predicts a load on, the most loaded one first; else None.

    Candidates have two loaded neighbours: there an object may end, or continue over a dead taxel.
    """
    high: Bools = (scanned.readings > _SILENCE.high * scanned.amplitude) & scanned.loaded()
    beside = high @ _beside(scanned.places).astype(np.float64)
    asked = np.flatnonzero(_quiet(scanned) & (beside.max(axis=0, initial=0.0) > 1.5))
    asked = asked[_denies(scanned, solved, asked)]
    by_level = asked[np.argsort(-beside[:, asked].sum(axis=0), kind="stable")]
    return next((int(taxel) for taxel in by_level if _denies(scanned, solved, np.array([taxel]))[0]), None)


def _denies(scanned: Scanned, solved: Solved, taxels: NDArray[np.int64]) -> Bools:
    """(n,), which of n taxels read less than the pattern that explains the others where the scans are now."""
    if not len(taxels):
        return np.zeros(0, np.bool_)
    variance, refilled = scanned.variance.copy(), replace(solved, pattern=replace(solved.pattern))
    variance[:, taxels] = 0.0
    without = replace(scanned, variance=variance)
    fill(refilled.pattern, without.with_error(solved.error), solved.states)
    return ~explained(without, scanned.variance[:, taxels], refilled, taxels)


def _quiet(scanned: Scanned) -> Bools:
    """(taxels,), which have never read a load."""
    quiet: Bools = ~_answered(scanned) & np.any(scanned.variance > 0, axis=0)
    return quiet


def _answered(scanned: Scanned) -> Bools:
    """(taxels,), which have read what a dead one cannot: more than noise, and more than the error that the sensor
    declares unseen, for cross-talk reaches dead taxels, too; or are known to work by another contact.
    """
    noise = _SILENCE.strong * np.sqrt(scanned.variance)
    unseen = SIGNIFICANT * scanned.unseen_error * scanned.amplitude
    least = np.minimum(np.maximum(noise, unseen), _SILENCE.silent * scanned.amplitude)
    answered: Bools = np.any(scanned.loaded() & (scanned.readings > least), axis=0)
    return answered | scanned.alive


def silent_taxels(scanned: Scanned) -> NDArray[np.int64]:
    """Taxels that read next to nothing among loaded ones: single ones, and pairs of neighbours.

    Some may be gaps of the object, see `explained`.
    """
    beside = _beside(scanned.places)
    strong = (scanned.readings > _SILENCE.strong * np.sqrt(scanned.variance)) & (scanned.variance > 0)
    quiet = _quiet(scanned)
    high: Bools = strong & (scanned.readings > _SILENCE.high * scanned.amplitude)
    enclosed = quiet & _enclosed(scanned.places, beside)
    found = set(np.flatnonzero(enclosed & _surrounded(scanned.readings, high, beside)).tolist())
    on_its_way = quiet & (beside @ high.any(axis=0).astype(np.float64) > 1.5)
    found.update(*_passed_over(scanned, strong, beside, on_its_way))
    return np.array(sorted(found), np.int64)


def _beside(places: Floats) -> Bools:
    """(taxels, taxels): which are neighbours. places: (2, taxels)."""
    first, second, way = near_pairs(places, _SILENCE.beside)
    near = np.zeros((places.shape[1],) * 2, dtype=np.bool_)
    near[first, second] = way.any(axis=0)
    return near


def _enclosed(places: Floats, beside: Bools) -> Bools:
    """(taxels,): which have neighbours on all sides, or on all but one."""
    away = (places[:, np.newaxis] - places[:, :, np.newaxis]) * beside
    mean = np.hypot(*away.sum(axis=2)) / np.maximum(beside.sum(axis=1), 1)
    enclosed: Bools = mean < _SILENCE.enclosed
    return enclosed


def _surrounded(readings: Floats, high: Bools, beside: Bools) -> Bools:
    """(taxels,): which read next to nothing in scans in which nearly all of their neighbours are loaded."""
    count = beside.sum(axis=0)
    surrounded = (high @ beside.astype(np.float64) > np.where(count > 3, count - 1.5, count - 0.5)) & (count > 1)
    around = (readings @ beside.astype(np.float64)) / np.maximum(count, 1)
    own = np.where(surrounded, readings, 0.0).sum(axis=0)
    expected = np.where(surrounded, around, 0.0).sum(axis=0)
    share = np.where(count > 3, _SILENCE.silent, 0.5 * _SILENCE.silent)  # at a border pressure may end
    silent: Bools = (expected > 0) & (own < share * expected)
    return silent


def _passed_over(scanned: Scanned, strong: Bools, beside: Bools, quiet: Bools) -> list[list[int]]:
    """Single taxels and pairs that stay silent while a contact goes right over them. quiet: (taxels,), candidates.

    Taxels of a pair hide each other from their neighbours, so that few scans surround them, and a hole of two taxels
    in an object at rest looks the same. An object that slides over them cannot keep its hole there.
    """
    centroid = scanned.centroids()[scanned.loaded().any(axis=1)]
    found = []
    for one in np.flatnonzero(quiet).tolist():
        group = [one, *np.flatnonzero(quiet & beside[one]).tolist()]
        near = np.flatnonzero(quiet & beside[group].any(axis=0))
        if (
            group == sorted(group)
            and len(group) < 3
            and set(near) <= set(group)
            and _goes_over(scanned, strong, beside, centroid, group)
        ):
            found.append(group)
    return found


def _goes_over(scanned: Scanned, strong: Bools, beside: Bools, centroid: Floats, group: list[int]) -> bool:
    """Whether the contact, centred at `centroid` (scans, 2), goes over one or two taxels that read nothing."""
    places = scanned.places
    around = np.flatnonzero(beside[group].any(axis=0))
    around = around[~np.isin(around, group)]
    touched = strong[:, around].any(axis=1)
    level = np.where(strong[:, around], scanned.readings[:, around], 0.0).sum(axis=1)
    level /= np.maximum(strong[:, around].sum(axis=1), 1)
    if scanned.readings[touched][:, group].sum(axis=0).max() > _SILENCE.silent * level.sum():
        return False
    middle = places[:, group].mean(axis=1)
    along = places[:, group[-1]] - middle
    length = float(np.hypot(*along))
    along = along / length if length else np.array([1.0, 0.0])
    for axis, reach in ((along, length), (np.array([-along[1], along[0]]), 0.0)):
        out = axis @ (places[:, around] - middle[:, np.newaxis])
        ahead = strong[:, around[out > reach + IN_LINE]].any(axis=1)
        behind = strong[:, around[out < -reach - IN_LINE]].any(axis=1)
        between = strong[:, around[np.abs(out) <= reach + IN_LINE]].any()
        passed = (ahead & ~behind).any() and (behind & ~ahead).any() and between
        if passed and np.ptp(centroid @ axis) > 2 * reach + _SILENCE.further:
            return True
    return False
