"""Export of the maps of contacts that have ended, beside the stream where it must not wait."""

from __future__ import annotations

from collections import deque
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.deforming import Moment
from taxelflow.estimation.template.map_export import Maps, as_map
from taxelflow.estimation.template.online.witness import reported_place
from taxelflow.numerics.bspline import state_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from concurrent.futures import Future

    from taxelflow.estimation.template.online.local_map import LocalMap
    from taxelflow.estimation.template.online.track_state import Track
    from taxelflow.messages import LearnedPattern
    from taxelflow.runtime.worker import Runs

    Work = Callable[[], LearnedPattern | None]


_MOST_WAITING = 64
"""Contacts whose maps wait to be made, at most, those of most scans: their scans are held for it. While something is
being learned, no map is made until half as many wait."""


def map_of(pad: str, known: LocalMap, m: Track, pitch_m: float) -> Work:
    """What makes the map of a contact on a pad that has ended."""
    states = known.keyframes.states
    theta = state_of(states[-1]).theta - (m.theta_0 if known.turns else 0.0)
    pose = np.append(pitch_m * reported_place(m, states[-1]), theta)
    whole = Moment(known.pattern, known.scanned, states, np.arange(len(states)), known.turns)
    return partial(as_map, pad, whole, pose, known.error, pitch_m, np.zeros(0, np.int64))


class Ended:
    """kept: the maps that are done. at_once: make them where they are asked for."""

    def __init__(self, worker: Runs, *, at_once: bool) -> None:
        self.kept = Maps()
        self._worker, self._at_once = worker, at_once
        self._waiting: deque[tuple[int, Work]] = deque()
        self._making: Future[LearnedPattern | None] | None = None

    @property
    def waiting(self) -> bool:
        """Whether any map is not done."""
        return self._making is not None or bool(self._waiting)

    def add(self, work: Work, scans: int) -> None:
        """One more, by this function, from a number of scans."""
        if self._at_once:
            self._keep(work())
            return
        self._waiting.append((scans, work))
        if len(self._waiting) > _MOST_WAITING:
            self._waiting.remove(min(self._waiting, key=itemgetter(0)))

    def go_on(self, *, busy: bool) -> None:
        """Keep what is done, and begin the next when nothing more urgent is going on."""
        if self._making is not None and self._making.done():
            self._keep(self._making.result())
            self._making = None
        if self._making is None and self._waiting and (not busy or 2 * len(self._waiting) > _MOST_WAITING):
            self._making = self._worker.submit(self._waiting.popleft()[1])

    def finish(self) -> None:
        """Wait for all."""
        while self.waiting:
            self.go_on(busy=False)
            if self._making is not None:
                self._making.result()

    def _keep(self, found: LearnedPattern | None) -> None:
        if found is not None:
            self.kept.keep(found)
