"""What a pattern leaves unexplained in a scan, carried over to the next.

Skin and object give way, so the pattern of a real contact changes more slowly than scans follow one another: what is
left of one scan is left of the next, too. It is kept as one number a taxel, r, that dies away with time and motion,
with a variance v; R^2 is what v is at rest::

    before the next scan   r <- a r           v <- a^2 v + (1 - a^2) R^2
    the scan is registered by  y - g q = r,   weights 1 / (noise^2 + v)
    after it               r <- r + k (y - g q - r)   v <- (1 - k) v,   k = v / (v + noise^2)

Where the pattern explains scans as well as their noise lets it, R and with it r are nothing, and poses are those on the
pattern. The worse it does, the more a pose comes from the scan before.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.estimation.pattern.spline import GAIN, SIZE, STATE, THETA, X, Y

if TYPE_CHECKING:
    from taxelflow.messages import Floats

_TIME_S, _LENGTH = 1.0, 0.3
"""In which a rest dies away: s, pitches."""
_FITS = 1.5
"""Chi-square over the usual up to which nothing is left."""
_BEYOND = 0.1
"""Of the peak, what a pattern may be wrong by just beyond its lattice."""
_OFF = 25.0
"""Most that a reading off the pattern's lattice adds to chi-square."""


@kernel
def bring(
    span: float,
    moved: float,
    rest: Floats,
    reading: Floats,
    variance: Floats,
    ceiling: Floats,
    out: Floats,
) -> None:
    """Fill out (3, taxels) with reading, variance and ceiling, less what is left of rest (3, taxels: r, v, R^2) after a
    span (s) and a motion (pitches). A pattern registered on them as if it had no error is registered with its rest.
    """
    a = fades(span, moved)
    for i in range(rest.shape[1]):
        out[0, i] = reading[i] - a * rest[0, i]
        out[1, i] = variance[i]
        if variance[i] > 0.0:
            out[1, i] += a * a * rest[1, i] + (1.0 - a * a) * rest[2, i]
        out[2, i] = ceiling[i] - a * rest[0, i]


@kernel
def fades(span: float, moved: float) -> float:
    """What is left of a rest after a span (s) and a motion (pitches)."""
    return float(np.exp(-span / _TIME_S - moved / _LENGTH))


@kernel
def keep(  # noqa: PLR0912  one loop, as a kernel must be
    values: Floats,
    doubt: Floats,
    lattice: Floats,
    places: Floats,
    bend: Floats,
    state: Floats,
    reading: Floats,
    variance: Floats,
    ceiling: Floats,
    rough: float,
    usual: float,
    stiffness: Floats,
    registered: float,
    still: bool,
    brought: Floats,
    rest: Floats,
    information: Floats,
) -> float:
    """Update rest (3, taxels) by a scan registered at a state (5,); chi-square per reading on the pattern alone.

    values: (taxels, 5), of the pattern and its slopes at the state, see `spline.evaluate`. registered: chi-square per
    reading that registration left. still: whether the pattern's own error stays, too. brought: (3, taxels), from
    `bring`, or (3, 0) if there was no rest before. information: (5, 5) becomes that of the pose on the pattern alone.
    Others as for `register`.
    """
    gain, chi, seen, count = state[GAIN], 0.0, 0, len(reading)
    peak = 0.0
    for i in range(count):
        peak = max(peak, reading[i])
    for i in range(count):
        q = values[i, 0]
        if np.isnan(q):
            if reading[i] * reading[i] > 9.0 * variance[i] > 0.0:
                chi += min(reading[i] * reading[i] / variance[i], _OFF)
                seen += 1
            rest[2, i] = max(reading[i] * reading[i], (_BEYOND * peak) ** 2)
            continue
        rest[2, i] = (rough * max(gain * q, 0.0)) ** 2
        rest[2, i] += gain * gain * _nearest(doubt, lattice, places, state, bend, i)
        left = reading[i] - gain * q
        if variance[i] == 0.0 or (left < 0.0 and reading[i] >= ceiling[i]) or (reading[i] == 0.0 and gain * q <= 0.0):
            continue
        chi += left * left / (variance[i] + rest[2, i])
        seen += 1
    chi /= max(seen, 1)
    excess, sudden = max(chi - _FITS * usual, 0.0), max(registered - _FITS, 0.0)
    information[:] = 0.0
    jacobian = np.empty(STATE)
    for i in range(count):
        if variance[i] == 0.0:
            rest[0, i], rest[1, i] = 0.0, 0.0
            if brought.shape[1]:  # nothing is known, but what there was dies away
                rest[0, i] = reading[i] - brought[0, i]
            continue
        q = values[i, 0]
        base = variance[i] + rest[2, i]
        rest[2, i] = excess * base + (rest[2, i] if still or np.isnan(q) else 0.0)
        before, r = rest[2, i], 0.0
        if brought.shape[1]:
            before, r = max(brought[1, i] - variance[i], 0.0) + sudden * brought[1, i], reading[i] - brought[0, i]
        left = reading[i] - (0.0 if np.isnan(q) else gain * q)
        share = before / (before + variance[i])
        if left < 0.0 and reading[i] >= ceiling[i]:
            share = 0.0
        rest[0, i] = r + share * (left - r)
        rest[1, i] = (1.0 - share) * before
        clipped = reading[i] == 0.0 and gain * q <= 0.0
        if clipped:  # it says nothing of how far below zero the pattern is
            rest[0, i], rest[1, i] = 0.0, rest[2, i]
        if clipped or np.isnan(q):
            continue
        w = 1.0 / ((1.0 + excess) * base)
        jacobian[0], jacobian[1], jacobian[2] = gain * values[i, 1], gain * values[i, 2], gain * values[i, 3]
        jacobian[3], jacobian[4] = q, gain * values[i, 4]
        for a in range(STATE):
            for b in range(STATE):
                information[a, b] += w * jacobian[a] * jacobian[b]
    for a in range(STATE):
        information[a, a] += stiffness[a]
    return chi


@kernel
def _nearest(grid: Floats, lattice: Floats, places: Floats, state: Floats, bend: Floats, i: int) -> float:
    """Value of grid (ny, nx) at the knot nearest to taxel i, which lies on the lattice."""
    dx, dy, theta = places[0, i] - state[X], places[1, i] - state[Y], state[THETA]
    if bend.shape[1]:
        dx, dy, theta = dx - bend[0, i], dy - bend[1, i], theta + bend[2, i]
    shrink = np.exp(-state[SIZE])
    cos, sin = shrink * np.cos(theta), shrink * np.sin(theta)
    ix = int(np.round((cos * dx + sin * dy - lattice[1]) / lattice[0]))
    iy = int(np.round((cos * dy - sin * dx - lattice[2]) / lattice[0]))
    value: float = grid[iy, ix]
    return value
