"""When a still object begins to slip: a test whose mean time between false alarms is what the user asks for.

Still: the pose is where it was, plus what load and creep do to it, plus the noise of the scan. That is a Kalman filter
with the state (place a, shift per e-fold of load b, creep rate c). Its innovations, each whitened by the Cholesky factor of
its covariance, are u_k ~ N(0, s^2 I), white, with s near 1.
A slip after scan j with velocity v adds v f_jk to them, where f_jk is how the filter answers a ramp that begins at t_j
(Willsky & Jones 1976), over the innovation's standard deviation. With v ~ N(0, (s reach / dt)^2 I) integrated out, and s
too, the likelihood ratio of that slip is
    L_j = (1 + F_j / g)^(-n/2) (1 - Q_j / E)^(-nu/2),   F_j = sum f^2, h_j = sum f u, g = (dt / reach)^2,
    Q_j = |h_j|^2 / (F_j + g),   E = sum |u|^2 over nu components; n = 2 or 3 components to a pose.
The alarm is that of Shiryaev and Roberts: the sum over j of L_j times the time since the scan before. While the object
is still each L_j has mean 1, so the sum less the time that has passed is a martingale, and the mean time to a false alarm
is at least the threshold, whatever the rate of scans (Pollak 1987).
"""

from __future__ import annotations

from math import exp, log

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.messages import Floats

# The still object, per pad. A, B, C: (3,) each along x, y, theta. P: their covariance aa, ab, ac, bb, bc, cc in m^2,
# m^2, ... of a translation; a rotation's is larger as its noise is. ENERGY, FREEDOM: E and nu. TURNS: poses in a row whose
# turn is known, up to _TURNS. SERIAL: sum of u' with the u before, WAITING and FRESH what is not yet in it, POSES how many
# poses are in FRESH; U: the last u (3,).
A, B, C, P, LOG_LOAD, ENERGY, FREEDOM, RAMPS, TURNS, SERIAL, WAITING, FRESH, POSES, U, STILL = 0, 3, 6, 9, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 27
# A ramp: begin, weight, the filter's answer to it (3), F for place and turn, h (3), g.
T_0, WEIGHT, ANSWER, F, H, G, RAMP = 0, 1, 2, 5, 7, 10, 11

REACH = 2.0
"""A usual slip moves by so many standard deviations of a pose from scan to scan; faster and slower ones are found too."""
MOST_RAMPS, _YOUNG = 20, 8
"""Ramps followed at a time, and how many of the last are never merged."""
_RELAX_S = 1.0
"""What load and creep do is forgotten in this time."""
_TURNS = 20.0
"""A turn that was unknown for a while counts again when it has been known for so many poses."""
_BLOCK, _MEMORY = 16, 3000.0
"""Poses after which a correlation counts; components that the noise's scale and correlation are learned from."""
_PRIOR = 20.0
"""Components for which the covariance that comes with a pose counts."""
LEAST_SCALE, MOST_SCALE = 0.25, 25.0
"""The scatter may be between so many times the variance that comes with a pose."""
_MOST_SERIAL, _MOST_DRAWN_OUT = 0.8, 9.0
_OLDEST_S, _OLDEST_SCANS = 2.0, 64


@kernel
def scale(m: Floats) -> float:
    """Variance of the scatter seen over that which the covariance says."""
    if m[FREEDOM] == 0.0:
        return 1.0
    return min(max(m[ENERGY] / m[FREEDOM], LEAST_SCALE), MOST_SCALE)


@kernel
def drawn_out(m: Floats) -> float:
    """How many times larger the noise's mean over many poses varies than if they were independent, 1 or more.

    From the correlation r of consecutive innovations, (1 + r) / (1 - r), less what chance makes of independent ones.
    """
    r = m[SERIAL] / m[ENERGY] - 1.0 / np.sqrt(m[FREEDOM])
    return (1.0 + r) / (1.0 - r) if 0.0 < r < _MOST_SERIAL else 1.0 if r <= 0.0 else _MOST_DRAWN_OUT


@kernel
def settle(y: Floats, variance: float, load: float, prior: Floats, m: Floats) -> None:
    """The object is at y (3,), known with this variance, m^2; what load and creep do to it is unknown."""
    for axis in range(3):
        m[A + axis], m[B + axis], m[C + axis] = y[axis], 0.0, 0.0
    m[P : P + 6] = 0.0
    m[P], m[P + 3], m[P + 5] = variance, prior[0] ** 2, prior[1] ** 2
    m[LOG_LOAD] = load
    m[RAMPS], m[TURNS] = 0.0, _TURNS
    m[WAITING] = m[FRESH] = m[POSES] = 0.0
    m[U : U + 3] = 0.0
    if m[FREEDOM] == 0.0:
        m[ENERGY] = m[FREEDOM] = _PRIOR


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
def factor(n: Floats, root: Floats) -> bool:
    """Cholesky factor (6: xx, yx, yy, tx, ty, tt) of a covariance (6: xx, yy, tt, xy, xt, yt); is the turn known?

    If not, tt is NaN.
    """
    root[0] = np.sqrt(n[0])
    root[1] = n[3] / root[0]
    root[2] = np.sqrt(n[1] - root[1] * root[1])
    if np.isnan(n[2]):
        root[3], root[4], root[5] = 0.0, 0.0, np.inf
        return False
    root[3] = n[4] / root[0]
    root[4] = (n[5] - root[3] * root[1]) / root[2]
    root[5] = np.sqrt(n[2] - root[3] * root[3] - root[4] * root[4])
    return True


@kernel
def whiten(root: Floats, e: Floats) -> float:
    """e (3,) over its covariance's factor, in place; gives its square. An unknown turn becomes 0."""
    e[0] /= root[0]
    e[1] = (e[1] - root[1] * e[0]) / root[2]
    e[2] = (e[2] - root[3] * e[0] - root[4] * e[1]) / root[5]
    return e[0] * e[0] + e[1] * e[1] + e[2] * e[2]


@kernel
def predict(dt: float, rise: float, prior: Floats, m: Floats) -> float:
    """The still object after dt in which the logarithm of the load rose by `rise`: b and c fade towards what is usual.

    Gives what is left of b and c. prior: (2,), load_m and creep_m_s.
    """
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
def likelihood(ramp: Floats, energy: float, freedom: float) -> tuple[float, float]:
    """L of one ramp, and Q."""
    place, turn, g = ramp[F], ramp[F + 1], ramp[G]
    q = (ramp[H] * ramp[H] + ramp[H + 1] * ramp[H + 1]) / (place + g) + ramp[H + 2] * ramp[H + 2] / (turn + g)
    left = max(1.0 - q / energy, 1e-12)
    power = -log(1.0 + place / g) - 0.5 * log(1.0 + turn / g) - 0.5 * freedom * log(left)
    return exp(min(power, 600.0)), q


@kernel
def watch(
    t: float,
    y: Floats,
    noise: Floats,
    load: float,
    before_s: float,
    prior: Floats,
    m: Floats,
    ramps: Floats,
    best: Floats,
) -> float:
    """One more pose of an object that was still so far: the sum of Shiryaev and Roberts, s.

    y: (3,), an unknown turn is any number. noise: (6,), its covariance, tt NaN if unknown. load: its logarithm, as before
    if unknown. before_s: time of the pose before. m: (STILL,), ramps: (MOST_RAMPS, RAMP), kept from scan to scan.
    best: (10,), of the likeliest ramp its begin, place now (3,), velocity (3,), the velocity's variance along an axis and
    covariance with the place, and Q.
    """
    dt, rise = t - before_s, load - m[LOG_LOAD]
    m[LOG_LOAD] = load
    keep = predict(dt, rise, prior, m)
    spread = 0.5 * (noise[0] + noise[1]) * scale(m)
    total = m[P] + spread
    gain_a, gain_b, gain_c = m[P] / total, m[P + 1] / total, m[P + 2] / total
    narrow = np.sqrt(spread / total)
    e, root, u = np.empty(3), np.empty(6), np.empty(3)
    turns = turn_counts(y[2], noise, m)
    factor(noise, root)
    known = 3.0 if turns else 2.0
    for axis in range(3):
        e[axis] = y[axis] - m[A + axis] if axis < 2 or turns else 0.0
        u[axis] = e[axis] * narrow
    fresh = whiten(root, u)
    fade = 1.0 - known / _MEMORY
    m[FREEDOM] = fade * m[FREEDOM] + known
    energy = fade * m[ENERGY] + fresh
    m[ENERGY] = min(max(energy, LEAST_SCALE * m[FREEDOM]), MOST_SCALE * m[FREEDOM])
    m[SERIAL] *= fade
    for axis in range(3):
        m[FRESH] += u[axis] * m[U + axis]
        m[U + axis] = u[axis]
    m[POSES] += 1.0
    if m[POSES] == _BLOCK:  # what may be a slip's beginning does not count yet
        m[SERIAL] += m[WAITING]
        m[WAITING], m[FRESH], m[POSES] = m[FRESH], 0.0, 0.0
    energy = m[ENERGY] * drawn_out(m)
    count = int(m[RAMPS])
    ramps[count, :] = 0.0
    ramps[count, T_0], ramps[count, WEIGHT], ramps[count, G] = before_s, dt, (dt / REACH) ** 2
    count += 1
    whole = most = 0.0
    likeliest = 0
    for j in range(count):
        ramp = ramps[j]
        x0, x1, x2 = ramp[ANSWER], ramp[ANSWER + 1], ramp[ANSWER + 2]
        x0, x1, x2 = x0 + rise * x1 + dt * x2, keep * x1, keep * x2
        f = t - ramp[T_0] - x0
        ramp[ANSWER], ramp[ANSWER + 1], ramp[ANSWER + 2] = x0 + gain_a * f, x1 + gain_b * f, x2 + gain_c * f
        f *= narrow
        ramp[F] += f * f
        ramp[F + 1] += f * f if turns else 0.0
        for axis in range(3):
            ramp[H + axis] += f * u[axis]
        ratio, q = likelihood(ramp, energy, m[FREEDOM])
        ratio *= ramp[WEIGHT]
        whole += ratio
        if ratio > most:
            most, likeliest, best[9] = ratio, j, q
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
    _slip(t, ramps[likeliest], root, spread, m, best)
    m[RAMPS] = thinned(t, count, ramps)
    return whole


@kernel
def threshold(alarm_s: float, dt: float, turns: bool) -> float:
    """What the sum must exceed, s, for one false alarm in alarm_s at scans dt apart.

    The sum leaps over a threshold of h scans to many times h, so that alarms come in h / (c h^-p) scans; c and p from a
    simulation of the test itself, see `tests/monitor/test_rate.py`.
    """
    c, p = (0.130, 0.066) if turns else (0.143, 0.052)
    return dt * (c * alarm_s / dt) ** (1.0 / (1.0 + p))


@kernel
def _slip(t: float, ramp: Floats, root: Floats, spread: float, m: Floats, best: Floats) -> None:
    """Fill best, see `watch`, but for Q. root: factor of the noise, spread: its variance."""
    g = ramp[G]
    vx, vy, vt = ramp[H] / (ramp[F] + g), ramp[H + 1] / (ramp[F] + g), ramp[H + 2] / (ramp[F + 1] + g)
    best[0] = ramp[T_0]
    best[4] = root[0] * vx
    best[5] = root[1] * vx + root[2] * vy
    best[6] = root[3] * vx + root[4] * vy + root[5] * vt if root[5] < np.inf else 0.0
    best[7] = spread / (ramp[F] + g)
    lags = t - ramp[T_0] - ramp[ANSWER]  # the still object's place, which the slip has pulled along, is so late
    best[8] = lags * best[7]
    for axis in range(3):
        best[1 + axis] = m[A + axis] + lags * best[4 + axis]


@kernel
def thinned(t: float, count: int, ramps: Floats) -> int:
    """Room for one more: the oldest goes if it is too old, else two old neighbours become one, with the weight of both."""
    if count < MOST_RAMPS:
        return count
    if t - ramps[0, T_0] > max(_OLDEST_S, _OLDEST_SCANS * (t - ramps[count - 1, T_0])):
        drop = 0
    else:
        drop = nearest(t, count, _YOUNG, ramps)
        ramps[drop + 1, WEIGHT] += ramps[drop, WEIGHT]
    for j in range(drop, count - 1):
        ramps[j, :] = ramps[j + 1, :]
    return count - 1


@kernel
def nearest(t: float, count: int, young: int, changes: Floats) -> int:
    """Which of the rows, that begin with a time, is closest to the next beside their age; not one of the `young` last.

    Dropped again and again, these leave rows that stand as far apart as they are old.
    """
    drop, closest = 0, np.inf
    for j in range(count - young - 1):
        apart = (changes[j + 1, 0] - changes[j, 0]) / (t - changes[j + 1, 0])
        if apart < closest:
            drop, closest = j, apart
    return drop
