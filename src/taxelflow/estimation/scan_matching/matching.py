"""One scan registered on the one before, whose spline is the surface.

The later scan is y1_i = g q(R(-theta) (r_i - x)) + n1_i with q the spline through the earlier one. Lengths in pitches,
places from where the object's point was in the earlier scan.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.scan_matching.interpolant import SPLINE_NOISE
from taxelflow.estimation.template.levenberg_marquardt import FREE, HELD, Prior, register
from taxelflow.estimation.template.linearization import pack_scan
from taxelflow.estimation.template.map import LATTICE
from taxelflow.estimation.template.map import Surface as Known
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.bspline import STATE, State, evaluate, put, state_of
from taxelflow.numerics.centroid import LOADED
from taxelflow.numerics.robust import CHEAPER, FITS, HUBER, OUTLIER, huber_weight
from taxelflow.numerics.se2 import rotate_back
from taxelflow.numerics.small_linalg import add_lower, mirror
from taxelflow.runtime.compiling import inlined, routine

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.estimation.scan_matching.interpolant import Interpolant
    from taxelflow.estimation.scan_matching.track import Last, Taxels

DOF = STATE - 1
"""Of a state: x, y, theta, gain; the size is held."""
_ITERATIONS = np.int64(20)  # numba compiles `register` again for each constant of Python


class _Loose(NamedTuple):
    """Prior information: enough to hold what nothing determines."""

    turn: float = 1.0
    """On no turn, 1 / rad^2."""
    gain: float = 1e-2
    """On no change of the gain."""


_LOOSE = _Loose()
_MODEL_ERROR = 0.05
"""A scan fits if its residuals are explained by noise and by an error of the surface of this share."""


class Surface(NamedTuple):
    """The earlier scan: spline coefficients c (ny, nx), their variance, for the fit and by noise alone, on a lattice.

    unobserved: (ny, nx), knots about which the earlier scan has no reading. unobservable: see `Interpolant`.
    """

    c: Floats
    variance: Floats
    noise_variance: Floats
    unobserved: Bools
    lattice: Floats
    unobservable: Floats


class Points(NamedTuple):
    """The later scan: taxels that take part (n,), their places (2, n), readings, variances and ceilings (n,)."""

    taxel: NDArray[np.int64]
    places: Floats
    reading: Floats
    variance: Floats
    ceiling: Floats


class Guess(NamedTuple):
    """Motion between the scans, as of the centroid, and ratio of their loads."""

    x: float
    y: float
    gain: float


class Fit(NamedTuple):
    """The linearised problem at a state (5,): jacobian (n, 4), weight (n,), J^T W J, and what noise in the surface's
    slopes adds to it, both (4, 4).
    """

    state: Floats
    jacobian: Floats
    weight: Floats
    normal: Floats
    noise_normal: Floats


@routine
def surroundings(
    last: Floats, now: Floats, last_variance: Floats, variance: Floats, places: Floats
) -> NDArray[np.int64]:
    """Numbers of taxels in the box around what is loaded in either scan, (taxels,) each; places: (2, taxels)."""
    low_x = low_y = np.inf
    high_x = high_y = -np.inf
    for i in range(len(now)):
        loaded = now[i] > 0.0 and now[i] * now[i] > LOADED.sigmas**2 * variance[i] > 0.0
        loaded |= last[i] > 0.0 and last[i] * last[i] > LOADED.sigmas**2 * last_variance[i] > 0.0
        if loaded:
            low_x, high_x = min(low_x, places[0, i]), max(high_x, places[0, i])
            low_y, high_y = min(low_y, places[1, i]), max(high_y, places[1, i])
    chosen, count = np.empty(len(now), np.int64), 0
    for i in range(len(now)):
        x, y = places[0, i], places[1, i]
        if (
            variance[i] > 0.0
            and low_x - LATTICE.margin <= x <= high_x + LATTICE.margin
            and low_y - LATTICE.margin <= y <= high_y + LATTICE.margin
        ):
            chosen[count] = i
            count += 1
    return chosen[:count]


@routine
def take(
    taxel: NDArray[np.int64], now: Floats, variance: Floats, ceiling: Floats, places: Floats, origin: Floats
) -> Points:
    """Some taxels of a scan (taxels,), by number, with places from the origin (2 or more,)."""
    count = len(taxel)
    points = Points(taxel, np.empty((2, count)), np.empty(count), np.empty(count), np.empty(count))
    for j in range(count):
        i = taxel[j]
        points.places[0, j], points.places[1, j] = places[0, i] - origin[0], places[1, i] - origin[1]
        points.reading[j], points.variance[j], points.ceiling[j] = now[i], variance[i], ceiling[i]
    return points


@routine
def surface_of(last: Last, taxels: Taxels, ceiling: Floats, spline: Interpolant, origin: Floats) -> Surface:
    """The last scan as a surface, with places from the origin (3,)."""
    lattice = spline.lattice.copy()
    lattice[1] -= origin[0]
    lattice[2] -= origin[1]
    unobserved = unobserved_knots(last, taxels, ceiling, spline)
    peak = 0.0
    for reading in last.reading:
        peak = max(peak, reading)
    variance = spline.variance.copy()
    for row in range(variance.shape[0]):
        for column in range(variance.shape[1]):
            if unobserved[row, column]:
                variance[row, column] = peak * peak
    return Surface(last.coefficients, variance, spline.variance, unobserved, lattice, spline.unobservable)


@routine
def unobserved_knots(last: Last, taxels: Taxels, ceiling: Floats, spline: Interpolant) -> Bools:
    """(ny, nx): knots at which no taxel is, or its reading was missing or saturated."""
    unobserved = spline.unobserved.copy()
    h, left, low = spline.lattice
    for i in range(len(last.reading)):
        if taxels.noise[i] > 0.0 and (last.variance[i] == 0.0 or last.reading[i] >= ceiling[i]):
            ix, iy = int(np.round((taxels.places[0, i] - left) / h)), int(np.round((taxels.places[1, i] - low) / h))
            unobserved[iy, ix] = True
    return unobserved


@routine
def find(surface: Surface, points: Points, guess: Guess, is_near: bool, turns: bool, state: Floats) -> None:
    """Fill state (5,) with the motion since the surface's scan; starts: no motion, unless the guess is near, and it."""
    mean, precision = np.empty(STATE), np.empty(STATE)
    put(State(0.0, 0.0, 0.0, guess.gain, 0.0), mean)
    loose_x = HELD if surface.unobservable[0] > 0.0 else FREE
    loose_y = HELD if surface.unobservable[1] > 0.0 else FREE
    loose_turn = _LOOSE.turn if turns else HELD
    put(State(loose_x, loose_y, loose_turn, _LOOSE.gain / guess.gain**2, HELD), precision)
    prior, known = Prior(mean, precision), Known(surface.c, surface.variance, surface.lattice)
    taxels = pack_scan(points.places, np.zeros((3, 0)), points.reading, points.variance, points.ceiling, 0.0)
    information = np.zeros((STATE, STATE))
    trial, best = np.empty(STATE), np.inf
    for start in range(1 if is_near else 0, 2):
        put(State(start * guess.x, start * guess.y, 0.0, guess.gain, 0.0), trial)
        cost, chi, count = register(known, taxels, prior, HUBER, _ITERATIONS, trial, information)
        if cost < best - CHEAPER:
            best = cost
            for a in range(STATE):
                state[a] = trial[a]
        if chi <= FITS * count:
            break


@routine
def linearize(surface: Surface, points: Points, fit: Fit) -> tuple[float, float, float]:
    """Fill all of fit but its state. Returns chi-square by noise, chi-square that allows for an error of the surface,
    and degrees of freedom.
    """
    values = np.empty((len(points.reading), 5))
    evaluate(surface.c, surface.lattice, points.places, fit.state, np.zeros((3, 0)), values)
    for a in range(DOF):
        for b in range(DOF):
            fit.normal[a, b] = fit.noise_normal[a, b] = 0.0
    chi = misfit = count = 0.0
    h, left, low = surface.lattice
    x, y, theta, gain, _ = state_of(fit.state)
    cos, sin = np.cos(theta), np.sin(theta)
    for i in range(len(points.reading)):
        fit.weight[i] = 0.0
        q = values[i, 0]
        if np.isnan(q) or points.variance[i] == 0.0:
            continue
        dx, dy = points.places[0, i] - x, points.places[1, i] - y
        u, v = rotate_back(cos, sin, dx, dy)
        ix, iy = int(np.round((u - left) / h)), int(np.round((v - low) / h))
        model = gain * q
        residual = points.reading[i] - model
        is_clipped = points.reading[i] == 0.0 and model <= 0.0
        is_saturated = points.reading[i] >= points.ceiling[i] and residual < 0.0
        if surface.unobserved[iy, ix] or is_clipped or is_saturated:
            continue
        noise_variance = surface.noise_variance[iy, ix]
        w = 1.0 / (points.variance[i] + gain * gain * noise_variance)
        z2 = residual * residual * w
        chi += min(z2, OUTLIER)
        misfit += min(residual * residual / (1.0 / w + (_MODEL_ERROR * model) ** 2), OUTLIER)
        count += 1.0
        w *= huber_weight(np.sqrt(z2), HUBER)
        fit.weight[i] = w
        for a in range(3):
            fit.jacobian[i, a] = 0.0 if a < 2 and surface.unobservable[a] > 0.0 else gain * values[i, a + 1]
        fit.jacobian[i, 3] = q
        _add_noise(w * noise_variance, gain, dx, dy, fit.noise_normal)
        _add_square(w, fit.jacobian[i], fit.normal)
    mirror(fit.normal)
    mirror(fit.noise_normal)
    return chi, misfit, max(count - DOF, 1.0)


@inlined
def _add_square(w: float, row: Floats, normal: Floats) -> None:
    """Add w row row^T to the lower half of normal (4, 4)."""
    for a in range(DOF):
        for b in range(a + 1):
            normal[a, b] += w * row[a] * row[b]


@inlined
def _add_noise(share: float, gain: float, dx: float, dy: float, normal: Floats) -> None:
    """Add to normal (4, 4), its lower half, what noise in value and slopes at (dx, dy) makes of J^T W J."""
    noise = share * gain * gain * SPLINE_NOISE.slope / SPLINE_NOISE.value
    turn = (-noise * dy, noise * dx, noise * (dx * dx + dy * dy))
    add_lower((noise, 0.0, noise, *turn, 0.0, 0.0, 0.0, share), normal, DOF)
