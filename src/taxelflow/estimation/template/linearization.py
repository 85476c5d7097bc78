"""Linearisation of one scan on a pattern: chi-square at a state, and the normal equations of a step from it.

Most of a scan's time is spent here. So the loop is written for vector registers, eight taxels at once: it only adds
up, without a branch, over arrays with one entry per taxel (structure of arrays).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taxelflow.estimation.template.map import Surface
from taxelflow.messages import Floats
from taxelflow.numerics.bspline import STATE, State, by_state, put, state_of, value_at
from taxelflow.numerics.robust import OUTLIER
from taxelflow.numerics.rounding import SIGNIFICANT
from taxelflow.numerics.small_linalg import put_lower
from taxelflow.runtime.compiling import inlined, kernel, lean_kernel, vector_kernel

_LANES = 8
"""Taxels are padded to a multiple of this, so that loops over them are vectorised."""


class Packed(NamedTuple):
    """A scan for `linearise`. whole: (`PACKED`, taxels), the `TaxelRows` of the pad's taxels or more, all in one array,
    because calls take time for each. lanes: taxels of the pad in whole vector registers.
    """

    whole: Floats
    lanes: int


class TaxelRows(NamedTuple):
    """A packed scan as a structure of arrays, (taxels,) each.

    x, y: place, less the object's motion within the scan until the taxel is read. cos, sin: of the rotation until
    then. reading. variance: of noise and model error. ceiling. q, qu, qw, doubt: what `look_up` fills in.
    """

    x: Floats
    y: Floats
    cos: Floats
    sin: Floats
    reading: Floats
    variance: Floats
    ceiling: Floats
    q: Floats
    qu: Floats
    qw: Floats
    doubt: Floats


PACKED = len(TaxelRows._fields)


@inlined
def rows_of(taxels: Packed) -> TaxelRows:
    """The rows of a packed scan."""
    r = taxels.whole
    return TaxelRows(r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9], r[10])


@kernel
def pack_scan(places: Floats, bend: Floats, reading: Floats, variance: Floats, ceiling: Floats, error: float) -> Packed:
    """The structure of arrays of a scan, padded with masked taxels. bend: (3, taxels) or (3, 0), see `evaluate`.

    error: standard deviation of the model error of each reading.
    """
    lanes = lanes_for(len(reading))
    taxels = Packed(np.empty((PACKED, lanes)), lanes)
    pack_places(places, bend, len(reading), taxels)
    pack_readings(reading, variance, ceiling, error, taxels)
    return taxels


@inlined
def lanes_for(taxels: int) -> int:
    """This number of taxels, rounded up to whole vector registers."""
    return (taxels + _LANES - 1) // _LANES * _LANES


@vector_kernel
def pack_places(places: Floats, bend: Floats, count: int, taxels: Packed) -> None:
    """Fill in the places of this many taxels. Arguments as for `pack_scan`."""
    rows = rows_of(taxels)
    for i in range(count):
        rows.x[i], rows.y[i], rows.cos[i], rows.sin[i] = places[0, i], places[1, i], 1.0, 0.0
    for i in range(count, taxels.lanes):
        rows.x[i], rows.y[i], rows.cos[i], rows.sin[i] = 0.0, 0.0, 1.0, 0.0
    for i in range(bend.shape[1]):
        rows.x[i] -= bend[0, i]
        rows.y[i] -= bend[1, i]
        rows.cos[i], rows.sin[i] = np.cos(bend[2, i]), np.sin(bend[2, i])


@vector_kernel
def pack_readings(reading: Floats, variance: Floats, ceiling: Floats, error: float, taxels: Packed) -> None:
    """Fill in the readings. Arguments as for `pack_scan`."""
    rows, count = rows_of(taxels), len(reading)
    for i in range(count):
        rows.reading[i], rows.ceiling[i] = reading[i], ceiling[i]
        rows.variance[i] = variance[i] + error * error if variance[i] != 0.0 else 0.0
    for i in range(count, taxels.lanes):
        rows.reading[i] = rows.ceiling[i] = rows.variance[i] = 0.0


@inlined
def _pressure_at(c: Floats, x: float, y: float) -> tuple[float, float, float]:
    """`value_at`, but 0 where the spline is below 0, as noise may make it: pressure is not negative."""
    q, qu, qw = value_at(c, x, y)
    pulls = q < 0.0
    return 0.0 if pulls else q, 0.0 if pulls else qu, 0.0 if pulls else qw


class Frame(NamedTuple):
    """A pattern at a state: x, y and gain; cosine and sine of theta, in knots per pitch; place of knot (0, 0) in knots.

    It is found once for all loops over the taxels: exponential, cosine and sine take as long as six taxels.
    """

    x: float
    y: float
    gain: float
    cos: float
    sin: float
    left: float
    low: float


@inlined
def frame_of(lattice: Floats, state: Floats) -> Frame:
    """A pattern with this lattice at a state (5,)."""
    h, left, low = lattice
    x, y, theta, gain, size = state_of(state)
    scale = np.exp(-size) / h
    return Frame(x, y, gain, scale * np.cos(theta), scale * np.sin(theta), left / h, low / h)


@inlined
def turned(rows: TaxelRows, i: int, cos: float, sin: float) -> tuple[float, float]:
    """Cosine and sine of the object's angle when a taxel is read, from those of the scan."""
    return cos * rows.cos[i] - sin * rows.sin[i], sin * rows.cos[i] + cos * rows.sin[i]


@inlined
def _nearest(grid: Floats, x: float, y: float) -> float:
    """Value of grid (ny, nx) at the knot nearest to a place counted in knots, which lies on the lattice."""
    value: float = grid[np.uint64(int(y + 0.5)), np.uint64(int(x + 0.5))]
    return value


@inlined
def _log_inverse(share: float) -> float:
    """About log(1 / share): the penalty for a variance of which noise is only this share."""
    root = np.sqrt(np.sqrt(share))
    logarithm: float = 2.0 * (1.0 / root - root)
    return logarithm


@lean_kernel
def linearise(
    surface: Surface, taxels: Packed, huber: float, state: Floats, normal: Floats, right: Floats
) -> tuple[float, float, int]:
    """Fill normal (5, 5), its lower half, with J^T W J, right (5,) with J^T W (y - model) at a state (5,).

    taxels: from `pack_scan`. Others, and what is returned, as for `register`, but without the prior. The cost ranks
    states; W holds the doubt even where it is not what explains a reading.
    """
    frame = frame_of(surface.lattice, state)
    look_up(surface, frame, taxels)
    return sum_up(frame, taxels, huber, normal, right)


@vector_kernel
def look_up(surface: Surface, frame: Frame, taxels: Packed) -> None:
    """Fill in the pattern's pressure q at each taxel, NaN off the lattice, its slopes along the pattern's axes, and its
    variance.

    What is made of these is a loop of its own, for what is looked up at one state is used up to three times.
    """
    c, doubt, rows = surface.c, surface.doubt, rows_of(taxels)
    x, y, _, cos_0, sin_0, left, low = frame
    certain = len(doubt) == 0
    for i in range(taxels.lanes):
        cos, sin = turned(rows, i, cos_0, sin_0)
        dx, dy = rows.x[i] - x, rows.y[i] - y
        u, w = cos * dx + sin * dy - left, cos * dy - sin * dx - low
        q, qu, qw = _pressure_at(c, u, w)
        rows.q[i], rows.qu[i], rows.qw[i] = q, qu, qw
        rows.doubt[i] = 0.0 if certain or np.isnan(q) else _nearest(doubt, u, w)


@vector_kernel
def sum_up(  # noqa: PLR0915  one loop, as vector registers need it
    frame: Frame, taxels: Packed, huber: float, normal: Floats, right: Floats
) -> tuple[float, float, int]:
    """`linearise` of taxels that were looked up at the state of this frame."""
    rows = rows_of(taxels)
    x, y, gain, cos_0, sin_0, _, _ = frame
    cost = chi = used = 0.0
    xx = xy = yy = xg = yg = gg = xr = yr = gr = 0.0
    tx = ty = tg = tt = tr = sx = sy = sg = st = ss = sr = 0.0
    for i in range(taxels.lanes):
        cos, sin = turned(rows, i, cos_0, sin_0)
        dx, dy = rows.x[i] - x, rows.y[i] - y
        u, w = cos * dx + sin * dy, cos * dy - sin * dx
        q, qu, qw = rows.q[i], rows.qu[i], rows.qw[i]
        reading, variance = rows.reading[i], rows.variance[i]
        known, live = not np.isnan(q), variance != 0.0
        model = gain * q if known else 0.0
        residual = reading - model
        firm = 1.0 / (variance if live else 1.0)
        weight = firm / (1.0 + firm * (gain * gain * rows.doubt[i]))
        clipped = reading == 0.0 and model <= 0.0  # the sensor clips there
        above = reading >= rows.ceiling[i] and residual < 0.0
        speaks = live and not clipped and not above
        fits = speaks and known
        z2 = residual * residual * weight
        unexplained = speaks and not known and z2 > SIGNIFICANT**2  # a load off the lattice
        chi += z2 if fits else (min(z2, OUTLIER) if unexplained else 0.0)
        z, far = np.sqrt(z2), z2 > huber * huber
        doubted = (2.0 * huber * z - huber * huber if far else z2) + _log_inverse(variance * weight if live else 1.0)
        believed = residual * residual * firm
        # off the lattice, too, for the cost must not change when a taxel comes onto it
        cost += min(doubted, believed) if speaks else 0.0
        used += 1.0 if fits or unexplained else 0.0
        weight = (weight * huber / z if far else weight) if fits else 0.0
        q, qu, qw = q if fits else 0.0, gain * qu if fits else 0.0, gain * qw if fits else 0.0
        jx, jy, jt, js = by_state(u, w, qu, qw, cos, sin)
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
    put_lower((xx, xy, yy, tx, ty, tt, xg, yg, tg, gg, sx, sy, st, sg, ss), normal, STATE)
    put(State(xr, yr, tr, gr, sr), right)
    return cost, chi, int(used)
