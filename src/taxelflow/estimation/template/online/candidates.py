"""Keyframe candidates: scans that a map is to learn from, and that wait while it learns from others."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.numerics.bspline import STATE

if TYPE_CHECKING:
    from taxelflow.messages import Floats


class Candidates(NamedTuple):
    """Keyframe candidates, oldest first: times (n,), readings and variances (n, taxels), bends (n, 3, taxels) or
    (n, 3, 0), and registered states (n, 5). Arrays of all, which are sent to a process in a tenth of the time.
    """

    t_s: Floats
    readings: Floats
    variance: Floats
    bends: Floats
    states: Floats


class Waiting:
    """Candidates on their way to become keyframes; at 1 kHz hundreds wait.

    left: number removed since the start. Their states move with the map in use; those of a request stay.
    """

    def __init__(self, least: int = 64) -> None:
        """least: how many there is room for at first."""
        self.left = self._count = 0
        self._least = least
        self._room: Candidates | None = None

    def __len__(self) -> int:
        return self._count

    @property
    def all(self) -> Candidates:
        """Views of all, to be changed in place."""
        room = self._room or Candidates(
            np.zeros(0), *(np.zeros((0, 0)),) * 2, np.zeros((0, 3, 0)), np.zeros((0, STATE))
        )
        return Candidates(*(part[: self._count] for part in room))

    def add(self, t_s: float, reading: Floats, variance: Floats, bend: Floats, state: Floats) -> None:
        """One more: reading and variance (taxels,), bend (3, taxels) or (3, 0), state (5,)."""
        room, place = self._room, self._count
        if room is None:
            shapes = (), reading.shape, variance.shape, bend.shape, state.shape
            room = self._room = Candidates(*(np.zeros((self._least, *shape)) for shape in shapes))
        elif place == len(room.t_s):
            room = self._room = Candidates(*(np.concatenate([part, np.zeros_like(part)]) for part in room))
        room.t_s[place], room.readings[place], room.variance[place] = t_s, reading, variance
        room.bends[place], room.states[place] = bend, state
        self._count += 1

    def leave(self, until: int) -> int:
        """Remove the oldest, so that `left` is at least `until`; the number removed."""
        gone = max(until - self.left, 0)
        for part in self.all if gone else ():
            part[: len(part) - gone] = part[gone:].copy()
        self._count -= gone
        self.left += gone
        return gone
