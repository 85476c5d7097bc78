"""Whether a pattern explains a scan.

Chi-square per reading does not show it: most taxels of a pad are silent, and a pattern that lies beside the load
explains all of those.
"""

from __future__ import annotations

import numpy as np

from taxelflow.estimation.template.linearization import LaidOut, nearest, pressure_at
from taxelflow.estimation.template.map import Surface
from taxelflow.estimation.template.online.track_state import Track
from taxelflow.messages import Floats
from taxelflow.numerics.bspline import STATE, state_of
from taxelflow.numerics.robust import gate
from taxelflow.numerics.small_linalg import put_lower
from taxelflow.runtime.compiling import lean_kernel

MOST_UNEXPLAINED = 0.5
"""Share of the readings, squared, up to which a pattern explains a scan: it explains more than it leaves."""
KNOWN_UNEXPLAINED = 0.1
"""The same, up to which a scan shows the object of a pattern; doubt of it is no evidence."""
MISTAKEN = 2
"""After this many scans in a row that do not fit its pattern, it is another object."""
_SURELY = 3.0
"""Standard deviations of noise that are no evidence against a pattern."""


@lean_kernel
def unexplained(surface: Surface, taxels: LaidOut, error: float, state: Floats, centre: Floats) -> float:
    """Share of the readings, squared, that a pattern leaves at a state (5,), beyond noise.

    taxels: from `linearization.laid_out`, with the error in. centre: (2,), filled with the centre of the pressure that
    the pattern shows on them; the state's place if it shows none.
    """
    h, left, low = surface.lattice
    left, low = left / h, low / h
    x, y, theta, gain, size = state_of(state)
    scale = np.exp(-size) / h
    cos_0, sin_0 = scale * np.cos(theta), scale * np.sin(theta)
    remains = whole = total = sx = sy = 0.0
    for i in range(len(taxels.x)):  # without a branch, as vector registers need it
        cos = cos_0 * taxels.cos[i] - sin_0 * taxels.sin[i]
        sin = sin_0 * taxels.cos[i] + cos_0 * taxels.sin[i]
        dx, dy = taxels.x[i] - x, taxels.y[i] - y
        q, _, _ = pressure_at(surface.c, cos * dx + sin * dy - left, cos * dy - sin * dx - low)
        reading, variance = taxels.reading[i], taxels.variance[i]
        model, live = 0.0 if np.isnan(q) else gain * q, variance != 0.0
        off = reading - model
        seen = model if live else 0.0
        total += seen
        sx += seen * dx
        sy += seen * dy
        counts = live and (off > 0.0 or reading < taxels.ceiling[i])
        beyond = off * off - _SURELY * _SURELY * (variance - error * error)
        remains += beyond if counts and beyond > 0.0 else 0.0
        whole += reading * reading if live else 0.0
    centre[0], centre[1] = x, y
    if total > 0.0:
        centre[0], centre[1] = x + sx / total, y + sy / total
    return float(remains / whole) if whole > 0.0 else 0.0


@lean_kernel
def unexplained_and_doubted(
    surface: Surface, taxels: LaidOut, error: float, more: float, state: Floats, centre: Floats, normal: Floats
) -> float:
    """`unexplained`; and normal (5, 5) as `linearise` fills it where no reading is held down, the variance of each
    larger by `more`. Both at once, because it takes most of the time to look up the pattern.
    """
    c, doubt = surface.c, surface.doubt
    h, left, low = surface.lattice
    left, low = left / h, low / h
    x, y, theta, gain, size = state_of(state)
    scale = np.exp(-size) / h
    cos_0, sin_0 = scale * np.cos(theta), scale * np.sin(theta)
    remains = whole = total = mx = my = 0.0
    xx = xy = yy = xg = yg = gg = tx = ty = tg = tt = sx = sy = sg = st = ss = 0.0
    for i in range(len(taxels.x)):
        cos = cos_0 * taxels.cos[i] - sin_0 * taxels.sin[i]
        sin = sin_0 * taxels.cos[i] + cos_0 * taxels.sin[i]
        dx, dy = taxels.x[i] - x, taxels.y[i] - y
        u, w = cos * dx + sin * dy, cos * dy - sin * dx
        q, qu, qw = pressure_at(c, u - left, w - low)
        reading, variance = taxels.reading[i], taxels.variance[i]
        known, live = not np.isnan(q), variance != 0.0
        model = gain * q if known else 0.0
        off = reading - model
        shown = model if live else 0.0
        total, mx, my = total + shown, mx + shown * dx, my + shown * dy
        counts = live and (off > 0.0 or reading < taxels.ceiling[i])
        beyond = off * off - _SURELY * _SURELY * (variance - error * error)
        remains += beyond if counts and beyond > 0.0 else 0.0
        whole += reading * reading if live else 0.0
        doubtful = gain * gain * nearest(doubt, u - left, w - low) if known else 0.0
        clipped = reading == 0.0 and model <= 0.0  # the sensor clips there
        above = reading >= taxels.ceiling[i] and off < 0.0
        fit = live and known and not clipped and not above
        firm = 1.0 / (variance + more)
        weight = firm / (1.0 + firm * doubtful) if fit else 0.0
        q, qu, qw = q if fit else 0.0, gain * qu if fit else 0.0, gain * qw if fit else 0.0
        jx, jy, jt, js = qw * sin - qu * cos, -qw * cos - qu * sin, qu * w - qw * u, -qu * u - qw * w
        wx, wy, wt, wg, ws = weight * jx, weight * jy, weight * jt, weight * q, weight * js
        xx, xy, yy = xx + wx * jx, xy + wx * jy, yy + wy * jy
        tx, ty, tt = tx + wt * jx, ty + wt * jy, tt + wt * jt
        xg, yg, tg, gg = xg + wg * jx, yg + wg * jy, tg + wg * jt, gg + wg * q
        sx, sy, st, sg, ss = sx + ws * jx, sy + ws * jy, st + ws * jt, sg + ws * q, ss + ws * js
    put_lower((xx, xy, yy, tx, ty, tt, xg, yg, tg, gg, sx, sy, st, sg, ss), normal, STATE)
    centre[0], centre[1] = x, y
    if total > 0.0:
        centre[0], centre[1] = x + mx / total, y + my / total
    return float(remains / whole) if whole > 0.0 else 0.0


@lean_kernel
def fits(m: Track) -> bool:
    """Whether the last scan fits the pattern where the object was looked for."""
    return bool(m.chi <= gate(m.usual, m.count) and m.unexplained <= MOST_UNEXPLAINED)
