"""Covariance of a registration by the noise of both scans, and observability of the rotation.

With q = q_true + A n0 the error of the state is, to first order,  e = G n1 - G' n0,  G = H^-1 J^T W,  G' = g G A,  so
its covariance is the sum of both scans' parts. H is J^T W J less what noise in the slopes of q adds to it (errors in
variables).
"""

from __future__ import annotations

import numpy as np

from taxelflow.estimation.scan_matching.interpolant import SPLINE_NOISE, Interpolant
from taxelflow.estimation.scan_matching.matching import DOF, Fit, Points
from taxelflow.estimation.template.levenberg_marquardt import FREE
from taxelflow.messages import Floats
from taxelflow.numerics.banded import solve_band
from taxelflow.numerics.bspline import gather, spread, state_of
from taxelflow.numerics.rounding import BLURRED
from taxelflow.numerics.small_linalg import eigenvalues2, solve_small
from taxelflow.runtime.compiling import inlined, routine

_LEAST_SHARE = 0.5
"""Noise is held responsible for at most this share of the information."""
_MOST_HIDDEN = 0.9
"""Largest share of a motion that errors of readings hide: the pattern has slopes of its own."""


@routine
def turn_observability(fit: Fit) -> float:
    """Information on the turn over what the surface's noise alone would add to it; 0 if there is none."""
    turn, matrix = np.array([0.0, 0.0, 1.0, 0.0]), fit.normal.copy()
    shift, (by_x, by_y, by_turn, _) = fit.noise_normal[0, 0], fit.noise_normal[2]
    if not solve_small(matrix, turn, DOF) or not shift > 0.0:
        return 0.0
    x, y = by_x / shift, by_y / shift
    noise = by_turn - (x * x + y * y) * shift
    return 1.0 / (turn[2] * noise) if noise > 0.0 else np.inf


@routine
def gains(fit: Fit, turns: bool, out: Floats) -> None:
    """Fill out (3, n) with G: pose error per reading's error. Zero for a turn that is not observable."""
    h = fit.normal.copy()
    shrink = np.empty(DOF)
    for a in range(DOF):
        real = max(h[a, a] - fit.noise_normal[a, a], _LEAST_SHARE * h[a, a])
        shrink[a] = np.sqrt(real / h[a, a]) if h[a, a] > 0.0 else 1.0
    for a in range(DOF):
        for b in range(DOF):
            h[a, b] *= shrink[a] * shrink[b]
            if not turns and a != b and 2 in (a, b):  # the turn
                h[a, b] = 0.0
        h[a, a] += FREE  # it has an inverse where nothing determines a state
    columns = np.zeros((DOF, DOF))  # of the inverse
    for a in range(DOF):
        columns[a, a] = 1.0
        matrix = h.copy()
        solve_small(matrix, columns[a], DOF)
    for i in range(len(fit.weight)):
        for a in range(3):
            total = 0.0
            for b in range(DOF):
                total += columns[b, a] * fit.jacobian[i, b]
            out[a, i] = total * fit.weight[i]
        if not turns:
            out[2, i] = 0.0


@routine
def earlier_gains(spline: Interpolant, lattice: Floats, points: Points, state: Floats, g: Floats, out: Floats) -> None:
    """Fill out (3, taxels), which comes in as 0, with G' = g G A from G = g (3, n).

    It is the pose error per error of the earlier scan's readings.

    lattice: that of the surface, see `Surface`.
    """
    count, (ny, nx) = points.places.shape[1], spline.shape
    start, share = np.empty(count, np.int64), np.empty((count, 16))
    spread(spline.shape, lattice, points.places, state, np.zeros((3, 0)), start, share)
    knots = np.zeros((3, ny * nx))
    gather(start, share, state_of(state).gain * g, nx, knots)
    solve_band(spline.factor, knots)
    for i in range(len(spline.first)):
        if spline.first[i] >= 0 and spline.trust[i] > 0.0:
            for row in range(3):
                out[row, i] = spline.trust[i] * _spread_back(spline.first[i], spline.weight[i], nx, knots[row])


@inlined
def _spread_back(first: int, weight: Floats, nx: int, knots: Floats) -> float:
    """The value that a taxel, by its weight (16,), reads of knots (knots,)."""
    total = 0.0
    for a in range(4):
        for b in range(4):
            total += weight[4 * a + b] * knots[first + a * nx + b]
    return total


@routine
def turn_variance(g: Floats, points: Points) -> float:
    """Variance of the turn by the later scan's noise, rad^2."""
    total, turn = 0.0, g[2]
    for j in range(len(points.reading)):
        if points.reading[j] != 0.0:
            total += turn[j] * turn[j] * points.variance[j]
    return total


@routine
def covariance(g: Floats, points: Points, excess: float) -> Floats:
    """(3, 3), the later scan's part of the covariance, G N1 G^T; a reading of 0 has no noise.

    excess: chi-square per reading, at least 1: what noise does not explain of a scan counts as more noise, also in g.
    """
    part, factor = np.zeros((3, 3)), np.sqrt(excess)
    for j in range(len(points.reading)):
        for a in range(3):
            g[a, j] *= factor
    for j in range(len(points.reading)):
        variance = points.variance[j] if points.reading[j] != 0.0 else 0.0
        for a in range(3):
            for b in range(3):
                part[a, b] += g[a, j] * g[b, j] * variance
    return part


@routine
def hidden_shares(fit: Fit, points: Points, share: float) -> Floats:
    """(3,), what errors of readings by a share of each hide of a step along x, y and theta, over the step.

    Errors that stay with the taxels, such as gains and detail finer than a pitch, are a pattern that does not move. Its
    slopes add to J^T W J, but hardly to J^T W y: the step is too small by their share (errors in variables).
    """
    still, turned, out = 0.0, 0.0, np.empty(3)
    at = state_of(fit.state)
    for i in range(len(points.reading)):
        error = SPLINE_NOISE.slope * fit.weight[i] * (share * points.reading[i]) ** 2
        dx, dy = points.places[0, i] - at.x, points.places[1, i] - at.y
        still += error
        turned += error * (dx * dx + dy * dy)
    for a in range(3):
        own, whole = turned if a == 2 else still, fit.normal[a, a]
        held = min(own / whole, _MOST_HIDDEN) if whole > 0.0 else 0.0
        out[a] = held / (1.0 - held)
    return out


@routine
def drift(g: Floats, points: Points, share: float, state: Floats, total: Floats) -> None:
    """Add to the pose's covariance, total (3, 3), what errors of readings by a share of each do to a step.

    They are others after a pitch, or a turn by a pitch at the contact's edge: over a step d, errors with the
    correlation exp(-d) leave 2 (1 - exp(-d)) of their variance.
    """
    at, reach = state_of(state), 0.0
    for j in range(len(points.reading)):
        reach = max(reach, np.hypot(points.places[0, j] - at.x, points.places[1, j] - at.y))
    fresh = 2.0 * (1.0 - np.exp(-np.hypot(np.hypot(at.x, at.y), reach * at.theta)))
    for j in range(len(points.reading)):
        variance = fresh * (share * points.reading[j]) ** 2
        for a in range(3):
            for b in range(3):
                total[a, b] += g[a, j] * g[b, j] * variance


@routine
def is_blurred(covariance: Floats) -> bool:
    """Whether a scan alone does not determine a place along some direction."""
    return bool(eigenvalues2(covariance[0, 0], covariance[1, 1], covariance[0, 1])[1] > BLURRED**2)


@routine
def is_anywhere(covariance: Floats, places: Floats) -> bool:
    """Whether the steps have added up to a standard deviation longer than the pad. places: (2, taxels)."""
    square = 0.0
    for i in range(places.shape[1]):
        for a in range(2):
            square = max(square, (places[a, i] - places[a, 0]) ** 2)
    return bool(eigenvalues2(covariance[0, 0], covariance[1, 1], covariance[0, 1])[1] > square)
