"""The recording that every reader returns: scans of one sensor, read block by block as often as needed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.acquire.blocks import cut_up
from taxelflow.acquire.columns import doubted_rate
from taxelflow.errors import (
    RecordingCorrupt,
    RecordingTruncated,
    TaxelCountWrong,
    TimesNotIncreasing,
    printable,
)
from taxelflow.messages import Bools, Floats, Joints, RawScans, cut, joined
from taxelflow.numerics.unmasked import floats_of
from taxelflow.sensors.channels import doubted_numbers
from taxelflow.sensors.sensor import Sensor, with_contacts, with_shear

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from numpy.typing import ArrayLike

    from taxelflow.sensors.layout import Layout

_RATE_SCANS = 5
"""Scans from which the rate is estimated; a median of fewer steps is not robust."""

HAND = "hand"
"""Name in place of a pad's where truth is in the hand frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """Ground truth: pose of the object in the frame of one pad, or in the hand frame (pad is then `hand`).

    t_s: (times,). pose: (times, 3), x, y in m and theta in rad. slipping: (times,), whether the object slid or turned
    relative to the skin at that time, if known. second: (times, 3), pose of a second object on the same pad, if any;
    slipping is that of the first.
    """

    pad: str
    t_s: Floats
    pose: Floats
    slipping: Bools | None = None
    second: Floats | None = None

    def pose_at(self, t_s: Floats) -> Floats:
        """(n, 3), the pose at times (n,), linear in between."""
        return np.stack([np.interp(t_s, self.t_s, part) for part in self.pose.T], axis=1)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Recording:
    """Scans of one sensor, read lazily: `blocks()` starts from the beginning at each call.

    Iterating gives blocks of one scan each, as a live device does. `len` is the number of scans: as declared by the
    source, which may hold fewer if it is truncated, else counted by reading it.
    source: the file, or a description of what generates the scans. format: name of the format.
    read: opens the source and yields its blocks unchanged. scans: number that the source declares, None if unknown.
    masked: (taxels,), taxels that the recording itself declares switched off. truth, joints: if known.
    notes: remarks to the user on how it is read. asked: what was asked of the reader by name, such as the topic.
    """

    source: Path | str
    format: str
    sensor: Sensor
    read: Callable[[], Iterator[RawScans]] = field(repr=False)
    scans: int | None = None
    masked: Bools = field(default_factory=lambda: np.zeros(0, dtype=np.bool_), repr=False)
    truth: Truth | None = field(default=None, repr=False)
    joints: Joints | None = field(default=None, repr=False)
    notes: tuple[str, ...] = ()
    asked: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        if not len(self.masked):
            object.__setattr__(self, "masked", np.zeros(self.layout.taxels, dtype=np.bool_))
        object.__setattr__(self, "format", printable(self.format))
        object.__setattr__(self, "notes", tuple(map(printable, self.notes)))

    def __len__(self) -> int:
        return sum(map(len, self.blocks())) if self.scans is None else self.scans

    def __iter__(self) -> Iterator[RawScans]:
        """Blocks of one scan each, from the start. Raises as `Reading` does."""
        for block in self.blocks():
            for scan in range(len(block)):
                yield cut(block, scan, scan + 1)

    def __repr__(self) -> str:
        count = "scans" if self.scans is None else f"{self.scans} scans"
        layout, truth = self.layout, ", with truth" if self.truth is not None else ""
        pads = "1 pad" if layout.pad_count == 1 else f"{layout.pad_count} pads"
        return f"<Recording {self.source}: {count} of {self.sensor.name} ({layout.taxels} taxels, {pads}){truth}>"

    def __bool__(self) -> bool:
        return True

    @classmethod
    def live(cls, sensor: Sensor, source: str = "live") -> Recording:
        """A recording without scans: what a run is started with into which a device's scans are pushed."""
        return cls(source, "live", sensor, lambda: iter(()), scans=0)

    @classmethod
    def of_arrays(
        cls,
        t_s: ArrayLike,
        values: ArrayLike,
        sensor: Sensor,
        source: str = "arrays",
        *,
        shear: ArrayLike | None = None,
    ) -> Recording:
        """A recording in memory.

        t_s: (scans,), s. values: (scans, taxels) in the sensor's unit and the order of its layout, NaN or masked where
        missing; or (scans, rows, cols) of a sensor with one full grid. shear: of the same shape and unit with a last
        axis of 2, along x (right) and y (up) of the pad; a sensor of one axis becomes one of three. Raises
        RecordingCorrupt, TaxelCountWrong, SensorFileInvalid; reading raises TimesNotIncreasing.
        """
        try:
            if np.asarray(t_s).dtype.kind in "mM":  # as floats they would be in the unit of the dates, often ns
                raise TypeError(f"t_s is {np.asarray(t_s).dtype}")
            times, readings = np.array(t_s, dtype=np.float64), floats_of(values)
            along = None if shear is None else floats_of(shear)
        except (TypeError, ValueError) as error:
            raise RecordingCorrupt(source, f"not numbers: {error}", "give arrays of numbers, times in s") from error
        if times.ndim != 1 or readings.ndim not in (2, 3) or len(readings) != len(times):
            seen = f"t_s has shape {times.shape}, values {readings.shape}"
            raise RecordingCorrupt(source, seen, "give t_s (scans,) and values (scans, taxels)")
        if readings.ndim == 3 and readings.shape[1:] != sensor.layout.full_grid:
            seen = f"values has shape {readings.shape}, which is no full grid of sensor {sensor.name}"
            raise RecordingCorrupt(source, seen, "give values (scans, taxels) in the order of the layout")
        if along is not None and along.shape != (*readings.shape, 2):
            seen = f"values has shape {readings.shape}, shear {along.shape}"
            raise RecordingCorrupt(source, seen, "give shear the shape of values, and a last axis of 2")
        readings = readings.reshape(len(times), sensor.layout.taxels if readings.ndim == 3 else readings.shape[1])
        if readings.shape[1] != sensor.layout.taxels:
            raise TaxelCountWrong(source, readings.shape[1], sensor.name, sensor.layout.taxels)
        if along is not None:
            sensor, along = with_shear(sensor, source), along.reshape(*readings.shape, 2)
        raw = RawScans(times, sensor.channel_map.to_source(readings, along))
        return cls(source, "arrays", sensor, lambda: cut_up(raw), scans=len(raw))

    @property
    def layout(self) -> Layout:
        """Layout of the sensor."""
        return self.sensor.layout

    def with_contacts(self, contacts: int | str | Mapping[str, int] | None) -> Recording:
        """The recording with a number of separate contacts, see `sensor.with_contacts`; itself for None."""
        return self if contacts is None else replace(self, sensor=with_contacts(self.sensor, contacts))

    @property
    def known_truth(self) -> Truth:
        """The truth. Raises RecordingCorrupt for a recording without truth."""
        if self.truth is None:
            raise RecordingCorrupt(self.source, "it holds no truth", "use a recording of `taxelflow simulate`")
        return self.truth

    def blocks(self) -> Reading:
        """Checked blocks of readings, from the start."""
        return Reading(self)

    def source_blocks(self) -> Reading:
        """Checked blocks in the source's columns, before the sensor's channel map, for writers."""
        return Reading(self, mapped=False)

    def load(self) -> RawScans:
        """The whole recording in memory, of a truncated one the scans before the damage. Raises as `Reading` does."""
        blocks = list(self.blocks())
        nothing = RawScans(np.zeros(0), np.zeros((0, self.sensor.channel_map.columns)))
        return joined(blocks) if blocks else self.sensor.channel_map.of_source(nothing)


class Reading:
    """One pass over a recording: checks numbers of columns and times, and drops scans with a repeated time stamp.

    Its blocks are in C order, whatever a reader's are: kernels compile for each order of an array that they meet.
    Iterating raises TaxelCountWrong, TimesNotIncreasing and RecordingCorrupt. The iteration ends normally where a
    recording is truncated; `loss` is then that error. scans, repeated: numbers of scans delivered and dropped so far.
    notes: those of the recording, and of a scan rate or numbers that no sensor has.
    """

    def __init__(self, recording: Recording, *, mapped: bool = True) -> None:
        self.scans = 0
        self.repeated = 0
        self.loss: RecordingTruncated | None = None
        self.notes = list(recording.notes)
        self._recording, self._mapped = recording, mapped
        self._disorder: TimesNotIncreasing | None = None
        self._last_s = -np.inf
        self._blocks = recording.read()

    def __iter__(self) -> Reading:
        return self

    def __next__(self) -> RawScans:
        while True:
            if self._disorder is not None:
                raise self._disorder
            try:
                block = self._checked(next(self._blocks))
            except RecordingTruncated as loss:
                if not self.scans:
                    seen = f"no scan is readable: {loss.seen}"
                    raise RecordingCorrupt(self._recording.source, seen, "record or copy it again") from loss
                self.loss = loss
                raise StopIteration from None
            except StopIteration:
                if not self.scans and self.loss is None:
                    seen = "it is not damaged, but holds no scans"
                    raise RecordingCorrupt(self._recording.source, seen, "record it again") from None
                self._check_length()
                raise
            if len(block):
                return block

    def _checked(self, block: RawScans) -> RawScans:
        sensor = self._recording.sensor
        if block.values.shape[1] != sensor.channel_map.columns:
            seen = block.values.shape[1]
            raise TaxelCountWrong(self._recording.source, seen, sensor.name, sensor.channel_map.columns)
        if self._mapped:
            self.notes += doubted_numbers(block.values, self.notes)
            block = sensor.channel_map.of_source(block)
        block = self._in_order(block.in_order())
        if not self.scans and len(block) >= _RATE_SCANS:
            self.notes += doubted_rate(1 / float(np.median(np.diff(block.t_s))), float(block.t_s[0]))
        self.scans += len(block)
        if len(block):
            self._last_s = float(block.t_s[-1])
        return block

    def _in_order(self, block: RawScans) -> RawScans:
        """The scans with increasing times; those before a decreasing or unknown time, which is raised afterwards."""
        before = np.concatenate([[self._last_s], block.t_s[:-1]])
        finite = np.isfinite(block.t_s)
        increasing = (block.t_s > before) & finite
        repeated = (block.t_s == before) & finite
        if not np.all(increasing | repeated):
            wrong = int(np.argmin(increasing | repeated))
            number = self.scans + self.repeated + wrong
            self._disorder = TimesNotIncreasing(
                self._recording.source, number, float(before[wrong]), float(block.t_s[wrong])
            )
            increasing[wrong:] = repeated[wrong:] = False
        self.repeated += int(repeated.sum())
        if increasing.all():
            return block
        shear = None if block.shear is None else block.shear[increasing]
        return RawScans(block.t_s[increasing], block.values[increasing], shear)

    def _check_length(self) -> None:
        if self.scans < _RATE_SCANS and self.scans + self.repeated > 0:
            scans = "1 scan" if self.scans == 1 else f"{self.scans} scans"
            also = f", besides {self.repeated} that repeat its time stamp" if self.repeated else ""
            self.notes.append(
                f"the recording holds {scans}{also}: noise and motion need more; check that its rows are scans and its"
                " columns taxels, and that times differ"
            )
