"""What every source of scans is: a recording that can be read again and again, block by block."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from taxelflow.errors import RecordingCorrupt, RecordingError, RecordingTruncated, TaxelCountWrong, TimesNotIncreasing
from taxelflow.messages import Bools, Floats, RawScans, joined
from taxelflow.sensors.sensor import Sensor, with_contacts

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from pathlib import Path

    from taxelflow.sensors.layout import Layout

Item = TypeVar("Item")
Block = TypeVar("Block")

BLOCK_SCANS = 1024
"""Scans in a block: large enough to be fast, small enough to hold many sensors' blocks in memory."""

_SLOWEST_HZ, _FASTEST_HZ = 0.5, 20e3
"""Rates outside of these come of times in a wrong unit."""

_ENOUGH_STEPS = 5

HAND = "hand"
"""Stands for a pad's name where truth is in the hand frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """Where the object really was, in the frame of one pad, or of the hand (pad is then `hand`).

    t_s: (times,). pose: (times, 3), x, y in m and theta in rad. slipping: (times,), whether it really slid or turned
    relative to the skin at that time, if known. second: (times, 3), pose of a second object on the same pad, if there
    is one; slipping is of the first.
    """

    pad: str
    t_s: Floats
    pose: Floats
    slipping: Bools | None = None
    second: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Scans of one sensor, read lazily: `blocks()` starts again at each call.

    source: the file, or what made the scans. scans: how many the source promises, None if it does not say.
    masked: (taxels,), taxels that the recording itself declares switched off. truth: if known. notes: what a user
    should know of how it is read.
    read: opens the source and yields its blocks as they stand there.
    """

    source: Path | str
    format: str
    sensor: Sensor
    read: Callable[[], Iterator[RawScans]] = field(repr=False)
    scans: int | None = None
    masked: Bools = field(default_factory=lambda: np.zeros(0, dtype=np.bool_), repr=False)
    truth: Truth | None = field(default=None, repr=False)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not len(self.masked):
            object.__setattr__(self, "masked", np.zeros(self.layout.taxels, dtype=np.bool_))

    @classmethod
    def live(cls, sensor: Sensor, source: str = "live") -> Recording:
        """A recording without scans: what a run is started with into which a device's scans are pushed."""
        return cls(source, "live", sensor, lambda: iter(()))

    @property
    def layout(self) -> Layout:
        """Taxel arrays of the sensor."""
        return self.sensor.layout

    def told_apart(self, contacts: int | str | Mapping[str, int] | None) -> Recording:
        """The same recording with so many contacts to be told apart; see `sensor.with_contacts`. None: as it is."""
        return self if contacts is None else replace(self, sensor=with_contacts(self.sensor, contacts))

    @property
    def known_truth(self) -> Truth:
        """The truth. Raises RecordingCorrupt where a recording has none, as only those of the rig surely do."""
        if self.truth is None:
            raise RecordingCorrupt(self.source, "it carries no truth", "use a recording of `taxelflow simulate`")
        return self.truth

    def blocks(self) -> Reading:
        """Checked blocks of scans, from the start."""
        return Reading(self)

    def sent(self) -> Reading:
        """The same as the source sends them, not yet picked and scaled by the sensor's wiring: to be written again."""
        return Reading(self, wired=False)

    def load(self) -> RawScans:
        """The whole recording in memory. Raises what `Reading` raises; a truncated one gives what is there."""
        blocks = list(self.blocks())
        return joined(blocks) if blocks else RawScans(np.zeros(0), np.zeros((0, self.layout.taxels)))


class Reading:
    """One pass over a recording: checks counts and times, drops repeated stamps, remembers what was lost.

    Iterating raises TaxelCountWrong, TimesNotIncreasing and RecordingCorrupt. A recording that ends too early
    simply ends; `loss` then says how much is missing. `notes` are the recording's, and one if its rate is odd.
    """

    def __init__(self, recording: Recording, *, wired: bool = True) -> None:
        self.scans = 0
        self.repeated = 0
        self.loss: RecordingTruncated | None = None
        self.notes = list(recording.notes)
        self._recording, self._wired = recording, wired
        self._fault: TimesNotIncreasing | None = None
        self._last_s = -np.inf
        self._blocks = recording.read()

    def __iter__(self) -> Reading:
        return self

    def __next__(self) -> RawScans:
        while True:
            if self._fault is not None:
                raise self._fault
            try:
                block = self._checked(next(self._blocks))
            except RecordingTruncated as loss:
                if not self.scans:
                    raise self._empty(str(loss)) from loss
                self.loss = loss
                raise StopIteration from None
            except StopIteration:
                if not self.scans and self.loss is None:
                    raise self._empty("it ends before the first scan") from None
                raise
            if len(block):
                return block

    def _empty(self, seen: str) -> RecordingCorrupt:
        return RecordingCorrupt(self._recording.source, f"no scan is readable: {seen}", "record or copy it again")

    def _checked(self, block: RawScans) -> RawScans:
        wiring = self._recording.sensor.wiring
        if block.values.shape[1] != wiring.columns:
            seen = block.values.shape[1]
            raise TaxelCountWrong(self._recording.source, seen, self._recording.sensor.name, wiring.columns)
        if self._wired:
            block = RawScans(block.t_s, wiring.readings(block.values))
        before = np.concatenate([[self._last_s], block.t_s[:-1]])
        finite = np.isfinite(block.t_s)
        fresh = (block.t_s > before) & finite
        repeated = (block.t_s == before) & finite
        if not np.all(fresh | repeated):
            wrong = int(np.argmin(fresh | repeated))
            number = self.scans + self.repeated + wrong
            self._fault = TimesNotIncreasing(
                self._recording.source, number, float(before[wrong]), float(block.t_s[wrong])
            )
            fresh[wrong:] = repeated[wrong:] = False  # what came before it still stands
        self.repeated += int(repeated.sum())
        if not fresh.all():
            block = RawScans(block.t_s[fresh], block.values[fresh])
        if not self.scans and len(block) >= _ENOUGH_STEPS:
            self._judge_rate(1 / float(np.median(np.diff(block.t_s))))
        self.scans += len(block)
        if len(block):
            self._last_s = float(block.t_s[-1])
        return block

    def _judge_rate(self, rate_hz: float) -> None:
        if not _SLOWEST_HZ <= rate_hz <= _FASTEST_HZ:
            self.notes.append(
                f"{rate_hz:.3g} scans a second is not what tactile sensors do: are times in s? "
                "(of a table, --columns.time-unit says so)"
            )


def in_blocks(items: Iterable[Item], made: Callable[[list[Item]], Block]) -> Iterator[Block]:
    """Blocks of BLOCK_SCANS items, as `made` makes them; what comes before a RecordingError is given first."""
    block: list[Item] = []
    try:
        for item in items:
            block.append(item)
            if len(block) == BLOCK_SCANS:
                yield made(block)
                block = []
    except RecordingError:
        if block:
            yield made(block)
        raise
    if block:
        yield made(block)
