"""When a slip ends: the odds that the object has stopped against those that it goes on, from its poses.

Going on is a Kalman filter of place and velocity; stopped since scan j is a place that no longer moves. A stop may come
at any time, at a rate that is about one over the duration of a slip: with L_j the likelihood ratio of a stop after scan
j, the odds are sum_j rate dt_j L_j (Shiryaev). A stop told late costs a scan or two; one told too early may be taken
back: until the odds are clear the slip goes on in doubt.
"""

from __future__ import annotations

from math import exp, log

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.messages import Floats
from taxelflow.slip.onset import BEGIN, LATE, PLACE_NOW, VARIANCE, VELOCITY, nearest
from taxelflow.slip.rest_filter import axes_of, factor, spread, whiten

# Memory per pad. PLACE, SPEED: (3,) along x, y, theta. Q: their covariance pp, pv, vv of a translation, m^2, m^2/s...
# BEGAN, FROM: when and where (3,). STOPS: how many are followed. DOUBT: it may have stopped. LOST_TURN: the turn was
# not known all the time, so that it does not count.
PLACE, SPEED, Q, BEGAN, FROM, STOPS, DOUBT, LOST_TURN, SLIDE = 0, 3, 6, 9, 10, 13, 14, 15, 16
# A stop: after which scan, its share of the odds without L, log L, place (3), its variance.
T_0, WEIGHT, LOG_L, REST, REST_VAR, STOP = 0, 1, 2, 3, 6, 7
# Where it rests: since when, place (3), its variance.
SINCE, AT, AT_VAR, RESTS = 0, 1, 4, 5
_RATE = 3.0
"""Stops per second of slip."""
_AGILITY = 0.002
"""Standard deviation by which a slip's velocity changes in a second, m/s; in other times as their root."""
_ERRS = 0.1
"""Share of an object's way by which its pose errs, beyond the noise of a still one."""
MOST_STOPS, _YOUNG = 12, 6


@kernel
def set_off(t: float, before_s: float, slip: Floats, variance: float, m: Floats) -> None:
    """The object slips, at t, as `onset.weigh` has found.

    before_s: time of the pose before. variance: of the place, but for the velocity's part.
    """
    m[BEGAN], m[STOPS], m[DOUBT], m[LOST_TURN] = slip[BEGIN], 0.0, 0.0, 0.0
    for axis in range(3):
        m[PLACE + axis], m[SPEED + axis] = slip[PLACE_NOW + axis], slip[VELOCITY + axis]
        m[FROM + axis] = slip[PLACE_NOW + axis] - (t - slip[BEGIN]) * slip[VELOCITY + axis]
    behind_s = slip[LATE] / slip[VARIANCE]
    m[Q], m[Q + 1], m[Q + 2] = variance + behind_s * slip[LATE], slip[LATE], slip[VARIANCE]
    unsure = 0.5 * (t - before_s) / (t - slip[BEGIN])  # it began somewhere between two poses
    m[Q + 2] += (unsure * unsure) * (m[SPEED] ** 2 + m[SPEED + 1] ** 2)


@kernel
def has_leapt(
    y: Floats, way: Floats, rested_s: float, arrived_s: float, dt: float, variance: float, m: Floats, stops: Floats
) -> None:
    """The object has slipped, as `leap` has found, and rests again: a stop is all that it can have come to.

    y: (3,), where it is, known with this variance. way: (2,) from where it was. rested_s, arrived_s: of the last pose
    there and the first here; scans are dt apart. It began a quarter of dt after the one and ended as long before the
    other.
    """
    began_s, ended_s = rested_s + 0.25 * dt, arrived_s - 0.25 * dt
    m[BEGAN], m[STOPS], m[DOUBT], m[LOST_TURN] = began_s, 1.0, 0.0, 1.0
    m[PLACE + 2] = m[FROM + 2] = y[2]
    m[SPEED + 2] = 0.0
    for axis in range(2):
        m[PLACE + axis], m[FROM + axis] = y[axis], y[axis] - way[axis]
        m[SPEED + axis] = way[axis] / (ended_s - began_s)
    m[Q], m[Q + 1], m[Q + 2] = variance, 0.0, 0.0
    stop = stops[0]
    stop[T_0], stop[WEIGHT], stop[LOG_L], stop[REST_VAR] = ended_s - 0.5 * dt, _RATE * dt, 0.0, variance
    stop[REST : REST + 3] = y


@kernel
def slide(
    t: float, y: Floats, noise: Floats, before_s: float, creep_m_s: float, m: Floats, stops: Floats, rests: Floats
) -> float:
    """One more pose of an object that slipped so far: the odds that it has stopped.

    y: (3,), noise: (6,), NaN where one does not count, as `still.innovate`, but scaled to what is seen. before_s:
    time of the pose before. creep_m_s: a slip is faster than three times this. m: (SLIDE,), stops: (MOST_STOPS, STOP),
    kept from scan to scan. rests: (RESTS,), filled from the likeliest stop.
    """
    dt, own = t - before_s, spread(noise)
    root, e = np.empty(6), np.zeros(3)
    turns = factor(noise, root)
    axes = axes_of(noise) + (1.0 if turns else 0.0)
    count = _one_more(t, before_s, m, stops)
    pp, pv, vv = m[Q], m[Q + 1], m[Q + 2] + _AGILITY**2 * dt
    way = dt * np.hypot(m[SPEED], m[SPEED + 1])
    pp, pv = pp + 2.0 * dt * pv + dt * dt * vv + (_ERRS * way) ** 2, pv + dt * vv
    total = pp + own
    for axis in range(3):
        m[PLACE + axis] += dt * m[SPEED + axis]
    for axis in range(3):
        e[axis] = y[axis] - m[PLACE + axis] if not np.isnan(noise[axis]) else 0.0
        m[PLACE + axis] += pp / total * e[axis]
        m[SPEED + axis] += pv / total * e[axis]
    m[Q], m[Q + 1], m[Q + 2] = pp * own / total, pv * own / total, vv - pv * pv / total
    going = -0.5 * whiten(root, e) * own / total - 0.5 * axes * log(total / own)
    rests[SINCE], rests[AT_VAR] = t, m[Q]
    rests[AT : AT + 3] = m[PLACE : PLACE + 3]
    odds = most = 0.0
    for j in range(count):
        stop = stops[j]
        total = stop[REST_VAR] + own
        for axis in range(3):
            e[axis] = y[axis] - stop[REST + axis] if not np.isnan(noise[axis]) else 0.0
            stop[REST + axis] += stop[REST_VAR] / total * e[axis]
        stop[LOG_L] += -0.5 * whiten(root, e) * own / total - 0.5 * axes * log(total / own) - going
        stop[REST_VAR] *= own / total
        share = stop[WEIGHT] * exp(min(stop[LOG_L], 600.0))
        odds += share
        if share > most:
            most, rests[SINCE], rests[AT_VAR] = share, stop[T_0] + 0.5 * stop[WEIGHT] / _RATE, stop[REST_VAR]
            rests[AT : AT + 3] = stop[REST : REST + 3]
    turn_m = m[SPEED + 2] * np.sqrt(own / noise[2]) if turns else 0.0
    speed = np.sqrt(m[SPEED] ** 2 + m[SPEED + 1] ** 2 + turn_m**2) + np.sqrt(m[Q + 2])
    return odds if speed > 3.0 * creep_m_s else np.inf


@kernel
def _one_more(t: float, before_s: float, m: Floats, stops: Floats) -> int:
    """A stop after the pose before, somewhere on the way to this one; gives how many are followed now."""
    count, dt = int(m[STOPS]), t - before_s
    if count == MOST_STOPS:
        drop = nearest(t, count, _YOUNG, stops)
        stops[drop + 1, WEIGHT] += stops[drop, WEIGHT]
        for j in range(drop, count - 1):
            stops[j, :] = stops[j + 1, :]
        count -= 1
    stop = stops[count]
    stop[T_0], stop[WEIGHT], stop[LOG_L] = before_s, _RATE * dt, 0.0
    way = dt * np.hypot(m[SPEED], m[SPEED + 1])
    stop[REST_VAR] = m[Q] + way * way / 12.0
    for axis in range(3):
        stop[REST + axis] = m[PLACE + axis] + 0.5 * dt * m[SPEED + axis]
    m[STOPS] = count + 1
    return count + 1
