"""When a still object begins to slip: a test whose mean time between false alarms is what the user asks for.

A slip after scan j with velocity v adds v f_jk to the innovations u_k of `still`, where f_jk is how the filter answers
a ramp that begins at t_j (Willsky & Jones 1976), over the innovation's standard deviation. With v integrated out, which
is N(0, (s reach / dt)^2) along every axis of u, and s too, the likelihood ratio of that slip is
    L_j = (1 + F_j / g)^(-n/2) (1 - Q_j / E)^(-nu/2),   F_j = sum f^2, h_j = sum f u, g = (dt / reach)^2,
    Q_j = |h_j|^2 / (F_j + g),   E = sum |u|^2 over nu components; n = 1 to 3 components to a pose.
The alarm is that of Shiryaev and Roberts: the sum over j of L_j times the time since the scan before. While the object
is still each L_j has mean 1, so the sum less the time that has passed is a martingale, and the mean time to a false
alarm is at least the threshold, whatever the rate of scans (Pollak 1987); `threshold` makes "at least" "about".
"""

from __future__ import annotations

from math import exp, log

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.messages import Floats
from taxelflow.slip.rest_filter import (
    AXES,
    FREEDOM,
    GAIN,
    KEEP,
    NARROW,
    RISE,
    ROOT,
    SPREAD,
    TURN_COUNTS,
    WHITE,
    A,
    drawn_out,
    scale,
)

# A ramp: begin, weight, the filter's answer to it (a, b, c), F for place and turn, h (3), g, F if nothing answered.
T_0, WEIGHT, ANSWER, F, H, G, WHOLE, RAMP = 0, 1, 2, 5, 7, 10, 11, 12
# A slip: begin, place now (3), velocity (3), the velocity's variance along an axis and covariance with the place, Q.
BEGIN, PLACE_NOW, VELOCITY, VARIANCE, LATE, ENERGY_OF, SLIP = 0, 1, 4, 7, 8, 9, 10

REACH = 2.0
"""A usual slip moves by so many standard deviations of a pose from scan to scan; others are found too."""
_SEEN = 0.1
"""Least share of a slip's F that the filter must leave: a third of its way. What is left of one that it takes for what
load does follows the scatter of the load, which has something in common with the pose's.
"""
MOST_RAMPS, _YOUNG = 20, 8
"""Ramps followed at a time, and how many of the last are never merged."""
_OLDEST_S, _OLDEST_SCANS = 2.0, 64


@kernel
def likelihood(ramp: Floats, energy: float, freedom: float, axes: float) -> tuple[float, float]:
    """L of one ramp, and Q. axes: how many of x and y are known."""
    place, turn, g = ramp[F], ramp[F + 1], ramp[G]
    q = (ramp[H] * ramp[H] + ramp[H + 1] * ramp[H + 1]) / (place + g) + ramp[H + 2] * ramp[H + 2] / (turn + g)
    left = max(1.0 - q / energy, 1e-12)
    power = -0.5 * axes * log(1.0 + place / g) - 0.5 * log(1.0 + turn / g) - 0.5 * freedom * log(left)
    return exp(min(power, 600.0)), q


@kernel
def weigh(t: float, before_s: float, step: Floats, m: Floats, count: int, ramps: Floats, slip: Floats) -> float:
    """One more pose at t, and what `still.innovate` made of it: the sum of Shiryaev and Roberts, s.

    before_s: time of the pose before. count: ramps so far; one more begins. slip: (SLIP,), filled from the likeliest.
    """
    dt, keep, narrow = t - before_s, step[KEEP], step[NARROW]
    energy = m[FREEDOM] * scale(m) * drawn_out(m)
    ramps[count, :] = 0.0
    ramps[count, T_0], ramps[count, WEIGHT], ramps[count, G] = before_s, dt, (dt / REACH) ** 2
    whole = most = 0.0
    likeliest = 0
    for j in range(count + 1):
        ramp = ramps[j]
        ramp[ANSWER] += step[RISE] * ramp[ANSWER + 1] + dt * ramp[ANSWER + 2]
        ramp[ANSWER + 1] *= keep
        ramp[ANSWER + 2] *= keep
        f = t - ramp[T_0] - ramp[ANSWER]
        for k in range(3):
            ramp[ANSWER + k] += step[GAIN + k] * f
        f *= narrow
        ramp[F] += f * f
        ramp[WHOLE] += ((t - ramp[T_0]) * narrow) ** 2
        ramp[F + 1] += f * f * step[TURN_COUNTS]
        for axis in range(3):
            ramp[H + axis] += f * step[WHITE + axis]
        ratio, q = likelihood(ramp, energy, m[FREEDOM], step[AXES])
        ratio *= ramp[WEIGHT] if ramp[F] > _SEEN * ramp[WHOLE] else 0.0
        whole += ratio
        if ratio > most:
            most, likeliest, slip[ENERGY_OF] = ratio, j, q
    _describe(t, ramps[likeliest], step, m, slip)
    return whole


@kernel
def _describe(t: float, ramp: Floats, step: Floats, m: Floats, slip: Floats) -> None:
    """Fill slip (SLIP,) from a ramp, but for Q."""
    g, root = ramp[G], step[ROOT : ROOT + 6]
    vx, vy, vt = ramp[H] / (ramp[F] + g), ramp[H + 1] / (ramp[F] + g), ramp[H + 2] / (ramp[F + 1] + g)
    slip[BEGIN] = ramp[T_0]
    slip[VELOCITY] = root[0] * vx if root[0] < np.inf else 0.0
    slip[VELOCITY + 1] = root[1] * vx + root[2] * vy if root[2] < np.inf else 0.0
    slip[VELOCITY + 2] = root[3] * vx + root[4] * vy + root[5] * vt if root[5] < np.inf else 0.0
    slip[VARIANCE] = step[SPREAD] / (ramp[F] + g)
    behind_s = t - ramp[T_0] - ramp[ANSWER]  # the still object's place has followed the slip, but so late
    slip[LATE] = behind_s * slip[VARIANCE]
    for axis in range(3):
        slip[PLACE_NOW + axis] = m[A + axis] + behind_s * slip[VELOCITY + axis]


@kernel
def threshold(alarm_s: float, dt: float, components: float) -> float:
    """What the sum must exceed, s, for one false alarm in alarm_s at scans dt apart; components: of a pose, 1 to 3.

    The sum leaps over a threshold of h scans to many times h, so that alarms come every h / (c h^-p) scans; c and p
    are from a simulation of the test itself, see `tests/monitor/test_rate.py`.
    """
    c, p = (0.130, 0.066) if components == 3.0 else (0.143, 0.052) if components == 2.0 else (0.235, 0.050)
    return float(dt * (c * alarm_s / dt) ** (1.0 / (1.0 + p)))


@kernel
def thinned(t: float, count: int, ramps: Floats) -> int:
    """Room for one more: the oldest goes if it is too old, else two old neighbours become one, which weighs as both.

    Were the oldest merged, it would never grow older, and weigh more the longer an object is still: so would alarms.
    """
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
    """Which of the rows, that begin with a time, leaves the smallest gap beside its age; not the first, nor one of the
    `young` last.

    Dropped again and again, these leave rows that stand as far apart as they are old.
    """
    drop, closest = 1, np.inf
    for j in range(1, count - young - 1):
        apart = (changes[j + 1, 0] - changes[j - 1, 0]) / (t - changes[j + 1, 0])
        if apart < closest:
            drop, closest = j, apart
    return drop
