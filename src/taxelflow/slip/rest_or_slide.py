"""Which explains how a pattern has changed: an object that rests while its load shifts, or one that slides?

A rigid object on an elastic skin presses each taxel in proportion to how deep it lies there. Held at its place, it can
only sink and tilt, which adds a plane to the pressure. Softer skins change in proportion to their pressure, too:

    rest:   y = max(q (g + a . r) + (c + b . r), 0),
    slide:  y = g q(R(r - d)),                           not below 0.

q is the pattern before, y the one after, r the place of a taxel. Where q is 0, the object may come down by any part of
what the plane has there: new contact up to it is no contradiction. The slide reads q between its taxels, where the
smoothest surface through them continues it. What was not over the pad before is left out of both.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from taxelflow.messages import Bools, Floats
from taxelflow.numerics.centroid import SKIRT_SHARE
from taxelflow.numerics.rounding import SIGNIFICANT
from taxelflow.numerics.small_linalg import solve_small
from taxelflow.runtime.compiling import kernel, lean_kernel, routine
from taxelflow.slip.sunk_and_tilted import RIDGE, ROUNDS, find_centre, squares_at_rest

_HALF = 0.6
"""Pitches to which a taxel reads around its centre, with a tenth to spare."""
_ENOUGH = 1e-3
"""Share of the squares that a step must change to be followed by another."""
_DAMPING = 1e-3
"""Of the first step of the fit of a slide, relative to its information."""
_MOST_TAXELS = 100
"""Taxels that decide, evenly spread over a large contact."""
_TINY = float(np.finfo(float).tiny)


class Skin(NamedTuple):
    """The taxels of a pad: places (taxels, 2), low and high (2,), corners of what they read, all in pitches; and fit
    (taxels + 3, taxels), which gives the surface through their readings: sum_j w_j |r - r_j|^3 + p . (1, r).
    """

    places: Floats
    low: Floats
    high: Floats
    fit: Floats

    @classmethod
    def of(cls, places: Floats) -> Skin:
        """The skin of taxels at places (taxels, 2), in pitches."""
        count, spans = len(places), np.ptp(places, axis=0) > 0.0  # places on a line determine no slope across it
        plane = np.column_stack([np.ones(count), np.where(spans, places, 0.0)])
        distances = np.hypot(*(np.subtract.outer(axis, axis) for axis in places.T))
        whole = np.block([[distances**3, plane], [plane.T, np.zeros((3, 3))]])
        single = np.linalg.matrix_rank(plane) == 3 and len(np.unique(places, axis=0)) == count
        inverse = np.linalg.inv(whole) if single else np.linalg.pinv(whole, hermitian=True)  # 20 times as slow
        fit = np.ascontiguousarray(inverse[:, :count])
        return cls(np.ascontiguousarray(places), places.min(axis=0) - _HALF, places.max(axis=0) + _HALF, fit)


class _Pair(NamedTuple):
    """What a slide explains: the surface before (taxels + 3,) and its centre (2,), and the pattern after (taxels,) on
    the chosen taxels.
    """

    surface: Floats
    centre: Floats
    after: Floats
    chosen: NDArray[np.int64]


class _Fit(NamedTuple):
    """Of the chosen taxels: what a slide leaves, its slopes (chosen, 3), and whether a taxel was over the pad."""

    left: Floats
    slopes: Floats
    inside: Bools


def compare(skin: Skin, before: Floats, after: Floats, noise: float, moved: Floats) -> tuple[float, float]:
    """Norms of what is left of a pattern (taxels,) if its object rests, and if it slides.

    before: (taxels,), the pattern at its place. noise: standard deviation of their difference. moved: (2,), in
    pitches, where the fit of the slide begins, beside the place before.
    """
    largest = max(float(before.max()), float(after.max()))
    least = max(SKIRT_SHARE * largest, SIGNIFICANT * noise)
    loaded = np.flatnonzero((before > least) | (after > least))
    if not len(loaded):
        return 0.0, 0.0
    if len(loaded) > _MOST_TAXELS:
        loaded = loaded[np.linspace(0, len(loaded) - 1, _MOST_TAXELS).round().astype(np.int64)]
    pair = _Pair(skin.fit @ before, np.zeros(2), after, loaded)
    return _compare(skin, pair, before, least, moved)


@kernel
def _compare(skin: Skin, pair: _Pair, before: Floats, least: float, moved: Floats) -> tuple[float, float]:
    """`compare`, on the chosen taxels. least: reading of a taxel that is loaded."""
    find_centre(skin.places, before, pair.centre)
    best, inside = np.inf, np.ones(len(pair.chosen), np.bool_)
    for start in range(2):
        state, fit = np.zeros(3), _room(len(pair.chosen))
        if start == 0:
            state[0], state[1] = moved[0], moved[1]
        left = _slide(skin, pair, state, fit)
        if left < best:
            best, inside = left, fit.inside
    rest = squares_at_rest(skin.places, before, pair.after, pair.chosen[inside], least)
    return np.sqrt(rest), np.sqrt(best)


@routine
def _room(count: int) -> _Fit:
    return _Fit(np.empty(count), np.empty((count, 3)), np.ones(count, np.bool_))


@routine
def _slide(skin: Skin, pair: _Pair, state: Floats, fit: _Fit) -> float:
    """Squares that the best slide leaves, from a state (x, y, angle) about the centre, with what it explains in fit."""
    damping, trial, other = _DAMPING, np.empty(3), _room(len(pair.chosen))
    information, step = np.empty((3, 3)), np.empty(3)
    left = _linearise(skin, pair, state, fit)
    for _ in range(ROUNDS):
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
        if abs(gained) < _ENOUGH * left:
            break
    return left


@lean_kernel
def _copy(trial: Floats, found: _Fit, state: Floats, fit: _Fit) -> None:
    """Keep a trial (3,) and what it leaves."""
    for a in range(3):
        state[a] = trial[a]
    for k in range(len(fit.left)):
        fit.left[k], fit.inside[k] = found.left[k], found.inside[k]
        for a in range(3):
            fit.slopes[k, a] = found.slopes[k, a]


@lean_kernel
def _add_normal(fit: _Fit, information: Floats, step: Floats) -> None:
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
def _linearise(skin: Skin, pair: _Pair, state: Floats, fit: _Fit) -> float:
    """Fill in what a slide (x, y, angle) about the centre leaves, and its slopes; return the squares left."""
    cos, sin = np.cos(state[2]), np.sin(state[2])
    (cx, cy), slopes = (pair.centre[0], pair.centre[1]), fit.slopes
    power = product = by_x = by_y = by_turn = 0.0
    for k in range(len(pair.chosen)):
        i = pair.chosen[k]
        off_x, off_y = skin.places[i, 0] - state[0] - cx, skin.places[i, 1] - state[1] - cy
        x, y = cos * off_x + sin * off_y, cos * off_y - sin * off_x
        fit.inside[k] = skin.low[0] <= x + cx <= skin.high[0] and skin.low[1] <= y + cy <= skin.high[1]
        value, along_x, along_y = _surface(skin.places, pair.surface, x + cx, y + cy)
        if not fit.inside[k] or value <= 0.0:
            value = along_x = along_y = 0.0
        fit.left[k] = value
        slopes[k, 0] = cos * along_x - sin * along_y
        slopes[k, 1] = sin * along_x + cos * along_y
        slopes[k, 2] = along_y * x - along_x * y
        power += value * value
        product += value * pair.after[i] if fit.inside[k] else 0.0
        by_x += value * slopes[k, 0]
        by_y += value * slopes[k, 1]
        by_turn += value * slopes[k, 2]
    power = max(power, _TINY)
    gain, total = product / power, 0.0
    for k in range(len(pair.chosen)):
        # The gain follows each motion: what it explains of the slopes is none of theirs.
        share = fit.left[k] / power
        slopes[k, 0] = gain * (slopes[k, 0] - share * by_x)
        slopes[k, 1] = gain * (slopes[k, 1] - share * by_y)
        slopes[k, 2] = gain * (slopes[k, 2] - share * by_turn)
        fit.left[k] = (pair.after[pair.chosen[k]] if fit.inside[k] else 0.0) - gain * fit.left[k]
        total += fit.left[k] * fit.left[k]
    return total


@lean_kernel
def _surface(places: Floats, surface: Floats, x: float, y: float) -> tuple[float, float, float]:
    """A surface (taxels + 3,) at a place, and its slopes along x and y."""
    count = len(places)
    by_x, by_y = surface[count + 1], surface[count + 2]
    value = surface[count] + x * by_x + y * by_y
    for j in range(count):
        off_x, off_y = x - places[j, 0], y - places[j, 1]
        bent = surface[j] * np.sqrt(off_x * off_x + off_y * off_y)
        value += bent * (off_x * off_x + off_y * off_y)
        by_x += 3.0 * bent * off_x
        by_y += 3.0 * bent * off_y
    return value, by_x, by_y


def covers(before: Floats, after: Floats) -> bool:
    """Whether all taxels (taxels,) are loaded in both patterns: none is at the end of the contact."""
    return bool(np.minimum(before, after).min() > SKIRT_SHARE * max(before.max(), after.max()))


def shared(before: Floats, after: Floats) -> float:
    """Share of the load of a pattern (taxels,) on taxels that were loaded in the one before."""
    load, was = np.maximum(after, 0.0), before > SKIRT_SHARE * before.max()
    total = float(load.sum())
    return float(load[was].sum()) / total if total > 0.0 else 0.0
