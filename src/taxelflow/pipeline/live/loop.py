"""The loop: a source's thread, the estimate here, a thread per sink; and its report."""

from __future__ import annotations

import gc
import time
from collections import deque
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.acquire.metadata import texts_of
from taxelflow.messages import Output, joined
from taxelflow.pipeline.live.intake import Intake, block_of
from taxelflow.pipeline.live.latency import Latencies
from taxelflow.pipeline.live.workers import SinkWorker
from taxelflow.pipeline.run_summary import summarise
from taxelflow.publish.sinks.base import Ending, Head, Update
from taxelflow.publish.sinks.lines import scan_texts
from taxelflow.publish.summary import Totals
from taxelflow.runtime.signals import Signals
from taxelflow.runtime.threads import quick_turns, short_collections

if TYPE_CHECKING:
    import threading
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from taxelflow.acquire.devices.base import Source
    from taxelflow.messages import Event, Floats
    from taxelflow.pipeline.live.api import Live
    from taxelflow.pipeline.live.intake import Placed
    from taxelflow.publish.sinks.base import Sink
    from taxelflow.runtime.adoption import Adoption

_COUNTED = 16
"""Scans that are counted into the summary at once."""


@dataclass(frozen=True, slots=True)
class _Screen:
    """What the screen shows."""

    events: int = 6
    """Latest events that the screen shows."""
    every_s: float = 0.2
    """Time between two updates of the screen."""


_SCREEN = _Screen()


@dataclass(frozen=True)
class Limits:
    """When a run ends by itself: after a number of scans in order, or of s; None for never."""

    max_scans: int | None = None
    duration_s: float | None = None


@dataclass
class Report:
    """What a run amounts to, while it goes on and at its end.

    latest: the last results. estimated: latencies from arrival until the estimate is known. repeated: scans without
    results, because they equal the one before bit for bit; known at the end.
    """

    source: Source
    intake: Intake
    workers: list[SinkWorker]
    pads: tuple[str, ...]
    began_s: float = field(default_factory=time.monotonic)
    latest: Update | None = None
    events: deque[Event] = field(default_factory=lambda: deque(maxlen=_SCREEN.events))
    estimated: Latencies = field(default_factory=Latencies)
    repeated: int = 0


def run_live(
    source: Source,
    sinks: Mapping[str, Sink],
    live: Live | None,
    limits: Limits,
    method: str = "",
    watch: Callable[[Report], None] | None = None,
    signals: Signals | None = None,
) -> Report:
    """Run a source into sinks until it ends, a limit is reached, or a signal asks for the end.

    The source is opened first: where that fails, no sink has touched its file. live: what estimates; None records only.
    watch: called several times a second. signals: those that the caller has entered already. Raises SourceUnreachable,
    SinkUnusable, PortTaken, EndedEarly, and what the source raises where it cannot go on.
    """
    signals = signals or Signals()
    stop = signals.asked
    pads = live.pads if live is not None else ()
    head = Head(source.recording.sensor, pads, texts_of(source.recording), source.faults.report)
    workers: list[SinkWorker] = []
    ending = Ending(None, (), failed=True)
    with signals, _undisturbed(), source:
        signals.begin()
        try:
            for name, sink in sinks.items():
                sink.open(head)
                workers.append(SinkWorker(name, sink, source.faults))
                workers[-1].start()
            gc.freeze()  # what sinks have imported
            raw = [worker for worker in workers if worker.sink.raw]
            intake = Intake(source, raw, stop, limits.max_scans, estimates=live is not None)
            report = Report(source, intake, workers, pads)
            intake.start()
            estimate = None if live is None else _Estimate(live, report, method)
            _follow(report, estimate, stop, limits, watch)
            intake.join()
            found = Ending(None, ()) if estimate is None else estimate.finish()
            if intake.error is None:
                ending = found
        finally:
            stop.set()
            for worker in workers:
                worker.finish(ending)
    if intake.error is not None:
        raise intake.error
    return report


def _follow(
    report: Report,
    estimate: _Estimate | None,
    stop: threading.Event,
    limits: Limits,
    watch: Callable[[Report], None] | None,
) -> None:
    """Estimate from what comes, until nothing more does."""
    watched_s = 0.0
    while (scans := report.intake.take()) is not None:
        if scans and estimate is not None:
            estimate.step(scans)
        for worker in report.workers:
            worker.wake()
        now = time.monotonic()
        if limits.duration_s is not None and now - report.began_s >= limits.duration_s:
            stop.set()
        if report.workers and all(worker.ended for worker in report.workers):  # nobody reads any more
            stop.set()
        if watch is not None and now - watched_s >= _SCREEN.every_s:
            watch(report)
            watched_s = now


def update_of(
    output: Output, arrived_s: Floats | None = None, adoptions: Sequence[Adoption] = (), missed: Sequence[float] = ()
) -> Update:
    """Results as sinks take them. arrived_s: (scans,), when the scans came, monotonic; now if left out."""
    if arrived_s is None:
        arrived_s = np.full(len(output), time.monotonic())
    return Update(arrived_s, output, list(adoptions), list(missed))


class _Estimate:
    """Steps the pipeline, and passes its results on with the times of arrival."""

    def __init__(self, live: Live, report: Report, method: str) -> None:
        self._live, self._report, self._method = live, report, method
        self._totals = Totals(live.recording.layout)
        self._summed = any(getattr(worker.sink, "summed", False) for worker in report.workers)
        self._uncounted: list[Output] = []
        self._arrivals: deque[tuple[float, float]] = deque()

    def step(self, scans: Sequence[Placed]) -> None:
        """Scans that have waited, in one step: it costs hardly more than one of them alone."""
        self._arrivals.extend((scan.t_s, scan.arrived_s) for scan in scans)
        output = self._live.push(block_of(scans))
        if not len(output):
            return
        arrived_s, now = self._publish(output), time.monotonic()
        mine = arrived_s >= scans[0].arrived_s  # others were held back until noise was known
        self._report.estimated.add_all(now - arrived_s[mine])

    def finish(self) -> Ending:
        """Publish what was held back; what the run amounts to."""
        output = self._live.finish()
        if len(output):
            self._publish(output)
        self._count()
        run = self._live.run
        self._report.repeated = run.counts.repeated
        run.reading.notes += self._report.intake.timeline.notes
        summary = summarise(self._method, self._live.pipeline, run, self._totals) if self._totals.scans else None
        return Ending(summary, run.patterns)

    def _publish(self, output: Output) -> Floats:
        """Pass results on; (scans,), when their scans arrived."""
        update = update_of(output, self._arrived(output.slips.t_s), self._live.adopted(), self._report.intake.missed())
        if any(getattr(worker.sink, "texts", False) for worker in self._report.workers):
            update.texts.extend(scan_texts(update, self._report.pads))
        for worker in self._report.workers:
            worker.offer(update)
            if self._report.source.patient:
                worker.give_room()
        self._report.latest = update
        self._report.events.extend(output.events)
        if self._summed:  # each contact of a run is kept for its summary
            self._uncounted.append(output)
        if len(self._uncounted) >= _COUNTED:
            self._count()
        return update.arrived_s

    def _arrived(self, t_s: Floats) -> Floats:
        """When these scans arrived; those between them were dropped as repetitions."""
        found = []
        for t in t_s.tolist():
            when_s, arrived_s = self._arrivals.popleft()
            while when_s < t:
                when_s, arrived_s = self._arrivals.popleft()
            found.append(arrived_s)
        return np.array(found)

    def _count(self) -> None:
        if self._uncounted:
            slips = joined([output.slips for output in self._uncounted])
            self._totals.add(slips, [event for output in self._uncounted for event in output.events])
            self._uncounted.clear()


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Threads that take turns quickly, and short garbage collections: none of what is there before the first scan."""
    gc.collect()
    gc.freeze()
    try:
        with quick_turns(), short_collections():
            yield
    finally:
        gc.unfreeze()
