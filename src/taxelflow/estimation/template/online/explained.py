"""Whether a map explains a scan: the share of the readings' power that its residuals hold.

Chi-square per reading does not show it: most taxels of a pad are silent, and a map that lies beside the load explains
all of those.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taxelflow.estimation.template.linearization import Frame, Packed, rows_of, turned
from taxelflow.estimation.template.online.track_state import Track
from taxelflow.messages import Floats
from taxelflow.numerics.bspline import STATE, by_state
from taxelflow.numerics.robust import gate
from taxelflow.numerics.rounding import SIGNIFICANT
from taxelflow.numerics.small_linalg import put_lower
from taxelflow.runtime.compiling import inlined, lean_kernel, vector_kernel


class _Unexplained(NamedTuple):
    """What a map may leave of a scan, as a share of the readings' power."""

    most: float = 0.5
    """Up to this a map explains a scan: it explains more than it leaves."""
    known: float = 0.1
    """Up to this a scan shows the object of a known map; its variance is not counted as evidence."""
    by_faults: float = 3.0
    """Up to this, times the square of the sensor's unseen error, its faults leave: the mean square of a paraboloid's
    pressure is a third of that of its largest."""
    scans: int = 2
    """After this many consecutive scans that do not fit its map, it is another object."""


UNEXPLAINED = _Unexplained()


@vector_kernel
def unexplained(frame: Frame, taxels: Packed, error: float, centre: Floats) -> float:
    """Share of the readings' power that a map leaves, beyond noise.

    taxels: looked up in this frame, with the model error in their variance. centre: (2,), filled with the centre of the
    pressure that the map predicts; the frame's place if it predicts none.
    """
    rows = rows_of(taxels)
    x, y, gain = frame.x, frame.y, frame.gain
    remains = whole = total = mx = my = 0.0
    for i in range(taxels.lanes):  # without a branch, as vector registers need it
        dx, dy, q = rows.x[i] - x, rows.y[i] - y, rows.q[i]
        reading, variance = rows.reading[i], rows.variance[i]
        model, live = 0.0 if np.isnan(q) else gain * q, variance != 0.0
        shown = model if live else 0.0
        total, mx, my = total + shown, mx + shown * dx, my + shown * dy
        remains += _left(reading - model, reading, variance, rows.ceiling[i], error)
        whole += reading * reading if live else 0.0
    _put_mean(x, y, mx, my, total, centre)
    return float(remains / whole) if whole > 0.0 else 0.0


@inlined
def _left(off: float, reading: float, variance: float, ceiling: float, error: float) -> float:
    """Square of a residual beyond significant noise; 0 of a masked taxel, or of one at its ceiling."""
    counts = variance != 0.0 and (off > 0.0 or reading < ceiling)
    beyond = off * off - SIGNIFICANT**2 * (variance - error * error)
    return beyond if counts and beyond > 0.0 else 0.0


@inlined
def _put_mean(x: float, y: float, mx: float, my: float, total: float, centre: Floats) -> None:
    """Fill centre (2,) with the mean of weighted offsets from x and y, whose sums these are; x and y without weight."""
    centre[0], centre[1] = x, y
    if total > 0.0:
        centre[0], centre[1] = x + mx / total, y + my / total


@vector_kernel
def unexplained_and_doubted(
    frame: Frame,
    taxels: Packed,
    error: float,
    more: float,
    least: float,
    centre: Floats,
    normal: Floats,
) -> tuple[float, float, float]:
    """`unexplained`; and normal (5, 5) as `linearise` fills it without robust weights, each variance larger by `more`.

    Also chi-square with these variances over the readings in the contact, those above `least` as read or as predicted,
    and their number.
    """
    rows = rows_of(taxels)
    x, y, gain, cos_0, sin_0, _, _ = frame
    remains = whole = total = mx = my = chi = count = 0.0
    xx = xy = yy = xg = yg = gg = tx = ty = tg = tt = sx = sy = sg = st = ss = 0.0
    for i in range(taxels.lanes):
        cos, sin = turned(rows, i, cos_0, sin_0)
        dx, dy = rows.x[i] - x, rows.y[i] - y
        u, w = cos * dx + sin * dy, cos * dy - sin * dx
        q, qu, qw = rows.q[i], rows.qu[i], rows.qw[i]
        reading, variance = rows.reading[i], rows.variance[i]
        known, live = not np.isnan(q), variance != 0.0
        model = gain * q if known else 0.0
        off = reading - model
        shown = model if live else 0.0
        total, mx, my = total + shown, mx + shown * dx, my + shown * dy
        remains += _left(off, reading, variance, rows.ceiling[i], error)
        whole += reading * reading if live else 0.0
        clipped = reading == 0.0 and model <= 0.0  # the sensor clips there
        above = reading >= rows.ceiling[i] and off < 0.0
        fit = live and known and not clipped and not above
        firm = 1.0 / (variance + more)
        weight = firm / (1.0 + firm * (gain * gain * rows.doubt[i])) if fit else 0.0
        loaded = live and not clipped and not above and max(reading, model) > least
        chi += off * off * (weight if known else firm) if loaded else 0.0
        count += 1.0 if loaded else 0.0
        q, qu, qw = q if fit else 0.0, gain * qu if fit else 0.0, gain * qw if fit else 0.0
        jx, jy, jt, js = by_state(u, w, qu, qw, cos, sin)
        wx, wy, wt, wg, ws = weight * jx, weight * jy, weight * jt, weight * q, weight * js
        xx, xy, yy = xx + wx * jx, xy + wx * jy, yy + wy * jy
        tx, ty, tt = tx + wt * jx, ty + wt * jy, tt + wt * jt
        xg, yg, tg, gg = xg + wg * jx, yg + wg * jy, tg + wg * jt, gg + wg * q
        sx, sy, st, sg, ss = sx + ws * jx, sy + ws * jy, st + ws * jt, sg + ws * q, ss + ws * js
    put_lower((xx, xy, yy, tx, ty, tt, xg, yg, tg, gg, sx, sy, st, sg, ss), normal, STATE)
    _put_mean(x, y, mx, my, total, centre)
    return remains / whole if whole > 0.0 else 0.0, chi, count


@lean_kernel
def fits(m: Track) -> bool:
    """Whether the map explains the last scan at the state that it was registered to."""
    return bool(m.chi <= gate(m.usual, m.count) and m.unexplained <= UNEXPLAINED.most)
