"""What a pad has learned, and is learning beside the stream."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.template.online.map_update import learn
from taxelflow.numerics.bspline import GAIN, THETA

if TYPE_CHECKING:
    from collections.abc import Iterable
    from concurrent.futures import Executor, Future

    from taxelflow.estimation.template.online.local_map import Learned
    from taxelflow.messages import Floats

_LIBRARY = 4
"""Patterns of former contacts that a pad remembers."""
_YOUNG, _YOUNG_LATENCY = 12, 0.2
"""A pattern of few keyframes is learned faster, and adopted after this share of the usual time."""


class Novel(NamedTuple):
    """A scan to be learned from: reading and variance (taxels,), bend (3, taxels) or (3, 0), the state (5,) in which it
    was registered.
    """

    t_s: float
    reading: Floats
    variance: Floats
    bend: Floats
    state: Floats


class Learner:
    """A pad's pattern, those that it had before, and scans on their way to become keyframes.

    learned: the pattern that scans are registered on. library: former ones. due_s: when that which is being learned is
    to be adopted, infinite if nothing is.
    """

    def __init__(self, worker: Executor, latency_s: float) -> None:
        self.learned: Learned | None = None
        self.library: list[Learned] = []
        self.due_s = np.inf
        self._worker, self._latency_s = worker, latency_s
        self._job: Future[Learned] | None = None
        self._waiting: list[Novel] = []
        self._newest: Floats | None = None

    @property
    def learning(self) -> bool:
        """Whether a pattern is being learned, or waits to be adopted."""
        return self._job is not None

    def learn_from(self, scan: Novel) -> None:
        """One more, when what is being learned has been adopted."""
        self._waiting.append(scan)

    def go_on(self, now_s: float, *, may_turn: bool) -> None:
        """Begin to learn from what waits, if nothing is being learned."""
        known = self.learned
        if known is None or self._job is not None or not self._waiting:
            return
        keyframes = known.keyframes
        for scan in self._waiting:
            keyframes = keyframes.with_scan(*scan)
        start_s, fresh = self._waiting[-1].t_s, len(self._waiting)
        self._waiting, self._newest = [], keyframes.states[-1]
        work = replace(
            known, keyframes=keyframes, fresh=fresh, looked=0 if may_turn and not known.turns else known.looked
        )
        self._job = self._worker.submit(learn, work)
        share = _YOUNG_LATENCY if len(keyframes) < _YOUNG else 1.0
        self.due_s = max(start_s, now_s) + share * self._latency_s

    def taken(self) -> Learned | None:
        """What was being learned, None if nothing was; one waits for it if it is not ready."""
        job, self._job, self.due_s = self._job, None, np.inf
        return job.result() if job is not None else None

    def settle(self) -> float:
        """Take what is being learned when a contact, or its pattern, ends; by how much its theta differs."""
        self._waiting = []
        new = self.taken()
        if new is None:
            return 0.0
        self.learned = new
        return new.turned

    def end(self) -> None:
        """The contact has ended; its pattern may come again."""
        if self.learned is not None and self.learned.mature:
            self.library = [*self.library, self.learned][-_LIBRARY:]
        self.learned = None

    def take_over(self, new: Learned, states: Iterable[Floats]) -> None:
        """Carry states (5,), in place, and those of the scans that wait, into the frame of a pattern that grows.

        Its origin, its size and its gain have changed as they have for the newest keyframe.
        """
        if self._newest is None:
            return
        last = new.keyframes.states[-1]
        step, louder = last - self._newest, last[GAIN] / self._newest[GAIN]
        step[[THETA, GAIN]] = 0.0
        for state in (*states, *(scan.state for scan in self._waiting)):
            state[:] = state + step
            state[GAIN] *= louder
