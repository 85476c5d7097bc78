"""A topic of a bag as a recording: its sensor, the clock that its times are from, and its blocks of scans."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.acquire.base import Recording
from taxelflow.acquire.blocks import in_blocks
from taxelflow.acquire.limits import scans_per_block
from taxelflow.acquire.metadata import joints_text_in, masked_in, sensor_in, truth_in
from taxelflow.acquire.ros.columns import columns_of
from taxelflow.acquire.ros.decode import Decoder
from taxelflow.acquire.ros.joint_states import joints_in
from taxelflow.acquire.ros.kinds import SCAN
from taxelflow.acquire.ros.mcap import McapSource, seen
from taxelflow.acquire.ros.rosbag import RosbagSource
from taxelflow.acquire.ros.topics import choose
from taxelflow.acquire.ros.units import in_unit_of
from taxelflow.errors import (
    RecordingCorrupt,
    RecordingTruncated,
    SensorNeeded,
    TaxelCountWrong,
    TaxelflowError,
)
from taxelflow.messages import Floats, RawScans
from taxelflow.numerics.clock import seconds
from taxelflow.sensors.catalogue import builtin_sensors, load_sensor

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from taxelflow.acquire.ros.kinds import Kind
    from taxelflow.acquire.ros.topics import Source, Topic
    from taxelflow.sensors.layout import Indices
    from taxelflow.sensors.sensor import Sensor

_REMEDY = "give a ROS 1 bag (.bag), a ROS 2 bag (its directory, or a .db3 of it) or an .mcap file"


@dataclass(frozen=True, slots=True)
class _Clock:
    """How the clock of a bag is chosen."""

    probed: int = 256
    """Messages from which the clock is chosen."""
    rate_messages: int = 10
    """Messages from which the rate of the stamps is compared with that of the receipt times."""
    rate_factor: float = 2.0
    """Largest factor between the two: receipt is delayed, but a clock in another unit is off by 1000."""


_CLOCK = _Clock()


def open_bag(path: Path, sensor: Sensor | None, topic: str | None = None) -> Recording:
    """Open a bag or MCAP file. Raises TopicUnclear, SensorNeeded, TaxelCountWrong, RecordingCorrupt."""
    try:
        source: Source = McapSource(path) if path.suffix.lower() == ".mcap" else RosbagSource(path)
        chosen, kind = choose(path, source.topics, topic)
        decoder = Decoder(chosen, kind)
    except (TaxelflowError, OSError):
        raise
    except Exception as error:  # the parsers' errors for a file that is no bag
        remedy = "read one of its .mcap or .db3 files alone" if path.is_dir() else _REMEDY
        raise RecordingCorrupt(path, seen(error), remedy) from error
    received_s, stamps_s, parts, named = _probe(path, source, chosen, decoder)
    cells = [len(part) for part in parts]
    sensor = in_unit_of(kind, sensor or sensor_in(path, source.metadata) or _sensor(path, kind, cells))
    if columns_of(sensor, kind, cells, named) is None:
        raise TaxelCountWrong(path, sum(cells), sensor.name, sensor.channel_map.columns)
    doubt = "" if kind is SCAN else _stamp_error(stamps_s, received_s)
    reader = _Reader(path, source, chosen, decoder, sensor, kind, cells, not doubt, scans_per_block(sensor))
    notes = [f"{doubt}: times are those of receipt"] if doubt else []
    notes += [kind.note] if kind.note and kind.unit in ("", sensor.unit) else []  # else a sensor file has its own unit
    return Recording(
        path,
        _format(path, chosen),
        sensor,
        reader.blocks,
        scans=chosen.messages,
        masked=masked_in(path, source.metadata, sensor.layout.taxels),
        truth=truth_in(path, source.metadata, sensor),
        joints=joints_text_in(path, source.metadata) or joints_in(path, source, use_stamps=not doubt),
        notes=tuple(notes),
    )


def _format(path: Path, topic: Topic) -> str:
    name = "mcap" if path.suffix.lower() == ".mcap" else "ros1 bag" if topic.encoding == "ros1" else "ros2 bag"
    return f"{name}, {topic.name}"


def _probe(
    path: Path, source: Source, topic: Topic, decoder: Decoder
) -> tuple[Floats, Floats, list[Floats], tuple[str, ...]]:
    """Times of receipt and stamps (messages,) of the first messages, and of the first one the readings per part, and
    the parts' names.
    """
    received_s: list[float] = []
    stamps: list[float] = []
    first: list[Floats] = []
    named: tuple[str, ...] = ()
    try:
        for received_ns, content in islice(source.messages(topic), _CLOCK.probed):
            stamp, parts = _decoded(path, len(stamps), decoder, content)
            first, named = first or parts, named or decoder.part_names(content)
            received_s.append(seconds(received_ns))
            stamps.append(stamp)
    except (RecordingTruncated, RecordingCorrupt) as error:
        if not stamps:
            raise RecordingCorrupt(path, f"no message of {topic.name} is readable: {error}", _REMEDY) from error
    if not stamps:
        seen = f"it is not damaged, but topic {topic.name} holds no messages, so there are no scans"
        raise RecordingCorrupt(path, seen, "record it again, or choose another topic")
    return np.array(received_s), np.array(stamps), first, named


def _decoded(path: Path, number: int, decoder: Decoder, content: bytes) -> tuple[float, list[Floats]]:
    try:
        return decoder.one(content)
    except Exception as error:  # a message that does not match its type
        raise RecordingCorrupt(path, f"message {number}: {seen(error)}", "record or copy it again") from error


def _sensor(path: Path, kind: Kind, cells: list[int]) -> Sensor:
    """The built-in sensor of this kind of message whose number of cells matches. Raises SensorNeeded."""
    for name in kind.sensors:
        if name in builtin_sensors():
            sensor = load_sensor(name)
            if columns_of(sensor, kind, cells) is not None:
                return sensor
    raise SensorNeeded(path, builtin_sensors())


def _stamp_error(stamps_s: Floats, received_s: Floats) -> str:
    """Why the stamps in the messages are not used; empty if they are."""
    if np.isnan(stamps_s).all():
        return "messages have no stamp"
    steps = np.diff(stamps_s)
    if not np.isfinite(stamps_s).all() or not stamps_s.any():
        return "stamps of messages are not set"
    if len(steps) and not steps.any():
        return "stamps of messages are constant"
    if (steps < 0).any():
        return "stamps of messages decrease"
    span_s, receipt_s = stamps_s[-1] - stamps_s[0], received_s[-1] - received_s[0]
    known = len(stamps_s) >= _CLOCK.rate_messages and receipt_s > 0
    if known and not 1 / _CLOCK.rate_factor < span_s / receipt_s < _CLOCK.rate_factor:
        return f"stamps of messages advance {span_s / receipt_s:.3g} times as fast as the receipt times"
    return ""


@dataclass(frozen=True, slots=True, eq=False)
class _Reader:
    """Decodes messages to scans, block by block.

    cells: numbers of a message, per part. use_stamps: times are the stamps in the messages, not those of receipt.
    block_scans: of a block, at most.
    """

    path: Path
    source: Source
    topic: Topic
    decoder: Decoder
    sensor: Sensor
    kind: Kind
    cells: list[int]
    use_stamps: bool
    block_scans: int
    _known: dict[tuple[tuple[int, ...], tuple[str, ...]], Indices | None] = field(default_factory=dict)

    def blocks(self) -> Iterator[RawScans]:
        """Blocks from the start. A message that cannot be read raises after the scans before it."""
        done = 0

        def weight(item: tuple[int, bytes]) -> int:
            return len(item[1]) + 8 * sum(self.cells)

        for block in in_blocks(self.source.messages(self.topic), list, weight, self.block_scans):
            yield from self._scans(block, done)
            done += len(block)

    def _scans(self, block: list[tuple[int, bytes]], done: int) -> Iterator[RawScans]:
        received_s = seconds(np.array([received_ns for received_ns, _ in block]))
        contents = [content for _, content in block]
        uniform = self._uniform(contents)
        if uniform is not None:
            stamps_s, values = uniform
            columns = self._columns(tuple(self.cells), self.decoder.part_names(contents[0]))
            yield self._scans_at(received_s, stamps_s, values if columns is None else values[:, columns])
            return
        stamps: list[float] = []
        rows: list[Any] = []
        fault: TaxelflowError | None = None
        for number, content in enumerate(contents, done):
            try:
                stamp, parts = _decoded(self.path, number, self.decoder, content)
                found = sum(map(len, parts))
                if found != sum(self.cells):
                    seen_here = f"message {number} has {found} values, the first one {sum(self.cells)}"
                    raise RecordingCorrupt(self.path, seen_here, "record each sensor on a topic of its own")
            except RecordingCorrupt as error:
                fault = error
                break
            stamps.append(stamp)
            row = np.concatenate(parts) if parts else np.zeros(0)
            columns = self._columns(tuple(map(len, parts)), self.decoder.part_names(content))
            rows.append(row if columns is None else row[columns])
        if rows:
            yield self._scans_at(received_s[: len(rows)], np.array(stamps), np.array(rows))
        if fault is not None:
            raise fault

    def _uniform(self, contents: list[bytes]) -> tuple[Floats, Floats] | None:
        """Stamps and values of messages of one binary form; None if they have to be decoded one by one."""
        try:
            found = self.decoder.block(contents)
        except Exception:  # a damaged message: decoding one by one finds which
            return None
        return found if found is not None and found[1].shape[1] == sum(self.cells) else None

    def _columns(self, cells: tuple[int, ...], named: tuple[str, ...]) -> Indices | None:
        """Which numbers of messages with these parts are read; None for all in their order. A publisher may change the
        order of named parts.
        """
        if (cells, named) not in self._known:
            columns = columns_of(self.sensor, self.kind, cells, named)
            if columns is None:  # the parts are divided in another way than in the first message
                columns = columns_of(self.sensor, self.kind, self.cells)
            in_order = columns is None or np.array_equal(columns, np.arange(sum(cells)))
            self._known[cells, named] = None if in_order else columns
        return self._known[cells, named]

    def _scans_at(self, received_s: Floats, stamps_s: Floats, values: Floats) -> RawScans:
        """Scans at the times that are used."""
        return RawScans(stamps_s if self.use_stamps else received_s, values)
