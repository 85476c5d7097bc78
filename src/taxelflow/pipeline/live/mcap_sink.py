"""Raw scans, slips, motion and events in one MCAP file that survives the end of its process: `mcap:FILE`."""

from __future__ import annotations

import io
import logging
import time
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from taxelflow.acquire.ros.write import McapScans
from taxelflow.errors import AddressInvalid, ExtraMissing
from taxelflow.numerics.clock import nanoseconds
from taxelflow.pipeline.live.adoptions import ADOPTIONS, MISSED, RESULTS
from taxelflow.publish.sinks.foxglove_messages import Drawing
from taxelflow.publish.sinks.json_topics import SCHEMAS, Properties, json_schema
from taxelflow.publish.sinks.lines import event_row, scan_texts, spatial_objects
from taxelflow.publish.sinks.patient import PatientFile

if TYPE_CHECKING:
    from taxelflow.messages import RawScans
    from taxelflow.publish.sinks.base import Ending, Head, Update
    from taxelflow.runtime.addresses import Address

_FLUSH_S = 0.5
"""Time between chunks on disk: half of what may be lost when the process is killed."""
_DRAWN_S = 1 / 30
"""Shortest time between pictures."""
_NO_SCHEMA = 0
"""Number of MCAP for what describes itself; `rosbags` opens no file with another schema than those of ROS."""
_SCHEMAS: dict[str, tuple[str, Properties]] = {
    **SCHEMAS,
    ADOPTIONS: (
        "taxelflow.Adoption",
        {"t_s": {"type": "number"}, "what": {"type": "string"}, "number": {"type": "integer"}},
    ),
    MISSED: ("taxelflow.MissedScan", {"t_s": {"type": "number"}}),
    "/late": ("taxelflow.LateScan", {"t_s": {"type": "number"}, "values": {"type": "array"}}),
}
"""JSON topics: name of the schema and its properties."""

_log = logging.getLogger("taxelflow")


class McapSink:
    """Scans as they arrived, and results if there are any; what came too late to be in order stands on `/late`."""

    lossless = True
    raw = True
    texts = True
    gathers_s = 0.01

    def __init__(self, path: Path, *, drawn: bool) -> None:
        self._path, self._wants_drawing, self.dropped = path, drawn, 0
        self.files = (path,)
        for module in ("mcap.writer", "rosbags.typesys"):  # once a source is open it must not wait for these
            import_module(module)

    def open(self, head: Head) -> None:
        """See `Sink`."""
        self._file = PatientFile(self._path, head.report)
        # All that is written here fits the buffer: on a full disk the sink's own thread waits, not the run.
        beginning = sum(len(text.encode()) for text in head.texts.values())
        self._buffered = io.BufferedWriter(self._file, io.DEFAULT_BUFFER_SIZE + 2 * beginning)
        self._scans = McapScans(self._buffered, head.texts)
        self._pads = head.pads
        self._channels: dict[str, int] = {}
        self._drawing: Drawing | None = None
        if self._wants_drawing:
            try:
                self._drawing = Drawing(head.sensor)
            except ExtraMissing as missing:
                _log.warning("%s has no pictures for Foxglove: %s", self._path, missing)

    def write_raw(self, scans: RawScans, *, late: bool) -> None:
        """See `Sink`."""
        if late:
            for t_s, values in zip(scans.t_s.tolist(), scans.values.tolist(), strict=True):
                self._write_json("/late", t_s, {"t_s": t_s, "values": values})
        else:
            self._scans.write(scans)
        self.unwritten += len(scans)
        if late or self._drawing is None:
            return
        for t_s, values in zip(scans.t_s.tolist(), scans.values, strict=True):
            if 0.0 <= t_s - self._drawn_s < _DRAWN_S:
                continue
            self._drawn_s = t_s
            for message in self._drawing.scan(t_s, values):
                self._add(message.topic, message.t_ns, message.content)

    def write(self, update: Update) -> None:
        """See `Sink`."""
        texts = update.texts or scan_texts(update, self._pads)
        for t_s, text in zip(update.output.slips.t_s.tolist(), texts, strict=True):
            self._write_json(RESULTS, t_s, {"t_s": t_s, "pads": text.pads})
            self._add("/object", nanoseconds(t_s), bytes(text.moved))
        for adoption in update.adoptions:
            self._write_json(ADOPTIONS, adoption.t_s, adoption._asdict())
        for t_s in update.missed:
            self._write_json(MISSED, t_s, {"t_s": t_s})
        for row in spatial_objects(update, self._pads):
            self._write_json("/object3d", float(row["t_s"]), row)
        for event in update.output.events:
            self._write_json("/events", event.t_s, event_row(event))
        last_s = float(update.output.slips.t_s[-1])
        if self._drawing is not None and not 0.0 <= last_s - self._arrows_s < _DRAWN_S:
            self._arrows_s = last_s
            arrows = self._drawing.arrows(update)
            self._add(arrows.topic, arrows.t_ns, arrows.content)

    def tick(self) -> None:
        """See `Sink`."""
        if time.monotonic() - self._flushed_s >= _FLUSH_S:
            self._flush()

    def hurry(self) -> None:
        """See `Sink`."""
        self._file.give_up()

    def close(self, _ending: Ending) -> None:
        """See `Sink`."""
        self._flush()  # what the summary loses is no scan
        self._scans.finish()
        self._buffered.close()

    _drawn_s = _arrows_s = float("-inf")
    _flushed_s = float("-inf")
    unwritten = 0
    """Scans since the last flush: they stand in chunks, of which a part cannot be read."""
    _lost_bytes = 0

    def _flush(self) -> None:
        self._scans.writer.flush()  # type: ignore[no-untyped-call]
        self._flushed_s = time.monotonic()
        if self._file.lost > self._lost_bytes:
            self._lost_bytes = self._file.lost
            self.dropped += self.unwritten
        self.unwritten = 0

    def _write_json(self, topic: str, t_s: float, content: object) -> None:
        self._add(topic, nanoseconds(t_s), msgspec.json.encode(content))

    def _add(self, topic: str, t_ns: int, content: bytes) -> None:
        if topic not in self._channels:
            self._channels[topic] = self._register(topic)
        self._scans.writer.add_message(self._channels[topic], t_ns, content, t_ns)

    def _register(self, topic: str) -> int:
        writer = self._scans.writer
        if topic in _SCHEMAS and not self._wants_drawing:
            return writer.register_channel(topic, "json", _NO_SCHEMA)
        if topic in _SCHEMAS:
            name, properties = _SCHEMAS[topic]
            schema_id = writer.register_schema(name, "jsonschema", json_schema(name, properties))
            return writer.register_channel(topic, "json", schema_id)
        if self._drawing is None:
            raise RuntimeError("a picture was written without a drawing")
        drawn = self._drawing.schemas[topic]
        schema_id = writer.register_schema(drawn.name, drawn.encoding, drawn.data)
        return writer.register_channel(topic, "protobuf", schema_id)


def write(address: Address) -> McapSink:
    """`mcap:FILE`; `?draw=0` leaves out the pictures for Foxglove. Raises AddressInvalid."""
    address.check_options(("draw",))
    path = address.file_path("mcap:FILE")
    if path.suffix.lower() != ".mcap" and (path.is_file() or not path.exists()):  # and no pipe or device
        raise AddressInvalid(
            address.url, f"{path.name} does not end in .mcap, by which it would be read", "mcap:FILE.mcap"
        )
    return McapSink(path, drawn=address.choice("draw", ("1", "0")) == "1")
