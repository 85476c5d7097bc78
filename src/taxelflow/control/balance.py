"""The least force that holds an object, from its acceleration while it slips: its load less the friction.

While an object of mass m slips along the pads, m a = L - 2 mu F with its load L, a positive where it speeds up. The
least force F* carries the load without acceleration, 2 mu F* = L. So with w = L / m, the acceleration of the object if
it were let go,

    F* = F / (1 - a / w),    and    F = F* (1 + d / w)

slows it down by d. Neither mass nor friction need be known: a slip of some scans measures what the grip needs.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from taxelflow.numerics.gravity import G_M_S2

_LARGEST_SHARE = 0.7
"""Upper limit of a / w: beyond it the grip is practically open."""
_LOOK_BACK = 4
"""Scans over which the acceleration is measured."""


class Balance:
    """Speeds and forces of the last scans. free: w, m/s^2 of a slide or rad/s^2 of a turn."""

    def __init__(self, free: float = G_M_S2) -> None:
        self._free = free
        self._seen: deque[tuple[float, float, float]] = deque(maxlen=_LOOK_BACK)

    def add(self, t_s: float, speed: float, force_n: float) -> None:
        """A scan: the speed of the motion, and the force that was felt."""
        self._seen.append((t_s, speed, force_n))

    def least_n(self) -> float:
        """Least force that carries the load, from the acceleration under the force that was felt meanwhile, N."""
        t_s, speed, force_n = np.array(self._seen).T
        rising = float(np.polyfit(t_s - t_s[0], speed, 1)[0]) if len(t_s) > 1 else 0.0
        share = float(np.clip(rising / self._free, -_LARGEST_SHARE, _LARGEST_SHARE))
        return float(force_n.mean() / (1.0 - share))


class Shown:
    """Least force that slips have shown: the mean over their scans by the square of the speed, which fades with time.

    As a slip ends its acceleration vanishes, and the balance gives the felt force. An image that settles under a
    new force shows slow motion that is none, and gives the same. Fast scans know more.
    """

    def __init__(self, memory_s: float) -> None:
        self._memory_s, self._last_s = memory_s, -np.inf
        self._weight = self._weighed = 0.0

    def add(self, t_s: float, speed: float, least_n: float) -> None:
        """A scan of a slip."""
        kept, self._last_s = float(np.exp((self._last_s - t_s) / self._memory_s)), t_s
        self._weight = kept * self._weight + speed**2
        self._weighed = kept * self._weighed + speed**2 * least_n

    def least_n(self) -> float:
        """Least force by now, N; 0 before the first slip."""
        return self._weighed / self._weight if self._weight > 0.0 else 0.0
