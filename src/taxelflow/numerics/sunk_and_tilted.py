"""What is left of a pattern if its object rests: on an elastic skin it can only sink and tilt, see `rest_or_slide`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taxelflow.messages import Bools, Floats
from taxelflow.numerics.small_linalg import mirror, solve_small
from taxelflow.runtime.compiling import lean_kernel, routine

RIDGE = 1e-6
"""Relative stiffness of what readings do not determine, as both modes of an even pressure."""
MODES = 6
"""Changes at rest, see `_modes`."""
ROUNDS = 8
"""Rounds that find which taxels are in contact, and steps of the fit of a slide."""


@routine
def squares_at_rest(
    places: Floats, before: Floats, after: Floats, chosen: NDArray[np.int64], least: float
) -> tuple[float, float]:
    """Squares that are left of a pattern (taxels,), on the chosen taxels, if its object has only sunk and tilted; and
    their degrees of freedom.

    Where the contact has ended, or begun by less than the plane allows, a taxel contradicts nothing, and fits nothing.
    """
    modes, was = _modes(places, before, chosen), before[chosen] > least
    touches, model, reading = was.copy(), np.zeros(len(chosen)), after[chosen]
    normal, best = np.empty((MODES, MODES)), np.empty(MODES)
    pressed = np.count_nonzero(was)
    least_left, fitted = _left(reading, model, was, least, pressed), np.count_nonzero(was)
    for _ in range(ROUNDS if pressed > 0 else 0):
        if not _fit_modes(modes, reading, touches, normal, best):
            break
        for k in range(len(chosen)):
            model[k] = 0.0
            for a in range(MODES):
                model[k] += modes[k, a] * best[a]
        left = _left(reading, model, was, least, pressed)
        if left < least_left:  # contacts may come and go in turn
            least_left, fitted = left, np.count_nonzero(touches)
        changed = False
        for k in range(len(chosen)):
            loaded = reading[k] > least
            now = (model[k] > 0.0 or loaded) if was[k] else (reading[k] > model[k] and loaded)
            changed |= now != touches[k]
            touches[k] = now
        if not changed:
            break
    return least_left, freedom(fitted, MODES)


@lean_kernel
def _left(reading: Floats, model: Floats, was: Bools, least: float, pressed: np.integer) -> float:
    """Squares that a model (chosen,) leaves of readings. was: (chosen,), loaded before, pressed of them."""
    left = 0.0
    for k in range(len(reading)):
        error = reading[k] - max(model[k], 0.0)
        if was[k] or pressed == 0 or (reading[k] > least and error > 0.0):
            left += error * error
    return left


@lean_kernel
def freedom(readings: np.integer | int, unknowns: int) -> float:
    """Degrees of freedom of a fit; half of one where it has none, and decides nothing."""
    return float(max(readings - unknowns, 0.5))


@routine
def _modes(places: Floats, before: Floats, chosen: NDArray[np.int64]) -> Floats:
    """(chosen, 6), changes at rest: the pressure before, and 1, each times 1, x and y about its centre."""
    modes, centre = np.empty((len(chosen), MODES)), np.zeros(2)
    own = before[chosen]
    find_centre(places[:, chosen], own, centre)
    squares = 0.0
    for k in range(len(chosen)):
        x, y = places[0, chosen[k]] - centre[0], places[1, chosen[k]] - centre[1]
        modes[k, 3], modes[k, 4], modes[k, 5] = 1.0, x, y
        squares += x * x + y * y
    unit = max(np.sqrt(squares / max(len(chosen), 1)), RIDGE)
    for k in range(len(chosen)):
        modes[k, 4] /= unit
        modes[k, 5] /= unit
        for a in range(3):
            modes[k, a] = max(own[k], 0.0) * modes[k, 3 + a]
    return modes


@routine
def _fit_modes(modes: Floats, reading: Floats, used: Bools, normal: Floats, best: Floats) -> bool:
    """Fill best (6,) with the modes that explain readings (chosen,) where they are used; False if none is."""
    taxels = np.flatnonzero(used)
    if len(taxels) == 0:
        return False
    normal[:], best[:] = 0.0, 0.0
    for k in taxels:
        for a in range(MODES):
            best[a] += modes[k, a] * reading[k]
            for b in range(a + 1):
                normal[a, b] += modes[k, a] * modes[k, b]
    mirror(normal)
    scale = np.sqrt(np.diag(normal))
    scale[scale == 0.0] = 1.0
    for a in range(MODES):
        best[a] /= scale[a]
        for b in range(MODES):
            normal[a, b] /= scale[a] * scale[b]
        normal[a, a] += RIDGE
    if not solve_small(normal, best, MODES):
        return False
    best /= scale
    return True


@lean_kernel
def find_centre(places: Floats, pressure: Floats, centre: Floats) -> None:
    """Fill centre (2,) of a pattern (taxels,) of taxels at places (2, taxels)."""
    largest, total = 0.0, 0.0
    for i in range(len(pressure)):
        largest = max(largest, pressure[i])
    for i in range(len(pressure)):
        weight = max(pressure[i], 0.0) + RIDGE * largest
        total += weight
        centre[0] += weight * places[0, i]
        centre[1] += weight * places[1, i]
    if total > 0.0:
        centre[0] /= total
        centre[1] /= total
