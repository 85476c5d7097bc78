"""Adoption: from which scan on a stream uses a result that another thread or process computes (a map, a tare).

A repeatable stream adopts a result at a fixed time after its computation began, by the scans' own clock, and waits for
it. A live loop never waits: it adopts a result in the first scan for which it is ready, and records which scan that
was. A replay with these records gives the same results, bit by bit, on any machine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import Future
from dataclasses import dataclass
from math import inf
from threading import Event
from typing import Any, NamedTuple, Protocol


class Adoption(NamedTuple):
    """One adoption. what: a pad's name, or `tare`. number: of the computation, counted for each `what`. t_s: time of
    the first scan that used its result.
    """

    what: str
    number: int
    t_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """A computation in progress. begun_s: time of the scan that started it. planned_s: when a repeatable stream adopts
    its result. put: called with the result. ready: set when there is a result; a live loop asks in each scan, and
    asking the future would take a lock.
    """

    what: str
    number: int
    begun_s: float
    planned_s: float
    result: Future[Any]
    put: Callable[[Any], None]
    ready: Event


class Adopting(Protocol):
    """A rule of adoption. waits: whether a stream waits for a result that is due, or not ready when a contact ends."""

    waits: bool

    def due_s(self, job: Job) -> float:
        """Time of the first scan that uses the result; infinite as long as it is unknown."""
        ...

    def note(self, adoption: Adoption) -> None:
        """Called after an adoption."""
        ...

    def supersede(self, job: Job) -> None:
        """Called when a newer computation of the same kind begins."""
        ...


class AtFixedTimes:
    """At the planned times, by the scans' clock; a stream waits for results."""

    waits = True

    def __init__(self, same_s: float = 0.0) -> None:
        """same_s: times that are closer than this are equal."""
        self._same_s = same_s

    def due_s(self, job: Job) -> float:
        """See `Adopting`."""
        return job.planned_s - self._same_s

    def note(self, adoption: Adoption) -> None:
        """Nothing to record: the times are known."""

    def supersede(self, job: Job) -> None:
        """Nothing to do: a stream that waits uses every result."""


class WhenReady:
    """As soon as a result is ready. adopted: adoptions in order, until `taken`."""

    waits = False

    def __init__(self) -> None:
        self.adopted: list[Adoption] = []

    def due_s(self, job: Job) -> float:
        """See `Adopting`."""
        return -inf if job.ready.is_set() else inf

    def note(self, adoption: Adoption) -> None:
        """Record it."""
        self.adopted.append(adoption)

    def supersede(self, job: Job) -> None:
        """Cancel the older computation, unless it is running."""
        job.result.cancel()

    def taken(self) -> list[Adoption]:
        """Adoptions since the last call."""
        adopted, self.adopted = self.adopted, []
        return adopted


class AsRecorded:
    """At the scans recorded in a former run, which gives the same results again."""

    waits = False

    def __init__(self, adoptions: Iterable[Adoption]) -> None:
        self._times = {(what, number): t_s for what, number, t_s in adoptions}

    def due_s(self, job: Job) -> float:
        """See `Adopting`."""
        return self._times.get((job.what, job.number), inf)

    def note(self, adoption: Adoption) -> None:
        """Nothing to record: it is known."""

    def supersede(self, job: Job) -> None:
        """Nothing to do: the former run may have used it."""

    def taken(self) -> list[Adoption]:
        """None."""
        return []


class Late:
    """A fixed delay after the computation began, except where adoption at once is planned: simulates a slow machine."""

    waits = False

    def __init__(self, delay_s: float) -> None:
        self._delay_s = delay_s

    def due_s(self, job: Job) -> float:
        """See `Adopting`."""
        return job.begun_s + (self._delay_s if job.planned_s > job.begun_s else 0.0)

    def note(self, adoption: Adoption) -> None:
        """Nothing to record."""

    def supersede(self, job: Job) -> None:
        """Nothing to do: each result is used after its delay."""


class Lane:
    """Computations of one kind, of which newer ones have more scans to learn from. what: see `Adoption`. jobs: those in
    progress, and those whose results wait for adoption, oldest first.
    """

    def __init__(self, what: str, adopting: Adopting) -> None:
        self.what, self.adopting = what, adopting
        self._begun = 0
        self.jobs: list[Job] = []

    @property
    def busy(self) -> bool:
        """Whether a computation is running, or its result waits for adoption."""
        return bool(self.jobs)

    @property
    def due_s(self) -> float:
        """Time of the first scan that uses the next result; infinite if there is none."""
        return min(map(self.adopting.due_s, self.jobs)) if self.jobs else inf

    @property
    def planned_s(self) -> float:
        """When a repeatable stream adopts the newest result; infinite if there is none."""
        return self.jobs[-1].planned_s if self.jobs else inf

    def begin(self, result: Future[Any], begun_s: float, planned_s: float, put: Callable[[Any], None]) -> None:
        """Add a computation, and drop all before it."""
        self.drop()
        self.renew(result, begun_s, planned_s, put)

    def renew(self, result: Future[Any], begun_s: float, planned_s: float, put: Callable[[Any], None]) -> None:
        """Add a computation with more scans; the earlier ones are used if they are ready first."""
        for job in self.jobs:
            self.adopting.supersede(job)
        ready = Event()
        result.add_done_callback(lambda _: ready.set())
        self.jobs = [job for job in self.jobs if not job.result.cancelled()]
        self.jobs.append(Job(self.what, self._begun, begun_s, planned_s, result, put, ready))
        self._begun += 1

    def adopt(self, now_s: float) -> None:
        """Adopt the result that is due, if there is any; waits for it if it is not ready."""
        job = self.taken(now_s)
        if job is not None:
            job.put(job.result.result())

    def taken(self, now_s: float) -> Job | None:
        """The newest computation that is due, else the newest of all, for the caller to adopt; drops older ones."""
        if not self.jobs:
            return None
        due = [place for place, job in enumerate(self.jobs) if self.adopting.due_s(job) <= now_s]
        place = due[-1] if due else len(self.jobs) - 1
        job, older, self.jobs = self.jobs[place], self.jobs[:place], self.jobs[place + 1 :]
        for one in older:
            one.result.cancel()
        self.adopting.note(Adoption(job.what, job.number, now_s))
        return job

    def drop(self) -> None:
        """Cancel all."""
        for job in self.jobs:
            job.result.cancel()
        self.jobs = []
