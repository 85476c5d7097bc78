"""What load and tilt leave unexplained of the change of each pad's pattern, see `pattern_change`."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.messages import Bools, Floats
from taxelflow.numerics.rounding import ROUNDING, SIGNIFICANT
from taxelflow.runtime.compiling import inlined, kernel, lean_kernel
from taxelflow.sensors.layout import Indices

if TYPE_CHECKING:
    from taxelflow.sensors.layout import Layout

STEADY_RISE = 0.1
"""Change of the log load above which a grip closes or opens: the contact is not at rest."""


class Pads(NamedTuple):
    """Where the taxels of each pad begin (pads + 1,), their places x, y (entries,) about its middle, m, and the largest
    of these (pads,), m.
    """

    starts: Indices
    x: Floats
    y: Floats
    size: Floats

    @classmethod
    def of(cls, layout: Layout) -> Pads:
        """Those of a layout; a pad may have no taxel."""
        x, y, size = layout.x_m.copy(), layout.y_m.copy(), np.ones(len(layout.pads))
        for pad in np.flatnonzero(np.diff(layout.starts)).tolist():
            own = layout.of_pad(pad)
            x[own] -= x[own].mean()
            y[own] -= y[own].mean()
            size[pad] = max(np.abs(x[own]).max(), np.abs(y[own]).max(), 1e-9)
        return cls(layout.starts, x, y, size)


class Patterns(NamedTuple):
    """Mean patterns before and after (entries,). scatter: the variance of their difference over that of one reading.
    clipped: (entries,), at the end of the range in either, left out. noise: (entries,), standard deviation of
    a reading.
    """

    before: Floats
    after: Floats
    scatter: float
    clipped: Bools
    noise: Floats


class _Sums(NamedTuple):
    """Over the taxels of a pad, of the patterns q before and p after; x and y relative to the pad's size, or in m."""

    qq: float
    qq_x: float
    qq_y: float
    qq_xx: float
    qq_xy: float
    qq_yy: float
    qp: float
    qp_x: float
    qp_y: float
    pp: float
    q: float
    q_x_m: float
    q_y_m: float
    q_rr_m2: float
    p: float
    variance: float
    taxels: float


@kernel
def compare_patterns(pads: Pads, patterns: Patterns, known: Bools, creep_m: float, found: Floats) -> None:
    """Fill found (4, pads) with `unexplained`, `noise`, `rise` and `stirred` of `PatternChanges`.

    known: (pads,), in contact and complete throughout; elsewhere all are NaN. creep_m: by which an object at rest may
    move in the time between the patterns.
    """
    for pad in range(len(known)):
        for a in range(4):
            found[a, pad] = np.nan
        if known[pad]:
            _judge(_add_up(pads, patterns, pad), creep_m, found[:, pad])


@lean_kernel
def _add_up(pads: Pads, patterns: Patterns, pad: int) -> _Sums:
    qq = qq_x = qq_y = qq_xx = qq_xy = qq_yy = qp = qp_x = qp_y = pp = 0.0
    load = load_x = load_y = load_rr = total = scatter = taxels = 0.0
    for i in range(pads.starts[pad], pads.starts[pad + 1]):
        if patterns.clipped[i]:
            continue
        q, p, x_m, y_m = patterns.before[i], patterns.after[i], pads.x[i], pads.y[i]
        x, y, pressure = x_m / pads.size[pad], y_m / pads.size[pad], max(q, 0.0)
        qq, qq_x, qq_y = qq + q * q, qq_x + q * q * x, qq_y + q * q * y
        qq_xx, qq_xy, qq_yy = qq_xx + q * q * x * x, qq_xy + q * q * x * y, qq_yy + q * q * y * y
        qp, qp_x, qp_y, pp = qp + q * p, qp_x + q * p * x, qp_y + q * p * y, pp + p * p
        load, load_x, load_y = load + pressure, load_x + pressure * x_m, load_y + pressure * y_m
        load_rr += pressure * (x_m * x_m + y_m * y_m)
        variance = patterns.noise[i] * patterns.noise[i] * patterns.scatter if q != 0.0 or p != 0.0 else 0.0
        total, scatter, taxels = total + p, scatter + variance, taxels + (1.0 if variance > 0.0 else 0.0)
    return _Sums(
        qq, qq_x, qq_y, qq_xx, qq_xy, qq_yy, qp, qp_x, qp_y, pp, load, load_x, load_y, load_rr, total, scatter, taxels
    )


@lean_kernel
def _judge(s: _Sums, creep_m: float, found: Floats) -> None:
    """Fill found (4,) of a pad."""
    rise, noise = np.log(max(s.p, 0.0) / s.q), s.variance / s.pp
    unexplained = 1.0 - _explained(s) / s.pp
    unexplained = 0.0 if unexplained < 0.0 else unexplained
    if not np.isfinite(unexplained + noise + rise):
        return
    found[0], found[1], found[2] = unexplained, noise, rise
    if abs(rise) < STEADY_RISE:
        extent = 0.5 * (s.q_rr_m2 - (s.q_x_m * s.q_x_m + s.q_y_m * s.q_y_m) / s.q) / s.q
        extent = 0.0 if extent < 0.0 else extent  # rounding, of a single loaded taxel
        creep = 0.5 * creep_m * creep_m / extent  # of a Gaussian pattern
        # With two sigmas, 7 of 150 firm contacts that stick and slip were called restless in their first second.
        usual = noise * (1.0 + SIGNIFICANT * np.sqrt(2.0 / s.taxels)) + creep
        found[3] = 1.0 if 1.0 - s.qp * s.qp / s.qq / s.pp > usual else 0.0


@inlined
def _explained(s: _Sums) -> float:
    """Power of the pattern after that load and tilt explain: by L D L^T of the normal matrix, whose ridge is for tilts
    of a line of taxels, of one dimension only. Centre and unit of the places do not matter.
    """
    ridge = ROUNDING * s.qq + 1e-300
    d0 = s.qq + ridge
    l10, l20 = s.qq_x / d0, s.qq_y / d0
    d1 = s.qq_xx + ridge - l10 * s.qq_x
    l21 = (s.qq_xy - l20 * s.qq_x) / d1
    d2 = s.qq_yy + ridge - l20 * s.qq_y - l21 * l21 * d1
    along = s.qp_x - l10 * s.qp
    across = s.qp_y - l20 * s.qp - l21 * along
    return s.qp * s.qp / d0 + along * along / d1 + across * across / d2
