"""The protocol of a live source: a context manager that yields scans as they arrive, and ticks while none does."""

from __future__ import annotations

import logging
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, Protocol

from taxelflow.sensors.channels import doubted_number

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import TracebackType
    from typing import Self

    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Floats

POLL_S = 0.1
"""Longest time that a source blocks: so soon the end of a run is noticed."""
CONNECT_S = 2.0
"""Time for an attempt to connect."""
PIECE_BYTES = 1 << 16
"""Bytes that a source reads at once, at most: the usual size of a pipe and of a socket's buffer."""

_PAUSE_S = 60.0
"""Time for which a fault that comes again in the same words is only counted."""

_log = logging.getLogger("taxelflow")


class Arrival(NamedTuple):
    """A scan as it came.

    arrived_s: the computer's monotonic clock. t_s: the device's clock, None if it sends no time. values: (columns,), as
    the source sends them, NaN where a reading is missing.
    """

    arrived_s: float
    t_s: float | None
    values: Floats


@dataclass
class Faults:
    """Counts of what went wrong, by kind; the first of each kind is logged."""

    counts: Counter[str] = field(default_factory=Counter)
    _logged_s: dict[tuple[str, str], float] = field(default_factory=dict)

    def count(self, kind: str, seen: str = "", times: int = 1) -> None:
        """One more of a kind. seen: what exactly, for the log."""
        if not self.counts[kind]:
            _log.warning("%s%s", kind, f": {seen}" if seen else "")
        self.counts[kind] += times

    def count_absurd(self, values: Floats) -> None:
        """Count a scan (columns,) that holds a number beyond any sensor's."""
        if doubted := doubted_number(values):
            self.count("absurd number", doubted)

    def report(self, kind: str, seen: str) -> None:
        """Count each time, and log, for faults that end and come again, such as a lost connection.

        A connection that flaps for a night must not fill the log: the same words are logged once a minute at most.
        """
        self.counts[kind] += 1
        now = time.monotonic()
        if now - self._logged_s.get((kind, seen), float("-inf")) >= _PAUSE_S:
            self._logged_s[kind, seen] = now
            _log.warning("%s: %s", kind, seen)


class Source(Protocol):
    """A live source of scans.

    Iterating yields an `Arrival` for each scan, and None at least every `POLL_S` while none arrives; it ends when the
    source ends in order. A source that loses its device reports that, and tries again with back-off. Where scans do
    not come at the device's pace, as in a replay, it has `paced = False`: their times are not compared with arrivals.
    """

    recording: Recording
    """Without scans: the sensor, which taxels are masked, and the source's name."""
    faults: Faults
    patient: bool
    """Whether the device waits while nobody reads: then nothing needs to be dropped on this side."""

    def __enter__(self) -> Self:
        """Connect to the device, or listen for it. Raises SourceUnreachable, PortTaken."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the device."""

    def __iter__(self) -> Iterator[Arrival | None]:
        """Scans as they arrive."""


class Parser(Protocol):
    """Bytes in, scans out. Counts what is wrong, never raises, and holds a bounded number of bytes."""

    def feed(self, received: bytes) -> list[tuple[float | None, Floats]]:
        """Times (None: the device sends none) and values of the scans that these bytes complete."""

    def end(self) -> list[tuple[float | None, Floats]]:
        """What is left when the stream ends in order."""

    def restart(self) -> None:
        """Forget a scan of which a part has come: the connection was lost."""


class WholeMessages:
    """A parser of pieces that are whole messages, by a function that reads one: nothing is held between them."""

    def __init__(self, feed: Callable[[bytes], list[tuple[float | None, Floats]]]) -> None:
        self.feed = feed

    def end(self) -> list[tuple[float | None, Floats]]:
        """See `Parser`."""
        return []

    def restart(self) -> None:
        """See `Parser`."""


class Backoff:
    """Times to wait before trying again: 0.1 s, doubled up to 2 s."""

    _FIRST_S, _LONGEST_S = 0.1, 2.0

    def __init__(self) -> None:
        self._next_s = self._FIRST_S

    def restart(self) -> None:
        """It has worked."""
        self._next_s = self._FIRST_S

    def pause(self) -> Iterator[None]:
        """Ticks until it is time to try again."""
        until = time.monotonic() + self._next_s
        self._next_s = min(2 * self._next_s, self._LONGEST_S)
        while (left := until - time.monotonic()) > 0:
            time.sleep(min(left, POLL_S))
            yield None
