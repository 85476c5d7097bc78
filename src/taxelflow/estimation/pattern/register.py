"""One scan on a known pattern: the state that fits best, by damped Gauss-Newton steps with outliers held down."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.estimation.pattern.spline import GAIN, SIZE, STATE, THETA, X, Y, seen

if TYPE_CHECKING:
    from taxelflow.messages import Floats

_ENOUGH = 1e-2
"""A step that lowers chi-square by less is the last, and not looked at: it is a tenth of a standard deviation, and what
it leaves a hundredth of that or so."""
HELD = 1e12
"""Stiffness of a part of the state that stays where its prior is."""
_LEAST_GAIN = 0.1
"""A gain falls at most to this share in one step."""
_MOST_ODDS = 1e100
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-4, 1e-7, 1e4


@kernel
def solve_small(a: Floats, b: Floats, n: int) -> bool:
    """Solve a x = b for symmetric positive a (n, n) in place: a becomes its factor, b the solution."""
    if not factor_small(a, n):
        return False
    solve_factored(a, b, n)
    return True


@kernel
def factor_small(a: Floats, n: int) -> bool:
    """Make symmetric a (n, n) its factor L D L^T, from its lower half; False if it is not positive."""
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
    return True


@kernel
def solve_factored(a: Floats, b: Floats, n: int) -> None:
    """Make b (n,) the solution of a x = b, with a from `factor_small`."""
    for i in range(n):
        for k in range(i):
            b[i] -= a[i, k] * b[k]
    for i in range(n):
        b[i] /= a[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= a[k, i] * b[k]


@kernel
def register(  # noqa: PLR0912, PLR0915  one loop, as a kernel must be
    c: Floats,
    doubt: Floats,
    lattice: Floats,
    places: Floats,
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
) -> tuple[float, float, int]:
    """Refine state (5,) so that the pattern explains one scan; information (5, 5) becomes J^T W J with the prior.

    reading, variance, ceiling: (taxels,), noise squared, 0 where a taxel is masked or silent; a saturated reading
    counts only as far as the model lies below it. doubt: (ny, nx) variance of the pattern, or (0, 0). rough: error of
    the pattern relative to it. prior, stiffness: (5,) where the state is thought to be, and how firmly, 1 / variance;
    from `HELD` on it stays there. The pattern is taken at each taxel's middle. Returns the cost (robust -2 log
    likelihood with prior: where a pattern is in doubt, it explains everything, and so little), chi-square, and how many
    taxels it is over.
    """
    h, left, low = lattice
    left, low = left / h, low / h
    turns, grows = stiffness[THETA] < HELD, stiffness[SIZE] < HELD
    if not turns:
        state[THETA] = prior[THETA]
    if not grows:
        state[SIZE] = prior[SIZE]
    damping, best, best_chi, count = _FIRST_DAMPING, np.inf, 0.0, 0
    room = np.zeros((14, STATE))  # at once, because memory takes time
    normal, matrix = room[:STATE], room[STATE : 2 * STATE]
    right, best_right, step, kept = room[10], room[11], room[12], room[13]
    kept[:] = state
    for _ in range(iterations):
        gain = state[GAIN]
        scale = np.exp(-state[SIZE]) / h
        cos, sin = scale * np.cos(state[THETA]), scale * np.sin(state[THETA])
        cost = chi = 0.0
        used, odds = 0, 1.0
        xx = xy = yy = xg = yg = gg = xr = yr = gr = 0.0
        tx = ty = tg = tt = tr = sx = sy = sg = st = ss = sr = 0.0
        for i in range(len(reading)):
            if variance[i] == 0.0:
                continue
            dx, dy = places[0, i] - state[X], places[1, i] - state[Y]
            if bend.shape[1]:
                dx -= bend[0, i]
                dy -= bend[1, i]
                cos, sin = scale * np.cos(state[THETA] + bend[2, i]), scale * np.sin(state[THETA] + bend[2, i])
            q, jx, jy, jt, js = seen(c, left, low, cos, sin, dx, dy)
            if np.isnan(q):
                z2 = reading[i] * reading[i] / variance[i]
                if z2 > 9.0:  # a load off the lattice: not explained
                    chi += min(z2, 25.0)
                    used += 1
                    cost += 2.0 * huber * np.sqrt(z2) - huber * huber if z2 > huber * huber else z2
                continue
            model = gain * q
            if reading[i] == 0.0 and model <= 0.0:  # the sensor clips there
                continue
            residual = reading[i] - model
            if reading[i] >= ceiling[i] and residual < 0.0:
                continue
            own = rough * max(model, 0.0)
            v = variance[i] + own * own
            if len(doubt):
                ix, iy = int(cos * dx + sin * dy - left + 0.5), int(cos * dy - sin * dx - low + 0.5)
                v += gain * gain * doubt[iy, ix]
            odds *= v / variance[i]
            if odds > _MOST_ODDS:
                cost += np.log(odds)
                odds = 1.0
            w = 1.0 / v
            z2 = residual * residual * w
            chi += z2
            used += 1
            if z2 > huber * huber:
                z = np.sqrt(z2)
                cost += 2.0 * huber * z - huber * huber
                w *= huber / z
            else:
                cost += z2
            jx *= gain
            jy *= gain
            wx, wy, wg = w * jx, w * jy, w * q
            xx += wx * jx
            xy += wx * jy
            yy += wy * jy
            xg += wx * q
            yg += wy * q
            gg += wg * q
            xr += wx * residual
            yr += wy * residual
            gr += wg * residual
            if turns:
                jt *= gain
                wt = w * jt
                tx += wx * jt
                ty += wy * jt
                tg += wg * jt
                tt += wt * jt
                tr += wt * residual
                if grows:
                    st += wt * gain * js
            if grows:
                js *= gain
                sx += wx * js
                sy += wy * js
                sg += wg * js
                ss += w * js * js
                sr += w * js * residual
        normal[X, X], normal[Y, X], normal[Y, Y] = xx, xy, yy
        normal[THETA, X], normal[THETA, Y], normal[THETA, THETA] = tx, ty, tt
        normal[GAIN, X], normal[GAIN, Y], normal[GAIN, THETA], normal[GAIN, GAIN] = xg, yg, tg, gg
        normal[SIZE, X], normal[SIZE, Y], normal[SIZE, THETA], normal[SIZE, GAIN], normal[SIZE, SIZE] = (
            sx,
            sy,
            st,
            sg,
            ss,
        )
        right[X], right[Y], right[THETA], right[GAIN], right[SIZE] = xr, yr, tr, gr, sr
        cost += np.log(odds)
        for a in range(STATE):
            off = state[a] - prior[a]
            cost += stiffness[a] * off * off
            right[a] -= stiffness[a] * off
            normal[a, a] += stiffness[a]
        if cost <= best:
            gained = best - cost
            best, best_chi, count = cost, chi, used
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
        lowered = 0.0
        for a in range(STATE):
            lowered += step[a] * best_right[a]
            state[a] = kept[a] + step[a]
        state[GAIN] = max(state[GAIN], _LEAST_GAIN * kept[GAIN])  # pressure does not pull
        if lowered < _ENOUGH:
            best -= lowered
            kept[:] = state
            break
    state[:] = kept
    for a in range(STATE):
        for b in range(a):
            information[b, a] = information[a, b]
    return best, best_chi, count
