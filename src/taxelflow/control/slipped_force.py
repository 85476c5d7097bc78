"""Lower limit of a grip that relaxes: the force at which the object slipped before.

Relaxing until the object slips measures its weight, but each slip moves it by 0.5 to 2 mm. So the force of the last
slip is remembered. A lower force is tried again after a time, because the load may have fallen, and after twice that
time if the object slips again: about ten slips in an hour instead of a thousand.
"""

from __future__ import annotations


class SlippedForce:
    """The largest force at which the object accelerated, until a lower force is tried again."""

    def __init__(self, again_s: float) -> None:
        """again_s: time without slip after which a lower force is tried."""
        self._first_s = self._wait_s = again_s
        self._force_n, self._last_s = 0.0, 0.0

    def add(self, t_s: float, force_n: float) -> None:
        """The object accelerates, or begins to move, at this measured force."""
        if self.force_n(t_s) > 0.0:
            self._force_n = max(self._force_n, force_n)
        else:
            self._wait_s = self._first_s if force_n > self._force_n else 2.0 * self._wait_s
            self._force_n = force_n
        self._last_s = t_s

    def force_n(self, t_s: float) -> float:
        """That force, N; 0 before the first slip, and when a lower force may be tried."""
        return self._force_n if t_s - self._last_s < self._wait_s else 0.0
