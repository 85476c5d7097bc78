"""The source's thread: takes scans as they arrive, puts them in time order, and passes them on."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.acquire.devices.base import POLL_S
from taxelflow.acquire.devices.timeline import Timeline
from taxelflow.messages import RawScans
from taxelflow.pipeline.live.workers import Raw

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.acquire.devices.base import Arrival, Source
    from taxelflow.pipeline.live.workers import SinkWorker


@dataclass(frozen=True, slots=True)
class _Intake:
    """Scans on their way to the estimate."""

    waiting: int = 4096
    """Scans that may wait for the estimate; then a patient source waits, and of another one the oldest are dropped."""
    taken: int = 16
    """Scans that are estimated in one step, at most, before sinks are woken: threads that wake delay the estimate."""


_INTAKE = _Intake()


class Placed:
    """A scan in time order. values: (columns,), as the source sent them. arrived_s: by the monotonic clock."""

    __slots__ = ("arrived_s", "t_s", "values")

    def __init__(self, t_s: float, values: np.ndarray, arrived_s: float) -> None:
        self.t_s, self.values, self.arrived_s = t_s, values, arrived_s

    @property
    def raw(self) -> RawScans:
        """As a block of one scan."""
        return RawScans(np.array([self.t_s]), self.values[np.newaxis])


def block_of(scans: Sequence[Placed]) -> RawScans:
    """One or more scans as one block."""
    if len(scans) == 1:
        return scans[0].raw
    return RawScans(np.array([scan.t_s for scan in scans]), np.array([scan.values for scan in scans]))


class Intake(threading.Thread):
    """Reads a source to its end, or until it is stopped.

    scans_in: complete scans that arrived. dropped: those of them that were repeated or late, or that the estimate was
    too slow for. error: the exception that ended the source, if any; the run raises it.
    """

    def __init__(
        self,
        source: Source,
        raw_sinks: Sequence[SinkWorker],
        stop: threading.Event,
        most: int | None,
        *,
        estimates: bool,
    ) -> None:
        super().__init__(name="taxelflow-source", daemon=True)
        self.timeline = Timeline(source.faults, paced=getattr(source, "paced", True))
        self.scans_in = 0
        self.overrun = 0
        self.error: BaseException | None = None
        self._source, self._raw_sinks, self._stop_asked, self._most = source, raw_sinks, stop, most
        self._estimates = estimates
        self._waiting: deque[Placed] = deque()
        self._come = threading.Condition()
        self._missed: list[float] = []
        self._done = False

    @property
    def dropped(self) -> int:
        """See the class."""
        return self.timeline.dropped + self.overrun

    @property
    def waiting(self) -> int:
        """Scans that wait for the estimate."""
        return len(self._waiting)

    def take(self) -> list[Placed] | None:
        """Scans that have arrived, none after a while; None when there will be no more."""
        with self._come:
            if not self._waiting and not self._done:
                self._come.wait(POLL_S)
            if not self._waiting:
                return None if self._done else []
            taken = [self._waiting.popleft() for _ in range(min(len(self._waiting), _INTAKE.taken))]
            self._come.notify()
            return taken

    def missed(self) -> list[float]:
        """Times, s, of the scans since the last call that the estimate was too slow for."""
        with self._come:
            missed, self._missed = self._missed, []
        return missed

    def run(self) -> None:
        """The thread's work."""
        try:
            for arrival in self._source:
                if self._stop_asked.is_set():
                    break
                if arrival is not None and self._is_last(arrival):
                    break
        except (Exception, SystemExit) as error:  # a thread that exits ends without a word
            self.error = error
        finally:
            with self._come:
                self._done = True
                self._come.notify()

    def _is_last(self, arrival: Arrival) -> bool:
        """Pass a scan on; whether it is the last that is wanted."""
        self.scans_in += 1
        t_s = self.timeline.place(arrival)
        if t_s is None:
            late = RawScans(np.array([arrival.t_s]), arrival.values[np.newaxis])
            for sink in self._raw_sinks:
                sink.offer(Raw(late, late=True))
            return False
        placed = Placed(t_s, arrival.values, arrival.arrived_s)
        for sink in self._raw_sinks:
            sink.offer(Raw(placed.raw))
            if self._source.patient:
                sink.give_room()
        if self._estimates:
            self._source.faults.count_absurd(placed.values)
            self._put(placed)
        return self._most is not None and self.scans_in - self.timeline.dropped >= self._most

    def _put(self, placed: Placed) -> None:
        with self._come:
            while len(self._waiting) >= _INTAKE.waiting and self._source.patient and not self._stop_asked.is_set():
                self._come.wait(POLL_S)
            if len(self._waiting) >= _INTAKE.waiting:
                if not self.overrun:
                    self._source.faults.report("the estimate is too slow", "the oldest scans are dropped")
                self.overrun += 1
                self._missed.append(self._waiting.popleft().t_s)
            self._waiting.append(placed)
            self._come.notify()
