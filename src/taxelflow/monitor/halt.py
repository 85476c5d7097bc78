"""When a slip ends: the odds that the object has stopped against those that it goes on, from its poses.

Going on is a Kalman filter of place and velocity; stopped since scan j is a place that no longer moves. A stop may come at
any time, at a rate that is about one over the duration of a slip: with L_j the likelihood ratio of a stop after scan j, the
odds are sum_j rate dt_j L_j (Shiryaev). A stop told late costs a scan or two, one told too early may be taken back: the slip
goes on in doubt until the odds are clear.
"""

from __future__ import annotations

from math import exp, log

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.messages import Floats
from taxelflow.monitor.onset import factor, nearest, whiten

# The slip, per pad. PLACE, SPEED: (3,) along x, y, theta. Q: their covariance pp, pv, vv of a translation, m^2, m^2/s, ...
PLACE, SPEED, Q, BEGAN, FROM, STOPS, DOUBT, TURNED, SLIDE = 0, 3, 6, 9, 10, 13, 14, 15, 16
# A stop: after which scan, its share of the odds without L, log L, place (3), its variance.
T_0, WEIGHT, LOG_L, REST, REST_VAR, STOP = 0, 1, 2, 3, 6, 7
_RATE = 3.0
"""Stops per second of slip."""
_AGILITY = 0.002
"""Standard deviation by which a slip's velocity changes in a second, m/s; in other times as their root."""
MOST_STOPS, _YOUNG = 12, 6


@kernel
def set_off(t: float, slip: Floats, variance: float, m: Floats) -> None:
    """The object slips, at t, as `onset.watch` has found (its `best`).

    variance: of the place, but for the velocity's part.
    """
    m[BEGAN], m[STOPS], m[DOUBT], m[TURNED] = slip[0], 0.0, 0.0, 0.0
    for axis in range(3):
        m[PLACE + axis], m[SPEED + axis] = slip[1 + axis], slip[4 + axis]
        m[FROM + axis] = slip[1 + axis] - (t - slip[0]) * slip[4 + axis]
    late = slip[8] / slip[7]
    m[Q], m[Q + 1], m[Q + 2] = variance + late * slip[8], slip[8], slip[7]


@kernel
def slide(
    t: float,
    y: Floats,
    noise: Floats,
    spread: float,
    before_s: float,
    m: Floats,
    stops: Floats,
    rest: Floats,
) -> float:
    """One more pose of an object that slipped so far: the odds that it has stopped.

    y, noise, before_s: as `onset.watch`; noise: scaled to what is seen, spread: mean of its xx and yy.
    m: (SLIDE,), stops: (MOST_STOPS, STOP), kept from scan to scan. rest: (5,), time of the likeliest stop, place there (3,) and its variance.
    """
    dt = t - before_s
    root, e = np.empty(6), np.empty(3)
    turns = factor(noise, root)
    half = 1.5 if turns else 1.0
    count = int(m[STOPS])
    if count == MOST_STOPS:
        drop = nearest(t, count, _YOUNG, stops)
        stops[drop + 1, WEIGHT] += stops[drop, WEIGHT]
        for j in range(drop, count - 1):
            stops[j, :] = stops[j + 1, :]
        count -= 1
    stop = stops[count]
    stop[T_0], stop[WEIGHT], stop[LOG_L] = before_s, _RATE * dt, 0.0
    way = dt * np.hypot(m[SPEED], m[SPEED + 1])
    stop[REST_VAR] = m[Q] + way * way / 12.0  # it stopped somewhere between two scans
    for axis in range(3):
        stop[REST + axis] = m[PLACE + axis] + 0.5 * dt * m[SPEED + axis]
    count += 1
    m[STOPS] = count
    pp, pv, vv = m[Q], m[Q + 1], m[Q + 2]
    vv += _AGILITY**2 * dt
    pp, pv = pp + 2.0 * dt * pv + dt * dt * vv, pv + dt * vv
    total = pp + spread
    for axis in range(3):
        m[PLACE + axis] += dt * m[SPEED + axis]
        e[axis] = y[axis] - m[PLACE + axis] if axis < 2 or turns else 0.0
        m[PLACE + axis] += pp / total * e[axis]
        m[SPEED + axis] += pv / total * e[axis]
    going = -0.5 * whiten(root, e) * spread / total - half * log(total / spread)
    m[Q], m[Q + 1], m[Q + 2] = pp * spread / total, pv * spread / total, vv - pv * pv / total
    odds = most = 0.0
    for j in range(count):
        stop = stops[j]
        total = stop[REST_VAR] + spread
        for axis in range(3):
            e[axis] = y[axis] - stop[REST + axis] if axis < 2 or turns else 0.0
            stop[REST + axis] += stop[REST_VAR] / total * e[axis]
        stop[LOG_L] += -0.5 * whiten(root, e) * spread / total - half * log(total / spread) - going
        stop[REST_VAR] *= spread / total
        share = stop[WEIGHT] * exp(min(stop[LOG_L], 600.0))
        odds += share
        if share > most:
            most = share
            rest[0] = stop[T_0] + 0.5 * stop[WEIGHT] / _RATE
            rest[1:5] = stop[REST : REST_VAR + 1]
    return odds
