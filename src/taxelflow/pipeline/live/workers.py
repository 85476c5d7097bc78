"""A thread per sink, with a bounded queue: a sink that is slow or dead holds up nobody but itself."""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from taxelflow.messages import RawScans, joined
from taxelflow.pipeline.live.latency import Latencies
from taxelflow.publish.sinks.base import Ending, Update

if TYPE_CHECKING:
    from collections.abc import Iterator

    from taxelflow.acquire.devices.base import Faults
    from taxelflow.publish.sinks.base import Sink


@dataclass(frozen=True, slots=True)
class _Queue:
    """What waits for a sink."""

    held: int = 512
    held_lossless: int = 20_000
    """Scans that wait for a sink; then the oldest are dropped for a live sink, the newest for a file that takes
    none."""
    crowded: int = 2_000
    """Scans that wait for a file before a source that can wait is slowed down;"""
    stuck_s: float = 0.25
    """... unless the file's last write takes longer than this: then it is stuck."""
    tick_s: float = 0.05
    """Time between two calls of a sink's `tick` while nothing comes."""
    batch: int = 256
    """Items that a sink takes at once, at most."""
    grace_s: float = 1.5
    """Time for a sink to close in."""


_QUEUE = _Queue()


@dataclass(frozen=True, slots=True, eq=False)
class Raw:
    """Scans as the source sent them. late: out of order, not to be estimated from."""

    scans: RawScans
    late: bool = False

    def __len__(self) -> int:
        return len(self.scans)


class SinkWorker(threading.Thread):
    """Passes results to one sink. published, dropped: scans. latencies: from arrival to written."""

    def __init__(self, name: str, sink: Sink, faults: Faults) -> None:
        super().__init__(name=f"taxelflow-{name}", daemon=True)  # a thread that is stuck must not outlive the run
        self.label, self.sink = name, sink
        self._passed = self._in_hand = 0
        self.latencies = Latencies()
        self.ended = False
        self._faults = faults
        self._dropped = 0
        self._unwritten: int | None = None
        self._waiting: deque[Update | Raw] = deque()
        self._come = threading.Condition()
        self._closing: Ending | None = None
        self._settled_s: float | None = None
        self._busy_since = float("inf")
        self._most = _QUEUE.held_lossless if sink.lossless else _QUEUE.held
        self._awaited = _QUEUE.batch if sink.gathers_s else 1

    @property
    def dropped(self) -> int:
        """Scans, or lines for a client, that were not passed on."""
        return self._dropped + (self._lost() if self.sink.lossless else self.sink.dropped)

    @property
    def published(self) -> int:
        """Scans passed to the sink, without those that it then lost: of a file that gathers, some only at its end."""
        return self._passed - (self._lost() if self.sink.lossless else 0)  # a server counts each client's

    def _lost(self) -> int:
        """Scans passed to a file that it then lost, or does not write in time; those in hand are not passed yet."""
        lost = self.sink.dropped if self._unwritten is None else self._unwritten
        return min(lost, self._passed)

    def offer(self, item: Update | Raw) -> None:
        """Queue it; returns at once. The thread is woken by `wake`, or when much waits."""
        with self._come:
            if self._settled_s is None and isinstance(item, Update):  # the first scans wait until noise is known
                self._settled_s = float(item.arrived_s[-1])
            if self.ended:
                self._dropped += self._counted(item)
                return
            if len(self._waiting) >= self._most:
                self._drop(item)
            else:
                self._waiting.append(item)
            if len(self._waiting) >= _QUEUE.batch:
                self._come.notify()

    def wake(self) -> None:
        """Let the thread write what was offered, if it is enough."""
        if len(self._waiting) >= self._awaited:
            with self._come:
                self._come.notify()

    def give_room(self) -> None:
        """Wait while a file has much to write and is writing it; for sources that can wait."""
        while (
            self.sink.lossless
            and len(self._waiting) > _QUEUE.crowded
            and not self.ended
            and time.monotonic() - self._busy_since < _QUEUE.stuck_s
        ):
            time.sleep(0.002)

    def finish(self, ending: Ending) -> None:
        """Write what waits, close, and wait for that a little; once is enough."""
        if self._closing is not None:
            return
        with self._come:
            self._closing = ending
            self._come.notify()
        self._drained()
        self.sink.hurry()
        self.join(_QUEUE.grace_s)
        if self.is_alive():
            self._unwritten = self.sink.dropped + getattr(self.sink, "unwritten", 0)
            left = self._end() + self._lost()
            self._faults.report("a sink is stuck", f"{self.label}; {left} scans are lost")

    def _end(self) -> int:
        """Take no more scans; those that it holds are dropped. Returns how many."""
        with self._come:
            left = self._in_hand + sum(map(self._counted, self._waiting))
            self._dropped += left
            self._waiting.clear()
            self._in_hand = 0
            self.ended = True
        return left

    def _drained(self) -> None:
        """Wait while it goes on."""
        while self.is_alive() and self._waiting and time.monotonic() - self._busy_since < _QUEUE.grace_s:
            time.sleep(0.005)

    def _drop(self, item: Update | Raw) -> None:
        if not self._dropped:
            self._faults.report("a sink is too slow", f"{self.label}; scans are dropped for it")
        if self.sink.lossless:
            self._dropped += self._counted(item)
        else:
            self._dropped += self._counted(self._waiting.popleft())
            self._waiting.append(item)

    def run(self) -> None:
        """The thread's work."""
        try:
            while not self._done():
                for item in self._taken():
                    self._pass(item)
                self.sink.tick()
                self._busy_since = float("inf")
        except BrokenPipeError:  # who read it has seen enough
            pass
        except Exception as error:
            self._faults.report("a sink has failed", f"{self.label}: {error}")
        self._end()
        try:
            self.sink.close(self._closing or Ending(None, ()))
        except Exception as error:
            if not isinstance(error, BrokenPipeError):
                self._faults.report("a sink cannot be closed", f"{self.label}: {error}")

    def _done(self) -> bool:
        with self._come:
            if len(self._waiting) < self._awaited and self._closing is None:
                self._come.wait(self.sink.gathers_s or _QUEUE.tick_s)
            return self._closing is not None and not self._waiting

    def _taken(self) -> Iterator[Update | Raw]:
        """What waits, items of a kind joined; scans as they came before what they gave.

        Results are not joined for who writes their texts: that takes twice the time of writing these.
        """
        with self._come:
            items = [self._waiting.popleft() for _ in range(min(len(self._waiting), _QUEUE.batch))]
        self._in_hand = sum(map(self._counted, items))
        self._busy_since = time.monotonic()
        if len(items) == 1:
            yield items[0]
            return
        raws = [item for item in items if isinstance(item, Raw)]
        for late in (False, True):
            if scans := [raw.scans for raw in raws if raw.late == late]:
                yield Raw(joined(scans), late)
        if updates := [item for item in items if isinstance(item, Update)]:
            yield from updates if getattr(self.sink, "texts", False) else [joined(updates)]

    def _counted(self, item: Update | Raw) -> int:
        """Scans of an item; none of results beside the scans themselves."""
        return len(item) if isinstance(item, Raw) or not self.sink.raw else 0

    def _pass(self, item: Update | Raw) -> None:
        if isinstance(item, Raw):
            self.sink.write_raw(item.scans, late=item.late)
        else:
            self.sink.write(item)
        with self._come:
            if self.ended:  # counted as lost, because it took too long
                return
            self._in_hand -= self._counted(item)
            self._passed += self._counted(item)
        if isinstance(item, Raw):
            return
        now, arrived_s = time.monotonic(), item.arrived_s
        if self._settled_s is not None:
            self.latencies.add_all(now - arrived_s[arrived_s >= self._settled_s])
