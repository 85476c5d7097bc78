"""MCAP files by the streaming reader of the `mcap` package, which also reads truncated files."""

from __future__ import annotations

import zlib
from collections import Counter
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Any, Literal

from taxelflow.acquire.limits import MOST_CHUNK_BYTES, Budget, unpack_lz4, unpack_zstd
from taxelflow.acquire.ros.kinds import ros2_name
from taxelflow.acquire.ros.topics import Topic
from taxelflow.errors import RecordingCorrupt, RecordingTooLarge, RecordingTruncated

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from mcap.records import Channel, Chunk, McapRecord, Schema
    from mcap.summary import Summary

METADATA = "taxelflow"
"""Name of the metadata record that `taxelflow convert` writes."""

_LANGUAGES: dict[str, Literal["msg", "idl", ""]] = {
    "ros1msg": "msg",
    "ros2msg": "msg",
    "ros2idl": "idl",
}


@dataclass(frozen=True, slots=True)
class _Charge:
    """What records count for in what a file unpacks to: so long their decoding takes."""

    bytes: int = 1024
    """Of a record."""
    records: int = 4096
    """Records that are charged at once."""


_CHARGE = _Charge()


class McapSource:
    """Reads an MCAP file from its start, in constant memory; the summary at its end saves one pass."""

    def __init__(self, path: Path) -> None:
        """Raises RecordingCorrupt for a file that is cut before anything can be read, and the parser's errors."""
        from mcap.exceptions import EndOfFile, RecordLengthLimitExceeded

        self._path = path
        try:
            self._open()
        except (EndOfFile, RecordLengthLimitExceeded) as error:  # as of a run that was killed in its first second
            raise RecordingCorrupt(path, f"it ends before its first scan ({seen(error)})", "record it again") from error

    def _open(self) -> None:
        self.metadata = self._metadata()
        summary = self._summary()
        if summary is not None and summary.statistics is not None:
            counts = summary.statistics.channel_message_counts
            self.topics = _topics(summary.channels, summary.schemas, counts, whole=True)
        else:
            self.topics = self._topics_by_reading()

    def messages(self, topic: Topic) -> Iterator[tuple[int, bytes]]:
        """See `Source`."""
        from mcap.records import Message

        read = 0
        wanted = set(topic.channels)
        try:
            for record in self._records():
                if isinstance(record, Message) and record.channel_id in wanted:
                    yield record.log_time, record.data
                    read += 1
        except RecordingTooLarge:
            raise
        except Exception as error:  # the parsers' errors for a damaged file
            raise RecordingTruncated(self._path, read, topic.messages, seen(error)) from error

    def _records(self) -> Iterator[McapRecord]:
        from mcap.records import Chunk
        from mcap.stream_reader import StreamReader

        largest = self._path.stat().st_size
        budget = Budget(self._path)
        with self._path.open("rb") as file:
            reader = StreamReader(file, emit_chunks=True, validate_crcs=True, record_size_limit=largest)
            for record in reader.records:
                if isinstance(record, Chunk):
                    content = _unpacked(record, self._path)
                    budget.spend(len(content))
                    yield from _charged(_records_of(content), budget)
                else:
                    yield record

    def _metadata(self) -> dict[str, str]:
        """Our metadata record, which precedes the first chunk. Raises the parser's error for a damaged start."""
        from mcap.records import Chunk, Message, Metadata
        from mcap.stream_reader import StreamReader

        largest = self._path.stat().st_size
        with self._path.open("rb") as file:
            for record in StreamReader(file, emit_chunks=True, record_size_limit=largest).records:
                if isinstance(record, Metadata) and record.name == METADATA:
                    return record.metadata
                if isinstance(record, (Chunk, Message)):
                    break
        return {}

    def _summary(self) -> Summary | None:
        from mcap.reader import SeekingReader

        with self._path.open("rb") as file:
            try:
                return SeekingReader(file, record_size_limit=self._path.stat().st_size).get_summary()
            except Exception:  # a truncated file has no summary
                return None

    def _topics_by_reading(self) -> list[Topic]:
        from mcap.records import Channel, Message, Schema

        channels: dict[int, Channel] = {}
        schemas: dict[int, Schema] = {}
        counts: Counter[int] = Counter()
        whole = False
        try:
            for record in self._records():
                if isinstance(record, Message):
                    counts[record.channel_id] += 1
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Schema):
                    schemas[record.id] = record
            whole = True
        except Exception:  # a truncated file: `messages` raises the error again, with the count
            if not channels:
                raise
        return _topics(channels, schemas, counts, whole=whole)


def seen(error: Exception) -> str:
    """Message of a library's error as one line."""
    return " ".join(str(error).split()) or type(error).__name__


def _as_it_is(content: bytes, _path: Path) -> bytes:
    return content


_UNPACK: dict[str, Callable[[bytes, Path], bytes]] = {
    "": _as_it_is,
    "zstd": unpack_zstd,
    "lz4": unpack_lz4,
}


def _unpacked(chunk: Chunk, path: Path) -> bytes:
    """Records of a chunk. Raises RecordingTooLarge before it is unpacked too far, ValueError where it is damaged."""
    if chunk.uncompressed_size > MOST_CHUNK_BYTES:
        seen = f"a chunk of {len(chunk.data)} bytes declares {chunk.uncompressed_size}"
        raise RecordingTooLarge(path, seen, f"write it with chunks of at most {MOST_CHUNK_BYTES} bytes")
    if chunk.compression not in _UNPACK:
        raise ValueError(f"a chunk is compressed by {chunk.compression!r}; known are lz4 and zstd")
    content = _UNPACK[chunk.compression](chunk.data, path)
    if len(content) != chunk.uncompressed_size:
        raise ValueError(f"a chunk unpacks to {len(content)} bytes and declares {chunk.uncompressed_size}")
    if chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc:
        raise ValueError("a chunk does not match its checksum")
    return content


def _charged(records: Iterator[McapRecord], budget: Budget) -> Iterator[McapRecord]:
    for number, record in enumerate(records, 1):
        if number % _CHARGE.records == 0:
            budget.spend(_CHARGE.records * _CHARGE.bytes)
        yield record


def _records_of(content: bytes) -> Iterator[McapRecord]:
    """Records of an unpacked chunk, one by one: together they may take ten times its memory."""
    from mcap.exceptions import EndOfFile
    from mcap.stream_reader import StreamReader

    file = BytesIO(content)
    records = StreamReader(file, skip_magic=True, emit_chunks=True, record_size_limit=len(content)).records
    while file.tell() < len(content):
        try:
            yield next(records)
        except EndOfFile:
            if file.tell() < len(content):
                raise
            return  # the last record was of an unknown kind, which is left out


def _topics(channels: dict[int, Channel], schemas: dict[int, Schema], counts: Any, *, whole: bool) -> list[Topic]:
    """Topics by name and type, each of one or more channels; with counts only if the file is complete (`whole`)."""
    groups: dict[tuple[str, str, str], list[Channel]] = {}
    for channel in channels.values():
        schema = schemas.get(channel.schema_id)
        name = schema.name if schema else "unknown"
        groups.setdefault((channel.topic, ros2_name(name), channel.message_encoding), []).append(channel)
    found = []
    for (topic, message_type, encoding), own in groups.items():
        schema = schemas.get(own[0].schema_id)
        language: Literal["msg", "idl", ""] = _LANGUAGES.get(schema.encoding, "") if schema else ""
        found.append(
            Topic(
                topic,
                message_type,
                sum(counts.get(channel.id, 0) for channel in own) if whole else None,
                encoding,
                schema.data.decode() if schema and language else "",
                language,
                tuple(channel.id for channel in own),
            )
        )
    return sorted(found, key=lambda topic: topic.name)
