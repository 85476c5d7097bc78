"""The protocol of a sink, and the messages that it receives."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from msgspec import Raw

    from taxelflow.messages import Floats, LearnedPattern, Output, RawScans
    from taxelflow.publish.summary import Summary
    from taxelflow.runtime.adoption import Adoption
    from taxelflow.sensors.sensor import Sensor


class ScanText(NamedTuple):
    """Results of a scan as JSON, of the pads by name and of the object, made once for all sinks that write it."""

    pads: Raw
    moved: Raw


@dataclass(frozen=True, slots=True, eq=False)
class Update:
    """Results of some scans. arrived_s: (scans,), when each came, by the computer's monotonic clock. missed: times
    of scans, s, for which there was no time since the last update. texts: of each scan; none if no sink wants any.
    """

    arrived_s: Floats
    output: Output
    adoptions: list[Adoption] = field(default_factory=list)
    missed: list[float] = field(default_factory=list)
    texts: list[ScanText] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.output)


@dataclass(frozen=True, slots=True, eq=False)
class Head:
    """What a sink knows when it opens. texts: the sensor, masks and truth as JSON by name, for files that carry them.
    report: of a fault, to the user.
    """

    sensor: Sensor
    pads: tuple[str, ...]
    texts: dict[str, str]
    report: Callable[[str, str], None]


@dataclass(frozen=True, slots=True, eq=False)
class Ending:
    """What is known when a run has ended. failed: it did not end in order."""

    summary: Summary | None
    patterns: Sequence[LearnedPattern]
    failed: bool = False


class Sink(Protocol):
    """A place for results. One thread calls it; it may block without holding up the estimate.

    lossless: nothing is dropped for it. raw: it wants scans as they arrived, too. dropped: what it could not pass on.
    gathers_s: time for which what has come may wait, s, so that more is written at once.

    Some have more. texts: true for one that writes `Update.texts`, and gets results as they came, not joined. summed:
    true for one that writes the summary of a run. files: the paths of one that writes files. unwritten: scans given to
    a file, of which it is not known yet that they can be read from it.
    """

    lossless: bool
    raw: bool
    dropped: int
    gathers_s: float

    def open(self, head: Head) -> None:
        """Open file or port. Raises SinkUnusable, PortTaken."""

    def write_raw(self, scans: RawScans, *, late: bool) -> None:
        """Scans (scans, columns) as the source sent them. late: they came too late to be estimated from."""

    def write(self, update: Update) -> None:
        """Results."""

    def tick(self) -> None:
        """Called several times a second, whether anything came or not."""

    def hurry(self) -> None:
        """The run ends: wait a little for a full disk or a slow peer, not longer. Called by another thread."""

    def close(self, ending: Ending) -> None:
        """The run has ended. Called whatever has happened, after `open` only."""


class ResultSink:
    """What sinks of results share: no raw scans, nothing to do between results."""

    raw = False
    gathers_s = 0.0

    def write_raw(self, _scans: RawScans, *, late: bool) -> None:
        """Raw scans are not asked for."""

    def tick(self) -> None:
        """Nothing is held."""
