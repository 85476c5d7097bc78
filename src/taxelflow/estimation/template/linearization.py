"""One scan against a pattern, to first order: its chi-square at a state, and the normal equations of a step from it.

A scan's time goes here, so it is written for vector registers, eight taxels at once: one loop that only adds up,
without a branch, over arrays that are laid out for it.
"""

from __future__ import annotations

import numpy as np

from taxelflow.estimation.template.map import Surface
from taxelflow.messages import Floats
from taxelflow.numerics.bspline import GAIN, SIZE, THETA, X, Y, value_at
from taxelflow.numerics.robust import OUTLIER
from taxelflow.runtime.compiling import inlined, kernel, lean_kernel

PLACE_X, PLACE_Y, COS, SIN, READING, VARIANCE, CEILING, ROWS = range(8)
"""Rows of a scan that is laid out: places, less how far the object has come when the taxel is read; cosine and sine of
its turn by then; reading, noise and model error squared, and ceiling."""
_LANES = 8
_UNEXPLAINED = 9.0
"""Squared over the noise: what makes a reading off the lattice a load that is not explained. It counts as outlier."""


@kernel
def laid_out(places: Floats, bend: Floats, reading: Floats, variance: Floats, ceiling: Floats, error: float) -> Floats:
    """Scan as (ROWS, taxels), filled up with taxels that are masked. bend: (3, taxels) or (3, 0), see `evaluate`.

    error: standard deviation of what the model leaves of each reading beside noise.
    """
    count = len(reading)
    taxels = np.empty((ROWS, (count + _LANES - 1) // _LANES * _LANES))
    for i in range(count):
        taxels[PLACE_X, i], taxels[PLACE_Y, i] = places[0, i], places[1, i]
        taxels[READING, i], taxels[CEILING, i] = reading[i], ceiling[i]
        taxels[VARIANCE, i] = variance[i] + error * error if variance[i] != 0.0 else 0.0
    for i in range(count, taxels.shape[1]):
        for row in range(ROWS):
            taxels[row, i] = 0.0
    taxels[COS], taxels[SIN] = 1.0, 0.0
    for i in range(bend.shape[1]):
        taxels[PLACE_X, i] -= bend[0, i]
        taxels[PLACE_Y, i] -= bend[1, i]
        taxels[COS, i], taxels[SIN, i] = np.cos(bend[2, i]), np.sin(bend[2, i])
    return taxels


@inlined
def pressure_at(c: Floats, x: float, y: float) -> tuple[float, float, float]:
    """`value_at`, level at 0 where the spline is below: pressure does not pull, but noise may make it seem to."""
    q, qu, qw = value_at(c, x, y)
    pulls = q < 0.0
    return 0.0 if pulls else q, 0.0 if pulls else qu, 0.0 if pulls else qw


@inlined
def nearest(grid: Floats, x: float, y: float) -> float:
    """Value of grid (ny, nx) at the knot nearest to a place counted in knots, which lies on the lattice."""
    value: float = grid[np.uint64(int(y + 0.5)), np.uint64(int(x + 0.5))]
    return value


@inlined
def _log_inverse(share: float) -> float:
    """About log(1 / share): what it costs that noise is only this share of the variance."""
    root = np.sqrt(np.sqrt(share))
    logarithm: float = 2.0 * (1.0 / root - root)
    return logarithm


@lean_kernel
def linearise(  # noqa: PLR0915  one loop, as vector registers need it
    surface: Surface, taxels: Floats, huber: float, state: Floats, normal: Floats, right: Floats
) -> tuple[float, float, int]:
    """Fill normal (5, 5), its lower half, with J^T W J, right (5,) with J^T W (y - model) at a state (5,).

    taxels: from `laid_out`. Others, and what is returned, as for `register`, but without the prior. The cost tells
    which state is better; W holds the doubt even where it is not what explains a reading.
    """
    c, doubt = surface.c, surface.doubt
    h, left, low = surface.lattice
    left, low = left / h, low / h
    x, y, gain = state[X], state[Y], state[GAIN]
    scale = np.exp(-state[SIZE]) / h
    cos_0, sin_0 = scale * np.cos(state[THETA]), scale * np.sin(state[THETA])
    certain = len(doubt) == 0
    cost = chi = used = 0.0
    xx = xy = yy = xg = yg = gg = xr = yr = gr = 0.0
    tx = ty = tg = tt = tr = sx = sy = sg = st = ss = sr = 0.0
    for i in range(taxels.shape[1]):
        cos = cos_0 * taxels[COS, i] - sin_0 * taxels[SIN, i]
        sin = sin_0 * taxels[COS, i] + cos_0 * taxels[SIN, i]
        dx, dy = taxels[PLACE_X, i] - x, taxels[PLACE_Y, i] - y
        u, w = cos * dx + sin * dy, cos * dy - sin * dx
        q, qu, qw = pressure_at(c, u - left, w - low)
        reading, variance = taxels[READING, i], taxels[VARIANCE, i]
        known, live = not np.isnan(q), variance != 0.0
        model = gain * q if known else 0.0
        residual = reading - model
        firm = 1.0 / (variance if live else 1.0)
        doubtful = gain * gain * nearest(doubt, u - left, w - low) if known and not certain else 0.0
        weight = firm / (1.0 + firm * doubtful)
        clipped = reading == 0.0 and model <= 0.0  # the sensor clips there
        above = reading >= taxels[CEILING, i] and residual < 0.0
        speaks = live and not clipped and not above
        fits = speaks and known
        z2 = residual * residual * weight
        unexplained = speaks and not known and z2 > _UNEXPLAINED  # a load off the lattice
        chi += z2 if fits else (min(z2, OUTLIER) if unexplained else 0.0)
        z, far = np.sqrt(z2), z2 > huber * huber
        doubted = (2.0 * huber * z - huber * huber if far else z2) + _log_inverse(variance * weight if live else 1.0)
        believed = residual * residual * firm
        # off the lattice, too, for the cost must not change when a taxel comes onto it
        cost += min(doubted, believed) if speaks else 0.0
        used += 1.0 if fits or unexplained else 0.0
        weight = (weight * huber / z if far else weight) if fits else 0.0
        q, qu, qw = q if fits else 0.0, gain * qu if fits else 0.0, gain * qw if fits else 0.0
        jx, jy, jt, js = qw * sin - qu * cos, -qw * cos - qu * sin, qu * w - qw * u, -qu * u - qw * w
        wx, wy, wt, wg, ws, wr = weight * jx, weight * jy, weight * jt, weight * q, weight * js, weight * residual
        xx += wx * jx
        xy += wx * jy
        yy += wy * jy
        tx += wt * jx
        ty += wt * jy
        tt += wt * jt
        xg += wg * jx
        yg += wg * jy
        tg += wg * jt
        gg += wg * q
        sx += ws * jx
        sy += ws * jy
        st += ws * jt
        sg += ws * q
        ss += ws * js
        xr += wr * jx
        yr += wr * jy
        tr += wr * jt
        gr += wr * q
        sr += wr * js
    normal[X, X], normal[Y, X], normal[Y, Y] = xx, xy, yy
    normal[THETA, X], normal[THETA, Y], normal[THETA, THETA] = tx, ty, tt
    normal[GAIN, X], normal[GAIN, Y], normal[GAIN, THETA], normal[GAIN, GAIN] = xg, yg, tg, gg
    normal[SIZE, X], normal[SIZE, Y], normal[SIZE, THETA], normal[SIZE, GAIN] = sx, sy, st, sg
    normal[SIZE, SIZE] = ss
    right[X], right[Y], right[THETA], right[GAIN], right[SIZE] = xr, yr, tr, gr, sr
    return cost, chi, int(used)


@lean_kernel
def look_up(surface: Surface, taxels: Floats, state: Floats, out: Floats) -> None:
    """Fill out (2, n) with q at the first n taxels, NaN off the lattice, and its variance."""
    h, left, low = surface.lattice
    left, low = left / h, low / h
    scale = np.exp(-state[SIZE]) / h
    cos_0, sin_0 = scale * np.cos(state[THETA]), scale * np.sin(state[THETA])
    for i in range(out.shape[1]):
        cos = cos_0 * taxels[COS, i] - sin_0 * taxels[SIN, i]
        sin = sin_0 * taxels[COS, i] + cos_0 * taxels[SIN, i]
        dx, dy = taxels[PLACE_X, i] - state[X], taxels[PLACE_Y, i] - state[Y]
        u, w = cos * dx + sin * dy - left, cos * dy - sin * dx - low
        out[0, i] = pressure_at(surface.c, u, w)[0]
        out[1, i] = 0.0 if np.isnan(out[0, i]) else nearest(surface.doubt, u, w)
