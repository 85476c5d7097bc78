"""One scan on a known pattern: the state that fits best, by damped Gauss-Newton steps with outliers held down."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.estimation.pattern.spline import GAIN, STATE, evaluate

if TYPE_CHECKING:
    from taxelflow.messages import Floats

_ENOUGH = 1e-3
"""A step that lowers chi-square by less is the last."""
_LEAST_GAIN = 0.1
"""A gain falls at most to this share in one step."""
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-4, 1e-7, 1e4


@kernel
def solve_small(a: Floats, b: Floats, n: int) -> bool:
    """Solve a x = b for symmetric positive a (n, n) in place: a becomes its factor, b the solution."""
    for j in range(n):
        d = a[j, j]
        for k in range(j):
            d -= a[j, k] * a[j, k] * a[k, k]
        if not d > 0.0:
            return False
        a[j, j] = d
        for i in range(j + 1, n):
            v = a[i, j]
            for k in range(j):
                v -= a[i, k] * a[j, k] * a[k, k]
            a[i, j] = v / d
    for i in range(n):
        for k in range(i):
            b[i] -= a[i, k] * b[k]
    for i in range(n):
        b[i] /= a[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= a[k, i] * b[k]
    return True


@kernel
def register(  # noqa: PLR0912, PLR0915  one loop, as a kernel must be
    c: Floats,
    doubt: Floats,
    lattice: Floats,
    places: Floats,
    points: Floats,
    bend: Floats,
    reading: Floats,
    variance: Floats,
    ceiling: Floats,
    rough: float,
    huber: float,
    prior: Floats,
    stiffness: Floats,
    iterations: int,
    state: Floats,
    information: Floats,
    scratch: Floats,
) -> tuple[float, float, int]:
    """Refine state (5,) so that the pattern explains one scan; information (5, 5) becomes J^T W J with the prior.

    reading, variance, ceiling: (taxels,), noise squared, 0 where a taxel is masked or silent; a saturated reading
    counts only as far as the model lies below it. doubt: (ny, nx) variance of the pattern. rough: error of the pattern
    relative to it. prior, stiffness: (5,) where the state is thought to be, and how firmly, 1 / variance. scratch:
    (taxels, 6). Returns the cost (robust chi-square with prior), chi-square, and how many taxels it is over.
    """
    damping, best, best_chi, count = _FIRST_DAMPING, np.inf, 0.0, 0
    kept = state.copy()
    normal, right, best_right = np.zeros((STATE, STATE)), np.zeros(STATE), np.zeros(STATE)
    jacobian = np.zeros(STATE)
    matrix, step = np.zeros((STATE, STATE)), np.zeros(STATE)
    for _ in range(iterations):
        evaluate(c, lattice, places, state, points, bend, scratch)
        normal[:] = 0.0
        right[:] = 0.0
        cost = chi = 0.0
        seen = 0
        gain = state[GAIN]
        for i in range(len(reading)):
            if variance[i] == 0.0:
                continue
            q = scratch[i, 0]
            if np.isnan(q):
                if reading[i] * reading[i] > 9.0 * variance[i]:  # a load off the lattice: not explained
                    z = abs(reading[i]) / np.sqrt(variance[i])
                    chi += min(z * z, 25.0)
                    seen += 1
                    cost += 2.0 * huber * z - huber * huber if z > huber else z * z
                continue
            model = gain * q
            if reading[i] == 0.0 and model <= 0.0:  # the sensor clips there
                continue
            residual = reading[i] - model
            if reading[i] >= ceiling[i] and residual < 0.0:
                continue
            own = rough * max(model, 0.0)
            w = 1.0 / (variance[i] + own * own + gain * gain * nearest(doubt, lattice, places, state, bend, i))
            z = abs(residual) * np.sqrt(w)
            chi += z * z
            seen += 1
            if z > huber:
                cost += 2.0 * huber * z - huber * huber
                w *= huber / z
            else:
                cost += z * z
            jacobian[0] = gain * scratch[i, 1]
            jacobian[1] = gain * scratch[i, 2]
            jacobian[2] = gain * scratch[i, 3]
            jacobian[3] = q
            jacobian[4] = gain * scratch[i, 4]
            for a in range(STATE):
                wa = w * jacobian[a]
                right[a] += wa * residual
                for b in range(a + 1):
                    normal[a, b] += wa * jacobian[b]
        for a in range(STATE):
            off = state[a] - prior[a]
            cost += stiffness[a] * off * off
            right[a] -= stiffness[a] * off
            normal[a, a] += stiffness[a]
        if cost <= best:
            gained = best - cost
            best, best_chi, count = cost, chi, seen
            kept[:] = state
            information[:] = normal
            best_right[:] = right
            damping = max(damping * 0.2, _LEAST_DAMPING)
            if gained < _ENOUGH:
                break
        else:
            damping = max(damping * 20.0, 1e-3)
            if damping > _MOST_DAMPING:
                break
        matrix[:] = information
        step[:] = best_right
        for a in range(STATE):
            matrix[a, a] += damping * information[a, a] + 1e-12
        if not solve_small(matrix, step, STATE):
            break
        state[:] = kept + step
        state[GAIN] = max(state[GAIN], _LEAST_GAIN * kept[GAIN])  # pressure does not pull
    state[:] = kept
    for a in range(STATE):
        for b in range(a):
            information[b, a] = information[a, b]
    return best, best_chi, count


@kernel
def nearest(grid: Floats, lattice: Floats, places: Floats, state: Floats, bend: Floats, i: int) -> float:
    """Value of grid (ny, nx) at the knot nearest to taxel i; 0 for an empty grid."""
    if grid.shape[0] == 0:
        return 0.0
    dx, dy = places[0, i] - state[0], places[1, i] - state[1]
    if bend.shape[1]:
        dx -= bend[0, i]
        dy -= bend[1, i]
    cos, sin = np.cos(state[2]), np.sin(state[2])
    ix = int(np.round((cos * dx + sin * dy - lattice[1]) / lattice[0]))
    iy = int(np.round((cos * dy - sin * dx - lattice[2]) / lattice[0]))
    value: float = grid[min(max(iy, 0), grid.shape[0] - 1), min(max(ix, 0), grid.shape[1] - 1)]
    return value
