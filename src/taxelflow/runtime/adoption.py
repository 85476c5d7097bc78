"""When what is learned beside a stream is put to use.

A stream that can be repeated uses it a fixed time after it was begun, by the scans' own clock, and waits for it. A live
loop never waits: it uses it from the first scan on for which it is ready, and notes which one that was. By these notes
the same scans give the same results once more, bit by bit, whatever the machine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import Future
from dataclasses import dataclass
from math import inf
from threading import Event
from typing import Any, NamedTuple, Protocol


class Adoption(NamedTuple):
    """What was put to use. what: a pad's name, or `tare`. number: which of all that was begun there. t_s: time of the
    first scan that it was used for.
    """

    what: str
    number: int
    t_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """Something that is being learned. begun_s: time of the scan that it was begun with. planned_s: when a stream that
    can be repeated uses it. put: uses it. ready: set when there is a result: a live loop asks in each scan, and a
    future would be locked for its answer.
    """

    what: str
    number: int
    begun_s: float
    planned_s: float
    result: Future[Any]
    put: Callable[[Any], None]
    ready: Event


class Adopting(Protocol):
    """waits: whether a stream waits for what it needs at once, and for what is not ready when a contact ends."""

    waits: bool

    def due_s(self, job: Job) -> float:
        """Time of the scan from which on to use it; infinite as long as that is unknown."""
        ...

    def note(self, adoption: Adoption) -> None:
        """It has been put to use."""
        ...

    def supersede(self, job: Job) -> None:
        """More can be learned now."""
        ...


class AtFixedTimes:
    """As planned, by the scans' clock."""

    waits = True

    def due_s(self, job: Job) -> float:
        """See `Adopting`."""
        return job.planned_s

    def note(self, adoption: Adoption) -> None:
        """The times are known."""

    def supersede(self, job: Job) -> None:
        """A stream that waits is never behind."""


class WhenReady:
    """Never waits. adopted: what has been put to use, in order, until `taken`."""

    waits = False

    def __init__(self) -> None:
        self.adopted: list[Adoption] = []

    def due_s(self, job: Job) -> float:
        """See `Adopting`."""
        return -inf if job.ready.is_set() else inf

    def note(self, adoption: Adoption) -> None:
        """Keep it."""
        self.adopted.append(adoption)

    def supersede(self, job: Job) -> None:
        """What has not been begun is not worth it any more."""
        job.result.cancel()

    def taken(self) -> list[Adoption]:
        """What has been adopted since the last call."""
        adopted, self.adopted = self.adopted, []
        return adopted


class AsRecorded:
    """At the scans of a former run, whose results come out once more."""

    waits = False

    def __init__(self, adoptions: Iterable[Adoption]) -> None:
        self._times = {(what, number): t_s for what, number, t_s in adoptions}

    def due_s(self, job: Job) -> float:
        """See `Adopting`."""
        return self._times.get((job.what, job.number), inf)

    def note(self, adoption: Adoption) -> None:
        """It is known."""

    def supersede(self, job: Job) -> None:
        """It may have been used."""

    def taken(self) -> list[Adoption]:
        """None."""
        return []


class Late:
    """So many s after it was begun, but for what is planned at once; to study what a slow machine costs."""

    waits = False

    def __init__(self, delay_s: float) -> None:
        self._delay_s = delay_s

    def due_s(self, job: Job) -> float:
        """See `Adopting`."""
        return job.begun_s + (self._delay_s if job.planned_s > job.begun_s else 0.0)

    def note(self, adoption: Adoption) -> None:
        """Nobody asks."""

    def supersede(self, job: Job) -> None:
        """Each comes in its time."""


class Lane:
    """What is being learned: one thing, or requests of the same, each with more to learn from. what: see `Adoption`."""

    def __init__(self, what: str, adopting: Adopting) -> None:
        self.what, self.adopting = what, adopting
        self._begun = 0
        self._jobs: list[Job] = []

    @property
    def busy(self) -> bool:
        """Whether something is being learned, or waits to be used."""
        return bool(self._jobs)

    @property
    def due_s(self) -> float:
        """Time of the scan from which on to use it; infinite if there is nothing."""
        return min(map(self.adopting.due_s, self._jobs)) if self._jobs else inf

    @property
    def planned_s(self) -> float:
        """When a stream that can be repeated uses the newest request; infinite if there is none."""
        return self._jobs[-1].planned_s if self._jobs else inf

    def begin(self, result: Future[Any], begun_s: float, planned_s: float, put: Callable[[Any], None]) -> None:
        """Something is being learned, instead of what was before."""
        self.drop()
        self.renew(result, begun_s, planned_s, put)

    def renew(self, result: Future[Any], begun_s: float, planned_s: float, put: Callable[[Any], None]) -> None:
        """The same is asked for with more to learn from; earlier requests are used if they are ready first."""
        for job in self._jobs:
            self.adopting.supersede(job)
        ready = Event()
        result.add_done_callback(lambda _: ready.set())
        self._jobs = [job for job in self._jobs if not job.result.cancelled()]
        self._jobs.append(Job(self.what, self._begun, begun_s, planned_s, result, put, ready))
        self._begun += 1

    def adopt(self, now_s: float) -> None:
        """Put to use what is being learned, if anything is; waits for it if it is not ready."""
        job = self.taken(now_s)
        if job is not None:
            job.put(job.result.result())

    def taken(self, now_s: float) -> Job | None:
        """The newest request that is due, else the newest of all, to be put to use by the caller; drops older ones."""
        if not self._jobs:
            return None
        due = [place for place, job in enumerate(self._jobs) if self.adopting.due_s(job) <= now_s]
        place = due[-1] if due else len(self._jobs) - 1
        job, older, self._jobs = self._jobs[place], self._jobs[:place], self._jobs[place + 1 :]
        for one in older:
            one.result.cancel()
        self.adopting.note(Adoption(job.what, job.number, now_s))
        return job

    def drop(self) -> None:
        """It is not wanted any more."""
        for job in self._jobs:
            job.result.cancel()
        self._jobs = []
