"""Motion model of a pad's object: whether it rests, what the next scan is predicted from, how its size may change."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taxelflow.estimation.template.online.track_state import Track
from taxelflow.messages import Floats
from taxelflow.numerics.bspline import state_of
from taxelflow.runtime.compiling import lean_kernel


class _Moving(NamedTuple):
    """When an object rests, and how it goes on."""

    moves: float = 0.15
    settles_s: float = 0.2
    """An object rests if it is within this many pitches of its low-passed place, whose time constant this is."""
    persists_s: float = 1.0
    """Time constant of the mean products of consecutive steps, from which persistence is estimated."""


_MOVING = _Moving()


class _Growth(NamedTuple):
    """A contact that grows with its load."""

    stays: float = 0.5
    """Only an object that has stayed within this many pitches, while keyframes came, may be seen to grow."""
    std: float = 0.5
    least_std: float = 0.002
    first_std: float = 0.1
    """Change of the size's logarithm from scan to scan, per change of the load's, and at least; and where it first
    shows."""


GROWTH = _Growth()


@lean_kernel
def is_at_rest(m: Track, span: float) -> bool:
    """Whether the object rests; updates its low-passed place."""
    now = state_of(m.state)
    away = np.hypot(now.x - m.place[0], now.y - m.place[1])
    away += m.radius * abs(now.theta - m.place[2])
    still = m.continues and away < _MOVING.moves + 3.0 * np.sqrt(1.0 / m.step[0, 0] + 1.0 / m.step[1, 1])
    follows = 1.0 - np.exp(-span / _MOVING.settles_s) if m.continues else 1.0
    for a in range(3):
        m.place[a] += follows * (m.state[a] - m.place[a])
    return bool(still)


@lean_kernel
def update_motion(t: float, span: float, last: Floats, middle: Floats, m: Track) -> None:
    """Update velocity, persistence, and the centre of pressure that the next scan is predicted from."""
    if span > 0.0:
        faded, product, square = np.exp(-span / _MOVING.persists_s), 0.0, 0.0
        for a in range(3):
            speed, arm = (m.state[a] - last[a]) / span, m.radius if a == 2 else 1.0
            product += arm * arm * speed * m.speed[a]
            square += arm * arm * m.speed[a] * m.speed[a]
            m.speed[a] = speed
        m.persistence[0] = faded * m.persistence[0] + product
        m.persistence[1] = faded * m.persistence[1] + square
    m.last_t = t
    m.centroid[0], m.centroid[1], m.border, m.load = middle[0], middle[1], middle[2], middle[3]


@lean_kernel
def growth_std(before: float, load: float) -> float:
    """How far the size's logarithm may go with a change of the load."""
    pressed = abs(np.log(load / before)) if load > 0.0 and before > 0.0 else 1.0
    return float(GROWTH.std * pressed + GROWTH.least_std)
