"""One scan registered on the one before, and what the noise of both makes of the answer.

The later scan is y1_i = g q(R(-theta) (r_i - x)) + n1_i with q the spline through the earlier one, q = q_true + A n0.
To first order an error of the state is  e = G n1 - G' n0,  G = H^-1 J^T W,  G' = g G A,  so its covariance is the sum
of both scans' parts. H is J^T W J less what noise in the slopes of q adds to it (errors in variables).

In a sum of steps a scan's noise comes in once with each sign: e_k = G_k n_k + (G_k-1 - G'_k) n_k-1 + ..., so that the
error of a pose hardly grows while the pattern stays where it is. It is summed up that way, counted from an ideal first
pose, as good as one scan can tell.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.estimation.scan_matching.interpolant import SLOPE_NOISE, VALUE_NOISE
from taxelflow.estimation.template.levenberg_marquardt import register
from taxelflow.numerics.banded import solve_band
from taxelflow.numerics.bspline import GAIN, STATE, THETA, X, Y, evaluate, gather, spread
from taxelflow.numerics.robust import OUTLIER, huber_weight
from taxelflow.numerics.small_linalg import solve_small

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats

DOF = 4
"""Of a state: x, y, theta, gain."""
_ITERATIONS = 20
_HUBER = 5.0
_FAR = 1e-6
_LOOSE_TURN, _LOOSE_GAIN = 1.0, 1e-2
_HELD = 1e12
"""How firmly a state is held to no motion, 1 / pitch^2, 1 / rad^2 and 1: only where nothing else tells it."""
_BOX = 1.5
"""Taxels within so many pitches of the loaded ones take part ..."""
_LOADED = 4.0
"""... which stand above so many standard deviations."""
_FITS = 1.5
"""Chi-square per reading at which no other start is tried."""
_MODEL_ERROR = 0.05
"""A scan fits if its residuals are explained by noise and by an error of the pattern of this share."""


@kernel
def surroundings(
    before: Floats, now: Floats, variance_before: Floats, variance_now: Floats, places: Floats, chosen: Bools
) -> int:
    """Set chosen (taxels,) for those in the box around what is loaded in either scan; how many they are."""
    low_x = low_y = np.inf
    high_x = high_y = -np.inf
    for i in range(len(now)):
        loaded = now[i] > 0.0 and now[i] * now[i] > _LOADED**2 * variance_now[i] > 0.0
        loaded |= before[i] > 0.0 and before[i] * before[i] > _LOADED**2 * variance_before[i] > 0.0
        if loaded:
            low_x, high_x = min(low_x, places[0, i]), max(high_x, places[0, i])
            low_y, high_y = min(low_y, places[1, i]), max(high_y, places[1, i])
    count = 0
    for i in range(len(now)):
        x, y = places[0, i], places[1, i]
        chosen[i] = variance_now[i] > 0.0 and low_x - _BOX <= x <= high_x + _BOX and low_y - _BOX <= y <= high_y + _BOX
        count += chosen[i]
    return count


@kernel
def find(
    c: Floats,
    doubt: Floats,
    lattice: Floats,
    places: Floats,
    reading: Floats,
    variance: Floats,
    ceiling: Floats,
    shift: Floats,
    gain: float,
    turns: bool,
    across: Floats,
    state: Floats,
) -> None:
    """Fill state (5,) with the motion since the spline's scan; tried from none, and from the centroid's, shift (2,).

    across: (2,), see `Interpolant`.
    """
    no_bend = np.zeros((3, 0))
    prior = np.array([0.0, 0.0, 0.0, gain, 0.0])
    stiffness = np.array([_FAR, _FAR, _LOOSE_TURN if turns else _HELD, _LOOSE_GAIN / gain**2, _HELD])
    for a in range(2):
        if across[a] > 0.0:
            stiffness[a] = _HELD
    information = np.zeros((STATE, STATE))
    trial, best = np.empty(STATE), np.inf
    for start in range(2):
        trial[:] = prior
        trial[X], trial[Y] = start * shift[0], start * shift[1]
        cost, chi, count = register(
            c,
            doubt,
            lattice,
            places,
            no_bend,
            reading,
            variance,
            ceiling,
            0.0,
            _HUBER,
            prior,
            stiffness,
            _ITERATIONS,
            trial,
            information,
        )
        if cost < best - 1e-3:
            best = cost
            state[:] = trial
        if chi <= _FITS * count:
            break


@kernel
def weigh(
    c: Floats,
    noise_doubt: Floats,
    blind: Bools,
    across: Floats,
    lattice: Floats,
    places: Floats,
    reading: Floats,
    variance: Floats,
    ceiling: Floats,
    state: Floats,
    model: Floats,
    jacobian: Floats,
    weight: Floats,
    normal: Floats,
    pretended: Floats,
) -> tuple[float, float, float]:
    """Fill model (taxels,), jacobian (taxels, 4), weight (taxels,), J^T W J and what noise makes of it, both (4, 4).

    Arguments as for `register`; noise_doubt, blind, across: see `Interpolant`. Returns chi-square by noise, chi-square
    that allows for an error of the pattern, and degrees of freedom.
    """
    slopes = np.empty((len(reading), 5))
    evaluate(c, lattice, places, state, np.zeros((1, 2)), np.zeros((3, 0)), slopes)
    normal[:] = 0.0
    pretended[:] = 0.0
    chi = fit = count = 0.0
    gain = state[GAIN]
    n = np.zeros((DOF, DOF))
    for i in range(len(reading)):
        weight[i] = 0.0
        q = slopes[i, 0]
        model[i] = gain * q if q == q else 0.0  # noqa: PLR0124  NaN alone differs from itself
        if np.isnan(q) or variance[i] == 0.0:
            continue
        dx, dy = places[0, i] - state[X], places[1, i] - state[Y]
        cos, sin = np.cos(state[THETA]), np.sin(state[THETA])
        ix = int(np.round((cos * dx + sin * dy - lattice[1]) / lattice[0]))
        iy = int(np.round((cos * dy - sin * dx - lattice[2]) / lattice[0]))
        if blind[iy, ix] or (reading[i] == 0.0 and model[i] <= 0.0):
            continue
        residual = reading[i] - model[i]
        if reading[i] >= ceiling[i] and residual < 0.0:
            continue
        doubt = noise_doubt[iy, ix]
        w = 1.0 / (variance[i] + gain * gain * doubt)
        z2 = residual * residual * w
        chi += min(z2, OUTLIER)
        fit += min(residual * residual / (1.0 / w + (_MODEL_ERROR * model[i]) ** 2), OUTLIER)
        count += 1.0
        w *= huber_weight(np.sqrt(z2), _HUBER)
        weight[i] = w
        for a in range(THETA + 1):
            jacobian[i, a] = 0.0 if a < 2 and across[a] > 0.0 else gain * slopes[i, a + 1]
        jacobian[i, GAIN] = q
        noise = w * SLOPE_NOISE / VALUE_NOISE * doubt * gain * gain
        n[X, X] += noise
        n[X, THETA] -= noise * dy
        n[Y, THETA] += noise * dx
        n[THETA, THETA] += noise * (dx * dx + dy * dy)
        n[GAIN, GAIN] += w * doubt
        for a in range(DOF):
            for b in range(a + 1):
                normal[a, b] += w * jacobian[i, a] * jacobian[i, b]
    n[Y, Y] = n[X, X]
    for a in range(DOF):
        for b in range(a):
            normal[b, a] = normal[a, b]
            n[a, b] = n[b, a]
    pretended[:] = n
    return chi, fit, max(count - DOF, 1.0)


@kernel
def sight(normal: Floats, pretended: Floats) -> float:
    """How many times better the pattern tells a turn than its own noise would pretend to; 0 if not at all."""
    unit, matrix = np.zeros(DOF), normal.copy()
    unit[THETA] = 1.0
    if not solve_small(matrix, unit, DOF) or not pretended[X, X] > 0.0:
        return 0.0
    x, y = pretended[X, THETA] / pretended[X, X], pretended[Y, THETA] / pretended[X, X]
    noise = pretended[THETA, THETA] - (x * x + y * y) * pretended[X, X]
    return 1.0 / (unit[THETA] * noise) if noise > 0.0 else np.inf


@kernel
def gains(normal: Floats, pretended: Floats, jacobian: Floats, weight: Floats, turns: bool, out: Floats) -> None:
    """Fill out (3, taxels) with G: pose error per reading's error. Zero for a turn that is not seen."""
    h = normal.copy()
    shrink = np.empty(DOF)
    for a in range(DOF):
        real = max(normal[a, a] - pretended[a, a], 0.5 * normal[a, a])
        shrink[a] = np.sqrt(real / normal[a, a]) if normal[a, a] > 0.0 else 1.0
    for a in range(DOF):
        for b in range(DOF):
            h[a, b] *= shrink[a] * shrink[b]
            if not turns and a != b and THETA in (a, b):
                h[a, b] = 0.0
        h[a, a] += _FAR
    inverse, column = np.empty((DOF, DOF)), np.empty(DOF)
    for a in range(DOF):
        column[:] = 0.0
        column[a] = 1.0
        matrix = h.copy()
        solve_small(matrix, column, DOF)
        inverse[:, a] = column
    for i in range(len(weight)):
        for a in range(THETA + 1):
            total = 0.0
            for b in range(DOF):
                total += inverse[a, b] * jacobian[i, b]
            out[a, i] = total * weight[i]
        if not turns:
            out[THETA, i] = 0.0


@kernel
def carried(
    shape: tuple[int, int],
    lattice: Floats,
    places: Floats,
    state: Floats,
    g: Floats,
    first: NDArray[np.int64],
    weight: Floats,
    factor: Floats,
    trust: Floats,
    out: Floats,
) -> None:
    """Fill out (3, all taxels) with G' = g G A from G = g (3, taxels); first ... trust as in `Interpolant`."""
    seen = places.shape[1]
    start, share = np.empty(seen, np.int64), np.empty((seen, 16))
    spread(shape, lattice, places, state, np.zeros((1, 2)), np.zeros((3, 0)), 4, start, share)
    knots = np.zeros((3, shape[0] * shape[1]))
    gather(start, share, state[GAIN] * g, shape[1], knots)
    solve_band(factor, knots)
    out[:] = 0.0
    for i in range(len(first)):
        if first[i] >= 0 and trust[i] > 0.0:
            for a in range(4):
                for b in range(4):
                    w = trust[i] * weight[i, 4 * a + b]
                    for row in range(3):
                        out[row, i] += w * knots[row, first[i] + a * shape[1] + b]
