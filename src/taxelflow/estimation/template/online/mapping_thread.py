"""Mapping beside the stream: a pad's map, its former maps, and the keyframes that wait to be added."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.template.online.candidates import Candidates, Waiting
from taxelflow.estimation.template.online.gauge import Reported
from taxelflow.estimation.template.online.map_update import learn
from taxelflow.estimation.template.online.track_state import KEYFRAMES
from taxelflow.numerics.bspline import State, state_of
from taxelflow.runtime.adoption import Lane

if TYPE_CHECKING:
    from collections.abc import Callable

    from taxelflow.estimation.template.online.local_map import LocalMap
    from taxelflow.estimation.template.online.starting import Begun
    from taxelflow.messages import Floats
    from taxelflow.runtime.adoption import Adopting
    from taxelflow.runtime.worker import Runs

_LIBRARY = 4
"""Patterns of former contacts that a pad remembers."""
_YOUNG_LATENCY = 0.2
"""A young map is learned faster, and adopted after this share of the usual time."""


class Workers(NamedTuple):
    """mapper: adjusts maps of many keyframes, which takes long. starter: makes the first map of a contact, which must
    not wait for that.
    """

    mapper: Runs
    starter: Runs


class Learner:
    """A pad's map, its former maps, and keyframe candidates.

    learned: the map that scans are registered to. library: former maps. reported: where its keyframes were reported.
    waiting: what the map in use was not learned from. lane: what is being computed. beginning: whether that is the
    first map of a contact.
    """

    def __init__(self, pad: str, workers: Workers, latency_s: float, adopting: Adopting) -> None:
        self.learned: LocalMap | None = None
        self.library: list[LocalMap] = []
        self.lane = Lane(pad, adopting)
        self.reported = Reported()
        self.beginning = False
        self.waiting = Waiting()
        self._workers, self._latency_s = workers, latency_s
        self._asked = 0  # of these, how many the newest request has
        self._newest: Floats | None = None

    def go_on(self, now_s: float, put: Callable[[LocalMap], None], *, may_turn: bool) -> None:
        """Begin to learn from what waits, if nothing is being learned; ask again for what is overdue. put: adopts it.

        While it is overdue more scans come. A map that is learned from them as well is later, and far better.
        """
        known, waiting = self.learned, len(self.waiting)
        if known is None or not waiting:
            return
        if self.lane.busy and (now_s <= self.lane.planned_s or known.grows or known.changing or self.beginning):
            return
        if self.lane.busy and len(known.keyframes) + waiting < KEYFRAMES.more * (len(known.keyframes) + self._asked):
            return
        fresh, until, self._asked = Candidates(*map(np.copy, self.waiting.all)), self.waiting.left + waiting, waiting
        known = replace(known, fresh=waiting, looked=0 if may_turn and not known.turns else known.looked)
        share = _YOUNG_LATENCY if len(known.keyframes) + waiting < KEYFRAMES.young else 1.0
        begun_s = max(float(fresh.t_s[-1]), now_s)
        work, adopt = self._workers.mapper.submit(learn_from, known, fresh), partial(self._adopt, put, until)
        self.lane.renew(work, begun_s, begun_s + share * self._latency_s, partial(adopt, fresh.states[-1]))

    def _adopt(self, put: Callable[[LocalMap], None], until: int, newest: Floats, new: LocalMap) -> None:
        """Adopt what was learned from the scans until one. Later requests were for the pattern before: of another kind.

        newest: (5,), registered state of the last of them.
        """
        before, self._newest = self.learned, newest
        self._asked = max(self._asked - self.waiting.leave(until), 0)
        if before is None or new.turns or new.grows or new.changing or before.turns:
            self.lane.drop()
        if not self.lane.busy:
            self._asked = 0
        put(new)

    def begin(
        self, now_s: float, put: Callable[[Begun], None], function: Callable[..., Begun], *arguments: object
    ) -> None:
        """Begin to learn a new pattern, instead of what was being learned. put: adopts it."""
        self.forget_waiting()
        self.beginning = True
        self.lane.begin(self._workers.starter.submit(function, *arguments), now_s, now_s, put)

    def settle(self, now_s: float) -> float:
        """End what is being learned when a contact, or its pattern, ends; by how much its theta differs."""
        self.forget_waiting()
        self.beginning = False
        if not self.lane.adopting.waits:
            self.lane.drop()
            return 0.0
        job = self.lane.taken(now_s)
        if job is None:
            return 0.0
        new: LocalMap = job.result.result()
        self.learned = new
        return new.turned

    def forget_waiting(self) -> None:
        """Leave out the scans on their way to become keyframes."""
        self.waiting.leave(self.waiting.left + len(self.waiting))
        self._asked = 0

    def end(self, arm: Floats) -> None:
        """The contact has ended; its pattern may come again. arm: (3, 2), see `arm_on_map`."""
        if self.learned is not None and self.learned.mature:
            self.library = [*self.library, replace(self.learned, arm=arm)][-_LIBRARY:]
        self.learned = None

    def take_over(self, new: LocalMap, state: Floats) -> None:
        """Carry a state (5,), in place, and those of the scans that wait, into the frame of a pattern that grows.

        Its origin, its size and its gain have changed as they have for the newest keyframe.
        """
        if self._newest is None:
            return
        last = new.keyframes.states[-1]
        now, before = state_of(last), state_of(self._newest)
        step = np.array(State(now.x - before.x, now.y - before.y, 0.0, 0.0, now.size - before.size))
        times = np.array(State(1.0, 1.0, 1.0, now.gain / before.gain, 1.0))
        for one in (state, self.waiting.all.states):
            one[:] = (one + step) * times

    def shifted(self, new: LocalMap, state: Floats) -> Floats:
        """(3,), by how much the newest keyframe has moved on a new pattern; the gain of a state (5,) changes as its."""
        if self._newest is None:
            return np.zeros(3)
        last = new.keyframes.states[-1]
        now, before = state_of(last), state_of(self._newest)
        state[:] = state_of(state)._replace(gain=state_of(state).gain * now.gain / before.gain)
        return np.array([now.x - before.x, now.y - before.y, now.theta - before.theta if new.turns else 0.0])

    def shift_waiting(self, step: Floats) -> None:
        """Move the scans that wait as the last scan was moved, (5,), when it was registered on a new pattern."""
        self.waiting.all.states[:, :3] += step[:3]


def learn_from(known: LocalMap, fresh: Candidates) -> LocalMap:
    """A pattern that has also learned from these scans, of which many may have come while it was learned before."""
    keyframes = known.keyframes
    for scan in zip(fresh.t_s.tolist(), *fresh[1:], strict=True):
        keyframes = keyframes.with_scan(*scan)
    taken = known.taken + len(fresh.t_s)
    return learn(replace(known, keyframes=keyframes, until_s=float(fresh.t_s[-1]), taken=taken))
