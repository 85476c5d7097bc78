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
    can be repeated uses it. put: uses it.
    """

    what: str
    number: int
    begun_s: float
    planned_s: float
    result: Future[Any]
    put: Callable[[Any], None]


class Adopting(Protocol):
    """waits: whether a stream waits for what it needs at once, and for what is not ready when a contact ends."""

    waits: bool

    def due_s(self, job: Job) -> float:
        """Time of the scan from which on to use it; infinite as long as that is unknown."""
        ...

    def note(self, adoption: Adoption) -> None:
        """It has been put to use."""
        ...


class AtFixedTimes:
    """As planned, by the scans' clock."""

    waits = True

    def due_s(self, job: Job) -> float:
        """See `Adopting`."""
        return job.planned_s

    def note(self, adoption: Adoption) -> None:
        """The times are known."""


class WhenReady:
    """Never waits. adopted: what has been put to use, in order, until `taken`."""

    waits = False

    def __init__(self) -> None:
        self.adopted: list[Adoption] = []

    def due_s(self, job: Job) -> float:
        """See `Adopting`."""
        return -inf if job.result.done() else inf

    def note(self, adoption: Adoption) -> None:
        """Keep it."""
        self.adopted.append(adoption)

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


class Lane:
    """At most one thing that is being learned. what: see `Adoption`."""

    def __init__(self, what: str, adopting: Adopting) -> None:
        self.what, self.adopting = what, adopting
        self._begun = 0
        self._job: Job | None = None

    @property
    def busy(self) -> bool:
        """Whether something is being learned, or waits to be used."""
        return self._job is not None

    @property
    def due_s(self) -> float:
        """Time of the scan from which on to use it; infinite if there is nothing."""
        return inf if self._job is None else self.adopting.due_s(self._job)

    def begin(self, result: Future[Any], begun_s: float, planned_s: float, put: Callable[[Any], None]) -> None:
        """Something is being learned, instead of what was before."""
        self.drop()
        self._job = Job(self.what, self._begun, begun_s, planned_s, result, put)
        self._begun += 1

    def adopt(self, now_s: float) -> None:
        """Put to use what is being learned, if anything is; waits for it if it is not ready."""
        job = self.taken(now_s)
        if job is not None:
            job.put(job.result.result())

    def taken(self, now_s: float) -> Job | None:
        """What is being learned, to be put to use by the caller."""
        job, self._job = self._job, None
        if job is not None:
            self.adopting.note(Adoption(job.what, job.number, now_s))
        return job

    def drop(self) -> None:
        """It is not wanted any more."""
        if self._job is not None:
            self._job.result.cancel()
        self._job = None
