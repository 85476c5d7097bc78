"""How far a grip may be relaxed: not to a force under which the object has slipped before.

Relaxing until the object slips weighs it, but each time it slides on, by half a millimetre or two. So the force under
which it slipped is remembered. It is tried again after a time, since the load may have fallen, and after twice that
time if the object slips there once more: in an hour an object slips ten times, not a thousand.
"""

from __future__ import annotations


class SlippedForce:
    """The greatest force under which the object has sped up, until it is to be tried again."""

    def __init__(self, again_s: float) -> None:
        """again_s: time without slip after which a lower force is tried."""
        self._first_s = self._wait_s = again_s
        self._force_n, self._last_s = 0.0, 0.0

    def add(self, t_s: float, force_n: float) -> None:
        """The object speeds up, or begins to move, under that felt force."""
        if self.force_n(t_s) > 0.0:
            self._force_n = max(self._force_n, force_n)
        else:
            self._wait_s = self._first_s if force_n > self._force_n else 2.0 * self._wait_s
            self._force_n = force_n
        self._last_s = t_s

    def force_n(self, t_s: float) -> float:
        """That force, N; 0 before the first slip, and if it is to be tried again."""
        return self._force_n if t_s - self._last_s < self._wait_s else 0.0
