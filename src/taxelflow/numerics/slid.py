"""A pattern that has slid and turned, with one gain and, if it may, one sinking, see `rest_or_slide`.

The pattern before is read between its taxels, where the smoothest surface through them continues it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from taxelflow.messages import Bools, Floats
from taxelflow.numerics.rounding import ROUNDING
from taxelflow.numerics.small_linalg import solve_small
from taxelflow.numerics.sunk_and_tilted import RIDGE, ROUNDS
from taxelflow.runtime.compiling import lean_kernel, routine

UNKNOWNS = 4
"""Of a slide: place, angle and gain; sinking is one more."""
SAME = 0.5
"""Share of a pattern that must be known from the one before, for both to be compared."""
_HALF = 0.6
"""Pitches to which a taxel reads around its centre, with a tenth to spare."""


class _Step(NamedTuple):
    """Steps of the fit of a slide."""

    enough: float = 1e-3
    """Share of the squares that a step must change to be followed by another."""
    damping: float = 1e-3
    """Of the first step, relative to its information."""


_STEP = _Step()
_TINY = float(np.finfo(float).tiny)


class Skin(NamedTuple):
    """The taxels of a pad: places (2, taxels), low and high (2,), corners of what they read, all in pitches; and fit
    (taxels + 3, taxels), which gives the surface through their readings: sum_j w_j |r - r_j|^3 + p . (1, r).
    """

    places: Floats
    low: Floats
    high: Floats
    fit: Floats

    @classmethod
    def of(cls, places: Floats) -> Skin:
        """The skin of taxels at places (2, taxels), in pitches."""
        count, spans = places.shape[1], np.ptp(places, axis=1) > 0.0  # places on a line determine no slope across it
        plane = np.column_stack([np.ones(count), np.where(spans, places.T, 0.0)])
        distances = np.hypot(*(np.subtract.outer(axis, axis) for axis in places))
        whole = np.block([[distances**3, plane], [plane.T, np.zeros((3, 3))]])
        single = np.linalg.matrix_rank(plane) == 3 and len(np.unique(places.T, axis=0)) == count
        inverse = np.linalg.inv(whole) if single else np.linalg.pinv(whole, hermitian=True)  # 20 times as slow
        fit = np.ascontiguousarray(inverse[:, :count])
        return cls(np.ascontiguousarray(places), places.min(axis=1) - _HALF, places.max(axis=1) + _HALF, fit)


class Pair(NamedTuple):
    """What a slide explains: the surface before (taxels + 3,) and its centre (2,), and the pattern after (taxels,) on
    the chosen taxels. least: reading of a taxel that is loaded. sinks: whether the object may sink.
    """

    surface: Floats
    centre: Floats
    after: Floats
    chosen: NDArray[np.int64]
    least: float
    sinks: bool


class Fit(NamedTuple):
    """Of the chosen taxels: what a slide leaves, its slopes (chosen, 3), and whether a taxel was over the pad. sums:
    (3, 5), products of the pattern, of 1 on its loaded taxels, and of the readings, with these and the slopes.
    """

    left: Floats
    slopes: Floats
    inside: Bools
    sums: Floats


@lean_kernel
def fit_surface(skin: Skin, readings: Floats, surface: Floats) -> None:
    """Fill the surface (taxels + 3,) through readings (taxels,)."""
    for i in range(len(surface)):
        total = 0.0
        for k in range(len(readings)):
            total += skin.fit[i, k] * readings[k]
        surface[i] = total


@routine
def room_for(count: int) -> Fit:
    """A fit of this many taxels."""
    return Fit(np.empty(count), np.empty((count, 3)), np.ones(count, np.bool_), np.empty((3, 5)))


@routine
def slide(skin: Skin, pair: Pair, state: Floats, fit: Fit) -> float:
    """Squares that the best slide leaves, from a state (x, y, angle) about the centre, with what it explains in fit."""
    damping, trial, other = _STEP.damping, np.empty(3), room_for(len(pair.chosen))
    information, step = np.empty((3, 3)), np.empty(3)
    left = _linearise(skin, pair, state, fit)
    for _ in range(ROUNDS if left < np.inf else 0):
        _add_normal(fit, information, step)
        stiff = RIDGE * (information[0, 0] + information[1, 1] + information[2, 2]) + _TINY
        for a in range(3):
            information[a, a] += damping * information[a, a] + stiff
        if not solve_small(information, step, 3):
            break
        for a in range(3):
            trial[a] = state[a] - step[a]
        found = _linearise(skin, pair, trial, other)
        damping *= 10.0
        gained = left - found
        if gained > 0.0:
            damping /= 50.0
            left = found
            _copy(trial, other, state, fit)
        if abs(gained) < _STEP.enough * left:
            break
    return left


@lean_kernel
def _copy(trial: Floats, found: Fit, state: Floats, fit: Fit) -> None:
    """Keep a trial (3,) and what it leaves."""
    for a in range(3):
        state[a] = trial[a]
    for k in range(len(fit.left)):
        fit.left[k], fit.inside[k] = found.left[k], found.inside[k]
        for a in range(3):
            fit.slopes[k, a] = found.slopes[k, a]


@lean_kernel
def _add_normal(fit: Fit, information: Floats, step: Floats) -> None:
    """Fill the normal matrix (3, 3) and right-hand side (3,) of a fit."""
    for a in range(3):
        step[a] = 0.0
        for b in range(3):
            information[a, b] = 0.0
    for k in range(len(fit.left)):
        for a in range(3):
            step[a] += fit.slopes[k, a] * fit.left[k]
            for b in range(3):
                information[a, b] += fit.slopes[k, a] * fit.slopes[k, b]


@lean_kernel
def _linearise(skin: Skin, pair: Pair, state: Floats, fit: Fit) -> float:
    """Fill in what a slide (x, y, angle) about the centre leaves, and its slopes; return the squares left.

    Infinite if it knows less than half of the readings, squared.
    """
    if _read(skin, pair, state, fit) < SAME:
        return np.inf
    sums, slopes = fit.sums, fit.slopes
    sinks = 1.0 if pair.sinks else 0.0
    power, even, once = sums[0, 0] * (1.0 + RIDGE) + _TINY, sinks * sums[0, 1], sums[1, 1] + RIDGE
    square = power * once - even * even
    gain = (sums[2, 0] * once - sums[2, 1] * even) / square
    sunk = sinks * (sums[2, 1] * power - sums[2, 0] * even) / square
    total = 0.0
    for k in range(len(pair.chosen)):
        value = fit.left[k]
        loaded = value > pair.least
        for a in range(3):
            # Gain and sinking follow each motion: what they explain of the slopes is none of theirs.
            by_value = (sums[0, 2 + a] * once - sums[1, 2 + a] * even) / square
            by_one = sinks * (sums[1, 2 + a] * power - sums[0, 2 + a] * even) / square
            slopes[k, a] = gain * (slopes[k, a] - by_value * value - (by_one if loaded else 0.0))
        reading = pair.after[pair.chosen[k]] if fit.inside[k] else 0.0
        left = reading - max(gain * value + (sunk if loaded else 0.0), 0.0)
        if not loaded and left > 0.0:  # new contact up to the sinking is no contradiction
            left = max(left - max(sunk, 0.0), 0.0)
        fit.left[k] = left
        total += left * left
    return total


@lean_kernel
def _read(skin: Skin, pair: Pair, state: Floats, fit: Fit) -> float:
    """Fill fit.left with the pattern before as a slide (x, y, angle) has moved it, and its slopes, inside and sums.

    Returns the share of the readings, squared, on taxels that were over the pad.
    """
    cos, sin = np.cos(state[2]), np.sin(state[2])
    (cx, cy), slopes, sums = (pair.centre[0], pair.centre[1]), fit.slopes, fit.sums
    for a in range(3):
        for b in range(5):
            sums[a, b] = 0.0
    known, whole = 0.0, _TINY
    for k in range(len(pair.chosen)):
        i = pair.chosen[k]
        off_x, off_y = skin.places[0, i] - state[0] - cx, skin.places[1, i] - state[1] - cy
        x, y = cos * off_x + sin * off_y, cos * off_y - sin * off_x
        fit.inside[k] = skin.low[0] <= x + cx <= skin.high[0] and skin.low[1] <= y + cy <= skin.high[1]
        value, along_x, along_y = _surface(skin.places, pair.surface, x + cx, y + cy)
        if not fit.inside[k] or value <= ROUNDING * pair.least:  # through a reading of 0 the surface is 0 to rounding
            value = along_x = along_y = 0.0
        fit.left[k] = value
        slopes[k, 0] = cos * along_x - sin * along_y
        slopes[k, 1] = sin * along_x + cos * along_y
        slopes[k, 2] = along_y * x - along_x * y
        one = 1.0 if value > pair.least else 0.0
        reading = pair.after[i] if fit.inside[k] else 0.0
        known, whole = known + reading * reading, whole + pair.after[i] * pair.after[i]
        sums[0, 0] += value * value
        sums[0, 1] += value * one
        sums[1, 1] += one
        sums[2, 0] += reading * value
        sums[2, 1] += reading * one
        for a in range(3):
            sums[0, 2 + a] += value * slopes[k, a]
            sums[1, 2 + a] += one * slopes[k, a]
    return known / whole


@lean_kernel
def _surface(places: Floats, surface: Floats, x: float, y: float) -> tuple[float, float, float]:
    """A surface (taxels + 3,) at a place, and its slopes along x and y."""
    along_x, along_y = places[0], places[1]  # rows of their own: taxels are then read eight at a time
    count = len(along_x)
    by_x, by_y = surface[count + 1], surface[count + 2]
    value = surface[count] + x * by_x + y * by_y
    for j in range(count):
        off_x, off_y = x - along_x[j], y - along_y[j]
        squared = off_x * off_x + off_y * off_y
        bent = surface[j] * np.sqrt(squared)
        value += bent * squared
        by_x += 3.0 * bent * off_x
        by_y += 3.0 * bent * off_y
    return value, by_x, by_y
