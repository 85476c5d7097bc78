"""What is known of a still object: where it is, what load and creep do to it, and how its pose scatters.

The pose is a place a, plus b times the change of the load's logarithm, plus c times the time, plus noise. That is a
Kalman filter; its innovations, each over the Cholesky factor of its covariance, are u ~ N(0, s^2 I), independent if the
noise is. s^2 and the correlation of consecutive u are learned. All axes share the filter's gains: noise that is k
times larger along one axis makes the place k times less sure there.
"""

from __future__ import annotations

from math import exp

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.messages import Floats

# Memory per pad. A, B, C: (3,) each along x, y, theta. P: covariance aa, ab, ac, bb, bc, cc of a translation, m^2, ...
# ENERGY, FREEDOM: sum of |u|^2 and of its components. TURNS: poses in a row whose turn is known, up to _TURNS.
# SERIAL: sum of u' times the u before; WAITING, FRESH: what is not yet in it; POSES: in FRESH; U: the last u (3,).
# MEAN_LOAD, UNSTEADY: mean of the load's logarithm, and its variance.
A, B, C, P, LOG_LOAD, ENERGY, FREEDOM, TURNS, SERIAL, WAITING, FRESH, POSES, U, MEAN_LOAD, UNSTEADY, STILL = (
    *(0, 3, 6, 9, 15, 16, 17, 18, 19, 20, 21, 22, 23, 26, 27),
    28,
)
# What a pose amounts to: rise of the load's logarithm, what is left of b and c, gains of a, b, c, deviation of the
# noise over the innovation's, its variance (see `spread`), whether the turn counts, u (3), the noise's factor (6), how
# many of x and y count.
RISE, KEEP, GAIN, NARROW, SPREAD, TURN_COUNTS, WHITE, ROOT, AXES, STEP = 0, 1, 2, 5, 6, 7, 8, 11, 17, 18

_LEAST_SEEN, _LEAST_SCALE, MOST_SCALE = 0.01, 0.9, 25.0
"""The scatter is learned between the first and the last times the variance that comes with a pose; below the second it
does not count."""
_STEADY = 0.05
"""Variance of the load's logarithm up to which a scatter smaller than the covariance says counts."""
_PRIOR = 20.0
"""Components for which the covariance that comes with a pose counts."""
_BLOCK, _MEMORY = 16, 3000.0
"""Poses after which a correlation counts: before, it may be a slip's. Components that are remembered."""
_MOST_SERIAL, _MOST_DRAWN_OUT = 0.8, 9.0
_RELAX_S = 1.0
"""What load and creep do is forgotten in this time."""
_TURNS = 20.0
"""A turn that was unknown for a while counts again when it has been known for so many poses."""


@kernel
def scale(m: Floats) -> float:
    """Variance of the scatter seen over that which the covariance says.

    Below 1 only while the load is steady: a covariance that is too large under high load may be right under low load.
    """
    if m[FREEDOM] == 0.0:
        return 1.0
    least = _LEAST_SCALE if m[UNSTEADY] < _STEADY else 1.0
    return float(min(max(m[ENERGY] / m[FREEDOM], least), MOST_SCALE))


@kernel
def drawn_out(m: Floats) -> float:
    """How many times larger the noise's mean over many poses varies than if they were independent, 1 or more.

    From the correlation r of consecutive innovations, (1 + r) / (1 - r), less what chance makes of independent ones.
    """
    r = m[SERIAL] / m[ENERGY] - 1.0 / np.sqrt(m[FREEDOM])
    if r <= 0.0:
        return 1.0
    return float((1.0 + r) / (1.0 - r)) if r < _MOST_SERIAL else _MOST_DRAWN_OUT


@kernel
def settle(y: Floats, variance: float, load: float, prior: Floats, m: Floats) -> None:
    """The object is at y (3,), known with this variance, m^2; what load and creep do to it is unknown."""
    for axis in range(3):
        m[A + axis], m[B + axis], m[C + axis] = y[axis], 0.0, 0.0
    m[P : P + 6] = 0.0
    m[P], m[P + 3], m[P + 5] = variance, prior[0] ** 2, prior[1] ** 2
    m[LOG_LOAD], m[TURNS] = load, _TURNS
    m[WAITING] = m[FRESH] = m[POSES] = 0.0
    m[U : U + 3] = 0.0
    if m[FREEDOM] == 0.0:
        m[ENERGY] = m[FREEDOM] = _PRIOR


@kernel
def forget(m: Floats) -> None:
    """Another contact, or a pattern begun anew: the scatter counts for little, unless it was larger than said."""
    m[ENERGY] = _PRIOR * max(scale(m), 1.0)
    m[FREEDOM] = _PRIOR
    m[SERIAL] = m[MEAN_LOAD] = m[UNSTEADY] = 0.0


@kernel
def turn_counts(theta: float, noise: Floats, m: Floats) -> bool:
    """Whether the turn was known for long enough; if not, its place is the mean so far, and noise's tt becomes NaN."""
    if np.isnan(noise[2]):
        m[TURNS] = 0.0
        return False
    if m[TURNS] == _TURNS:
        return True
    m[TURNS] += 1.0
    m[A + 2] += (theta - m[A + 2]) / m[TURNS]
    noise[2] = np.nan
    return False


@kernel
def spread(n: Floats) -> float:
    """Variance of a place, from a pose's covariance (6): the mean of x and y, or that of the one that is known."""
    if np.isnan(n[0]):
        return float(n[1])
    return float(n[0] if np.isnan(n[1]) else 0.5 * (n[0] + n[1]))


@kernel
def axes_of(n: Floats) -> float:
    """How many of x and y are known."""
    return 1.0 if np.isnan(n[0]) or np.isnan(n[1]) else 2.0


@kernel
def factor(n: Floats, root: Floats) -> bool:
    """Cholesky factor (6: xx, yx, yy, tx, ty, tt) of a covariance (6: xx, yy, tt, xy, xt, yt); is the turn known?

    xx, yy or tt is NaN if it is not; then the factor is infinite, so that it counts for nothing.
    """
    root[0] = np.inf if np.isnan(n[0]) else np.sqrt(n[0])
    root[1] = n[3] / root[0]
    root[2] = np.inf if np.isnan(n[1]) else np.sqrt(n[1] - root[1] * root[1])
    if np.isnan(n[2]):
        root[3], root[4], root[5] = 0.0, 0.0, np.inf
        return False
    root[3] = n[4] / root[0]
    root[4] = (n[5] - root[3] * root[1]) / root[2]
    root[5] = np.sqrt(n[2] - root[3] * root[3] - root[4] * root[4])
    return True


@kernel
def whiten(root: Floats, e: Floats) -> float:
    """e (3,) over its covariance's factor, in place; gives its square. What is unknown becomes 0."""
    e[0] /= root[0]
    e[1] = (e[1] - root[1] * e[0]) / root[2]
    e[2] = (e[2] - root[3] * e[0] - root[4] * e[1]) / root[5]
    return float(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])


@kernel
def innovate(dt: float, y: Floats, noise: Floats, load: float, prior: Floats, m: Floats, step: Floats) -> None:
    """One more pose of a still object, dt after the last: fill step (STEP,), go on.

    y: (3,), what is unknown is any number. noise: (6,), its covariance, xx, yy or tt NaN if unknown. load: its
    logarithm, as before if unknown. prior: (2,), usual size of b and c. m: (STILL,).
    """
    step[RISE] = load - m[LOG_LOAD]
    m[LOG_LOAD] = load
    step[KEEP] = _predict(dt, step[RISE], prior, m)
    step[SPREAD], step[AXES] = spread(noise) * scale(m), axes_of(noise)
    total = m[P] + step[SPREAD]
    for k in range(3):
        step[GAIN + k] = m[P + k] / total
    step[NARROW] = np.sqrt(step[SPREAD] / total)
    _watch_load(load, m)
    root, u, e = step[ROOT : ROOT + 6], step[WHITE : WHITE + 3], np.zeros(3)
    turns = turn_counts(y[2], noise, m)
    step[TURN_COUNTS] = 1.0 if turns else 0.0
    factor(noise, root)
    for axis in range(3):
        e[axis] = y[axis] - m[A + axis] if not np.isnan(noise[axis]) else 0.0
    for axis in range(3):
        u[axis] = e[axis] * step[NARROW]
    _learn(whiten(root, u), u, step[AXES] + step[TURN_COUNTS], m)
    gain_a, gain_b, gain_c = step[GAIN], step[GAIN + 1], step[GAIN + 2]
    for axis in range(3):
        m[A + axis] += gain_a * e[axis]
        m[B + axis] += gain_b * e[axis]
        m[C + axis] += gain_c * e[axis]
    aa, ab, ac = m[P], m[P + 1], m[P + 2]
    m[P] -= gain_a * aa
    m[P + 1] -= gain_a * ab
    m[P + 2] -= gain_a * ac
    m[P + 3] -= gain_b * ab
    m[P + 4] -= gain_b * ac
    m[P + 5] -= gain_c * ac


@kernel
def _predict(dt: float, rise: float, prior: Floats, m: Floats) -> float:
    """State and covariance after dt: b and c fade towards what is usual; gives what is left of them."""
    keep = exp(-dt / _RELAX_S)
    fresh = 1.0 - keep * keep
    for axis in range(3):
        m[A + axis] += rise * m[B + axis] + dt * m[C + axis]
        m[B + axis] *= keep
        m[C + axis] *= keep
    aa, ab, ac, bb, bc, cc = m[P], m[P + 1], m[P + 2], m[P + 3], m[P + 4], m[P + 5]
    to_b, to_c = ab + rise * bb + dt * bc, ac + rise * bc + dt * cc
    m[P] = aa + rise * ab + dt * ac + rise * to_b + dt * to_c
    m[P + 1], m[P + 2], m[P + 4] = keep * to_b, keep * to_c, keep * keep * bc
    m[P + 3] = keep * keep * bb + fresh * prior[0] ** 2
    m[P + 5] = keep * keep * cc + fresh * prior[1] ** 2
    return keep


@kernel
def _watch_load(load: float, m: Floats) -> None:
    """Mean and variance of the load's logarithm, over as long as the scale's memory."""
    if m[FREEDOM] == _PRIOR:
        m[MEAN_LOAD] = load
    fresh, off = 2.0 / _MEMORY, load - m[MEAN_LOAD]
    m[MEAN_LOAD] += fresh * off
    m[UNSTEADY] = (1.0 - fresh) * (m[UNSTEADY] + fresh * off * off)


@kernel
def _learn(square: float, u: Floats, components: float, m: Floats) -> None:
    """Scale and correlation of the noise, from one more u (3,) and its square."""
    fade = 1.0 - components / _MEMORY
    m[FREEDOM] = fade * m[FREEDOM] + components
    energy = fade * m[ENERGY] + square
    m[ENERGY] = min(max(energy, _LEAST_SEEN * m[FREEDOM]), MOST_SCALE * m[FREEDOM])
    m[SERIAL] *= fade
    for axis in range(3):
        m[FRESH] += u[axis] * m[U + axis]
        m[U + axis] = u[axis]
    m[POSES] += 1.0
    if m[POSES] == _BLOCK:
        m[SERIAL] += m[WAITING]
        m[WAITING], m[FRESH], m[POSES] = m[FRESH], 0.0, 0.0
