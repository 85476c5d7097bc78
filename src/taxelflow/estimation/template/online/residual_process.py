"""The residual process: what the map does not explain of a scan, and of the next one, too.

Skin and object yield, so the residuals of a real contact change more slowly than scans follow one another. Each taxel's
is an AR(1) process: its mean r and variance v are those of a Kalman filter, and R^2 is the stationary variance::

    predict                r <- a r           v <- a^2 v + (1 - a^2) R^2
    register the scan by   y - g q = r,       weights 1 / (noise^2 + v)
    update                 r <- r + k (y - g q - r)   v <- (1 - k) v,   k = v / (v + noise^2)

a decays with time and motion. Of a taxel off the lattice r is 0, and v the variance of what may be there.

A map that explains scans to within their noise has R = 0, and poses are those on the map. When it explains a scan
poorly, its pose relies more on the previous scan.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taxelflow.estimation.template.linearization import Frame, Packed, rows_of, sum_up
from taxelflow.estimation.template.online.hand import PadScan
from taxelflow.estimation.template.online.track_state import Track
from taxelflow.messages import Floats
from taxelflow.numerics.bspline import STATE, state_of
from taxelflow.numerics.robust import FITS
from taxelflow.numerics.small_linalg import mirror
from taxelflow.runtime.compiling import lean_kernel, vector_kernel


class _Residual(NamedTuple):
    """Residuals of taxels, which stay and move with the object for a while."""

    time_s: float = 1.0
    length: float = 0.3
    """In which a residual decays: s, pitches."""
    beyond: float = 0.1
    """Standard deviation of the pressure just beyond the lattice, as a share of the peak."""


_RESIDUAL = _Residual()


@vector_kernel
def predict(span: float, moved: float, rest: Floats, scan: PadScan, out: Floats) -> None:
    """Fill out (3, taxels) with a scan's reading, variance and ceiling, less the predicted residual.

    rest: (3, taxels), r, v and R^2. span: since the last scan, s. moved: pitches. A map without errors of its own is
    registered to the result.
    """
    a = decay(span, moved)
    for i in range(rest.shape[1]):
        out[0, i] = scan.reading[i] - a * rest[0, i]
        more = a * a * rest[1, i] + (1.0 - a * a) * rest[2, i]
        out[1, i] = scan.variance[i] + (more if scan.variance[i] > 0.0 else 0.0)
        out[2, i] = scan.ceiling[i] - a * rest[0, i]


@lean_kernel
def decay(span: float, moved: float) -> float:
    """The factor a, after a span (s) and a motion (pitches)."""
    return float(np.exp(-span / _RESIDUAL.time_s - moved / _RESIDUAL.length))


@lean_kernel
def update(
    frame: Frame,
    taxels: Packed,
    error: float,
    registered: float,
    still: bool,
    brought: Floats,
    rest: Floats,
    precision: Floats,
    right: Floats,
    m: Track,
) -> float:
    """Update rest (3, taxels) by a registered scan; chi-square per reading on the map alone.

    taxels: looked up in the frame of m.state, with the error in. registered: chi-square per reading after registration,
    over the usual. still: whether the map's own error stays, too. brought: (3, taxels), from `predict`, or (3, 0) if
    the process begins. right: (5,), to work in. m.information becomes that of the pose on the map alone.
    """
    state, information = m.state, m.information
    _, chi, seen = sum_up(frame, taxels, np.inf, information, right)
    chi /= max(seen, 1)
    excess, sudden = max(chi - FITS * m.usual, 0.0), max(registered * m.usual - FITS, 0.0)
    for a in range(STATE):
        for b in range(a + 1):
            information[a, b] /= 1.0 + excess
        information[a, a] += precision[a]
    mirror(information)
    count, rows = rest.shape[1], rows_of(taxels)
    gain, peak = state_of(state).gain, 0.0
    for i in range(count):
        peak = max(peak, rows.reading[i])
    for i in range(count):
        q, reading = rows.q[i], rows.reading[i]
        variance = rows.variance[i] - error * error if rows.variance[i] > 0.0 else 0.0
        off = np.isnan(q)
        model = 0.0 if off else gain * q
        own = error * error + gain * gain * rows.doubt[i]
        if off:
            own = max(reading * reading, (_RESIDUAL.beyond * peak) ** 2)
        r = reading - brought[0, i] if brought.shape[1] else 0.0
        if variance == 0.0:  # nothing is known, but what there was dies away
            rest[0, i], rest[1, i], rest[2, i] = r, 0.0, own
            continue
        rest[2, i] = excess * (variance + own) + (own if still or off else 0.0)
        if off:  # where it comes to lie next, the pattern is not known
            rest[0, i], rest[1, i] = 0.0, own
            continue
        if reading == 0.0 and model <= 0.0:  # clipped: the noise of what is not loaded is hidden
            rest[0, i], rest[1, i] = 0.0, rest[2, i]
            continue
        before, left = rest[2, i], reading - model
        if brought.shape[1]:
            before = max(brought[1, i] - variance, 0.0) + sudden * brought[1, i]
        share = before / (before + variance)
        if left < 0.0 and reading >= rows.ceiling[i]:
            share = 0.0
        rest[0, i] = r + share * (left - r)
        rest[1, i] = (1.0 - share) * before
    return chi
