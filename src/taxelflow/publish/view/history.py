"""Scans and their results as they come, and what was known at any time: the one source of what the view shows.

A recording that is played and a live source fill it in the same way, from another thread than that of the view.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from threading import Lock
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

import numpy as np

from taxelflow.messages import cut, joined
from taxelflow.numerics.clock import SAME_S

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Event, Floats, LearnedPattern, Motions, Slips, SpatialMotions


@dataclass(frozen=True, slots=True)
class _Chunk:
    """Chunks of scans."""

    scans: int = 256
    """At most, if they come one by one."""
    blocks: int = 32
    """Blocks that are joined at a time."""


_CHUNK = _Chunk()


class Results(NamedTuple):
    """Results of consecutive scans, as in `messages.Output`."""

    slips: Slips
    slipping: Bools
    motions: Motions
    statistic: Floats
    spatial: SpatialMotions | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """What is shown at one time. pressure: (taxels,), Pa or counts. results: of that scan; None if not known yet."""

    t_s: float
    pressure: Floats
    results: Results | None


class Seen(NamedTuple):
    """Consecutive scans. t_s: (scans,). pressure: (scans, taxels). peak: (scans,), highest pressure of each scan."""

    t_s: Floats
    pressure: NDArray[np.float32]
    peak: Floats


Block = TypeVar("Block", Seen, Results)


class _Chunks(Generic[Block]):
    """Blocks in time order. Those that come are joined when many of them are read, and with earlier ones of no more
    scans: each scan is copied a few times only.
    """

    def __init__(self, times: Callable[[Block], Floats], join: Callable[[Sequence[Block]], Block]) -> None:
        self._times: Callable[[Block], Floats] = times
        self._join: Callable[[Sequence[Block]], Block] = join
        self._blocks: list[Block] = []
        self._new: list[Block] = []

    def append(self, block: Block) -> None:
        if len(self._times(block)):
            self._new.append(block)

    def read(self, keep_s: float) -> list[Block]:
        """All blocks, without those that are older than keep_s before the last scan."""
        count = sum(map(self._count, self._new))
        if len(self._new) >= _CHUNK.blocks or count >= _CHUNK.scans:
            tail, self._new = self._new, []
            longest_s = keep_s / 4
            while self._blocks and (more := self._count(self._blocks[-1])) <= count and count + more <= _CHUNK.scans:
                if self._times(tail[-1])[-1] - self._times(self._blocks[-1])[0] > longest_s:
                    break
                tail.insert(0, self._blocks.pop())
                count += more
            self._blocks.append(tail[0] if len(tail) == 1 else self._join(tail))
        held, old = self._blocks + self._new, 0
        if held:
            since_s = self._times(held[-1])[-1] - keep_s
            old = next(number for number, block in enumerate(held) if self._times(block)[-1] >= since_s)
        if old:
            self._blocks, self._new = self._blocks[old:], self._new[max(0, old - len(self._blocks)) :]
        return held[old:]

    def _count(self, block: Block) -> int:
        return len(self._times(block))


@dataclass
class History:
    """Scans and results in time order. events and patterns are replaced, never changed in place.

    method: whose results they are. changes: how often all results were replaced.
    keep_s: what is older than this is forgotten, chunk by chunk; of a recording nothing is.
    """

    events: list[Event] = field(default_factory=list)
    patterns: list[LearnedPattern] = field(default_factory=list)
    complete: bool = False
    """Nothing more will come."""
    keep_s: float = np.inf
    method: str = ""
    changes: int = 0

    def __post_init__(self) -> None:
        self._lock = Lock()
        self._seen = _Chunks[Seen](lambda block: block.t_s, _joined_scans)
        self._known = _Chunks[Results](_times, _joined_results)

    def see(self, t_s: Floats, pressure: Floats) -> None:
        """Append scans: t_s (scans,), pressure (scans, taxels)."""
        with self._lock:
            self._seen.append(Seen(t_s, pressure.astype(np.float32), pressure.max(axis=1, initial=0.0)))

    def add(self, results: Results, events: list[Event]) -> None:
        """Append results of scans that were seen."""
        with self._lock:
            self._known.append(results)
            if events:
                late_s = events[-1].t_s - 2 * self.keep_s
                self.events = [*(event for event in self.events if event.t_s > late_s), *events]

    def replace(self, blocks: list[Results], events: list[Event]) -> None:
        """Replace the results of all scans."""
        known = _Chunks[Results](_times, _joined_results)
        for block in blocks:
            known.append(block)
        with self._lock:
            self._known = known
            self.events = events
            self.changes += 1

    @property
    def times(self) -> Floats:
        """(scans,), of all scans."""
        blocks = self._scans()
        return np.concatenate([block.t_s for block in blocks]) if blocks else np.zeros(0)

    @property
    def span(self) -> tuple[float, float, int]:
        """Times of the first and last scan, s, and the number of scans; zeros without any."""
        blocks = self._scans()
        if not blocks:
            return 0.0, 0.0, 0
        return float(blocks[0].t_s[0]), float(blocks[-1].t_s[-1]), sum(len(block.t_s) for block in blocks)

    def strongest(self) -> float:
        """The pressure that one scan in a hundred exceeds, 0 without any."""
        blocks = self._scans()
        return float(np.quantile(np.concatenate([block.peak for block in blocks]), 0.99)) if blocks else 0.0

    def at(self, t_s: float) -> Snapshot | None:
        """The last scan up to a time; None before the first."""
        block = next((block for block in reversed(self._scans()) if block.t_s[0] <= t_s + SAME_S), None)
        if block is None:
            return None
        scan = int(np.searchsorted(block.t_s, t_s + SAME_S, side="right")) - 1
        at_s = float(block.t_s[scan])
        return Snapshot(at_s, block.pressure[scan].astype(np.float64), self.within(at_s, at_s))

    def within(self, from_s: float, to_s: float) -> Results | None:
        """Results of the scans between two times; None if there are none."""
        with self._lock:
            blocks = self._known.read(self.keep_s)
        parts = []
        for block in reversed(blocks):  # what is shown is mostly the newest
            times = _times(block)
            if times[-1] < from_s - SAME_S:
                break
            first, last = np.searchsorted(times, (from_s - SAME_S, to_s + SAME_S))
            if last > first:
                parts.append(_rows(block, int(first), int(last)))
        if not parts:
            return None
        return parts[0] if len(parts) == 1 else _joined_results(parts[::-1])

    def _scans(self) -> list[Seen]:
        with self._lock:
            return self._seen.read(self.keep_s)


def _times(results: Results) -> Floats:
    return results.slips.t_s


def _joined_scans(blocks: Sequence[Seen]) -> Seen:
    return Seen(*(np.concatenate(parts) for parts in zip(*blocks, strict=True)))


def _joined_results(blocks: Sequence[Results]) -> Results:
    slips, slipping, motions, statistic, spatial = zip(*blocks, strict=True)
    known = [one for one in spatial if one is not None]
    return Results(
        joined(slips),
        np.concatenate(slipping),
        joined(motions),
        np.concatenate(statistic),
        joined(known) if known else None,
    )


def _rows(results: Results, first: int, last: int) -> Results:
    if first == 0 and last == len(results.slipping):
        return results
    return Results(
        cut(results.slips, first, last),
        results.slipping[first:last],
        cut(results.motions, first, last),
        results.statistic[first:last],
        None if results.spatial is None else cut(results.spatial, first, last),
    )
