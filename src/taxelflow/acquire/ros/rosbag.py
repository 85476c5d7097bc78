"""ROS 1 bags, ROS 2 bag directories and single sqlite3 files by `rosbags`, which unpacks only what was checked."""

from __future__ import annotations

import bz2
from contextlib import closing
from itertools import chain
from typing import TYPE_CHECKING, Any, Literal

from taxelflow.acquire.limits import (
    FREE_BYTES,
    MOST_MESSAGE_BYTES,
    Budget,
    unpack_bz2,
    unpack_lz4,
    unpack_zstd,
)
from taxelflow.acquire.ros.mcap import McapSource, seen
from taxelflow.acquire.ros.topics import Topic
from taxelflow.errors import RecordingCorrupt, RecordingTooLarge, RecordingTruncated

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

_REINDEX = "the recorder was not closed, or the file is truncated: run `rosbag reindex {}` on a copy and read the copy"
_MOST_METADATA_BYTES = 1 << 20
"""Size of a metadata.yaml at most: a bag of 1000 files needs 0.2 MB, and its parser is slow."""
_MOST_TOPICS = 10_000
"""Largest number of topics of a bag; a file with more is damaged."""
_READ_TABLES = ("schema", "topics", "messages", "message_definitions")


class RosbagSource:
    """Reads a bag by its index."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.metadata: dict[str, str] = {}
        self._encoding = "ros1" if path.suffix.lower() == ".bag" else "cdr"
        if path.is_dir():
            _check_directory(path)
        elif self._encoding == "cdr":
            _check_database(path)
        try:
            with self._open() as reader:
                self.topics = _topics(reader, self._encoding)
        except RecordingTooLarge:
            raise
        except Exception as error:
            if self._encoding == "ros1" and _begins_as_bag(path):
                remedy = _REINDEX.format(path.name)
                raise RecordingCorrupt(path, f"its index is missing or damaged ({seen(error)})", remedy) from error
            raise

    def messages(self, topic: Topic) -> Iterator[tuple[int, bytes]]:
        """See `Source`."""
        read = 0
        try:
            with self._open() as reader:
                for message in _messages(reader, topic, self._path):
                    yield _whole(message)
                    read += 1
        except RecordingTooLarge:
            raise
        except Exception as error:  # the parsers' errors for a damaged file
            raise RecordingTruncated(self._path, read, topic.messages, seen(error)) from error

    def _open(self) -> Reader1 | Reader2:
        if self._encoding == "ros1":
            from rosbags.rosbag1 import Reader as Ros1

            return Ros1(self._path)
        from rosbags.rosbag2 import Reader as Ros2

        return Ros2(self._path)


def _whole(message: Any) -> tuple[int, bytes]:
    """Time and bytes of a message. Raises TypeError: a damaged row of a database may hold anything."""
    received_ns, content = message
    if not isinstance(received_ns, int) or not isinstance(content, bytes | bytearray | memoryview):
        raise TypeError("a message has no time, or no bytes")
    return received_ns, content if isinstance(content, bytes) else bytes(content)


def _messages(reader: Any, topic: Topic, path: Path) -> Iterator[tuple[int, bytes]]:
    """Time of receipt in ns and bytes of a topic's messages. Raises RecordingTooLarge and errors of the parsers."""
    budget = Budget(path)
    own = [link for link in reader.connections if link.id in topic.channels]
    if path.suffix.lower() == ".bag":
        reader.chunks = {at: _bounded(chunk, path, budget) for at, chunk in reader.chunks.items()}
    storages = getattr(getattr(reader, "storage", None), "storages", [])
    if any(hasattr(storage, "chunks") for storage in storages):  # MCAP, whose chunks rosbags unpacks unchecked
        yield from chain.from_iterable(_mcap_messages(storage.path, topic) for storage in storages)
        return
    packed = bool(storages) and reader.compression_mode == "message"
    if packed:
        reader.storage.metadata = reader.storage.metadata._replace(compression_mode=None)
    for _, received_ns, content in reader.messages(connections=own):
        if packed:
            message = unpack_zstd(content, path, MOST_MESSAGE_BYTES)
            budget.spend(len(message))
            yield received_ns, message
        else:
            yield received_ns, content


def _mcap_messages(path: Path, topic: Topic) -> Iterator[tuple[int, bytes]]:
    source = McapSource(path)
    for own in source.topics:
        if (own.name, own.message_type) == (topic.name, topic.message_type):
            yield from source.messages(own)


def _bounded(chunk: Any, path: Path, budget: Budget) -> Any:
    """A chunk of a ROS 1 bag that unpacks only as much as a chunk may hold, and accounts for it."""
    from lz4.frame import decompress

    unpack = {bz2.decompress: unpack_bz2, decompress: unpack_lz4}.get(chunk.decompressor)
    return chunk if unpack is None else chunk._replace(decompressor=_accounted(unpack, path, budget))


def _accounted(unpack: Callable[[bytes, Path], bytes], path: Path, budget: Budget) -> Callable[[bytes], bytes]:
    def unpacked(content: bytes) -> bytes:
        found = unpack(content, path)
        budget.spend(len(found))
        return found

    return unpacked


def _check_directory(path: Path) -> None:
    """Check the files of a ROS 2 bag before `rosbags` reads them. Raises RecordingTooLarge, RecordingCorrupt."""
    size = (path / "metadata.yaml").stat().st_size
    if size > _MOST_METADATA_BYTES:
        remedy = f"it may have {_MOST_METADATA_BYTES}: read its .mcap or .db3 files alone"
        raise RecordingTooLarge(path, f"its metadata.yaml has {size} bytes", remedy)
    for file in path.iterdir():
        if file.suffix == ".zstd":  # rosbags unpacks it to a temporary folder
            _check_packed(file)
        elif file.suffix == ".db3":
            _check_database(file)


def _check_packed(file: Path) -> None:
    import zstandard

    budget = Budget(file)
    with file.open("rb") as packed, zstandard.ZstdDecompressor().stream_reader(packed) as reader:
        while piece := reader.read(FREE_BYTES >> 10):
            budget.spend(len(piece))


def _check_database(path: Path) -> None:
    """Refuse a database whose tables are computed: views and generated columns may yield rows without end."""
    import sqlite3

    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)) as database:
            made = "SELECT name FROM sqlite_master WHERE type = 'view' OR sql LIKE 'CREATE VIRTUAL%'"
            computed = [name for (name,) in database.execute(made).fetchmany(1)]
            for table in _READ_TABLES:
                columns = database.execute(f"PRAGMA table_xinfo({table})").fetchall()
                computed += [f"{table}.{column[1]}" for column in columns if column[6]]
            topics, distinct = database.execute("SELECT count(*), count(DISTINCT id) FROM topics").fetchone()
    except sqlite3.Error:
        return  # what is no such database, rosbags refuses
    if computed:
        seen_here = f"its {computed[0]} is computed, not stored"
        raise RecordingCorrupt(path, seen_here, "give a database that ROS 2 has recorded")
    if topics > _MOST_TOPICS or topics != distinct:
        seen_here = f"it has {topics} topics with {distinct} different numbers"
        raise RecordingTooLarge(path, seen_here, f"a bag has at most {_MOST_TOPICS} topics, each with a number")


def _topics(reader: Reader1 | Reader2, encoding: str) -> list[Topic]:
    """Topics by name and type, each of one or more connections."""
    from rosbags.interfaces import MessageDefinitionFormat

    languages: dict[MessageDefinitionFormat, Literal["msg", "idl", ""]] = {
        MessageDefinitionFormat.MSG: "msg",
        MessageDefinitionFormat.IDL: "idl",
        MessageDefinitionFormat.NONE: "",
    }
    groups: dict[tuple[str, str], list[Any]] = {}
    for link in reader.connections:
        groups.setdefault((link.topic, link.msgtype), []).append(link)
    found = []
    for (name, message_type), own in sorted(groups.items()):
        text = own[0].msgdef
        messages = sum(link.msgcount for link in own)
        channels = tuple(link.id for link in own)
        found.append(Topic(name, message_type, messages, encoding, text.data, languages[text.format], channels))
    return found


def _begins_as_bag(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(13) == b"#ROSBAG V2.0\n"
