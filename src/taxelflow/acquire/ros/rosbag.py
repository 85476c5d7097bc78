"""ROS 1 bags, ROS 2 bag directories and single sqlite3 files by `rosbags`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from taxelflow.acquire.ros.mcap import seen
from taxelflow.acquire.ros.topics import Topic
from taxelflow.errors import RecordingCorrupt, RecordingTruncated

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

_REINDEX = "the recorder was not closed, or the file is truncated: run `rosbag reindex {}` on a copy and read the copy"


class RosbagSource:
    """Reads a bag by its index."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.metadata: dict[str, str] = {}
        self._encoding = "ros1" if path.suffix.lower() == ".bag" else "cdr"
        try:
            with self._open() as reader:
                self.topics = _topics(reader, self._encoding)
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
                own = [link for link in reader.connections if link.id in topic.channels]
                for _, received_ns, content in reader.messages(connections=own):
                    yield received_ns, content
                    read += 1
        except Exception as error:  # the parsers' errors for a damaged file
            raise RecordingTruncated(self._path, read, topic.messages, seen(error)) from error

    def _open(self) -> Reader1 | Reader2:
        if self._encoding == "ros1":
            from rosbags.rosbag1 import Reader as Ros1

            return Ros1(self._path)
        from rosbags.rosbag2 import Reader as Ros2

        return Ros2(self._path)


def _topics(reader: Reader1 | Reader2, encoding: str) -> list[Topic]:
    """Topics by name and type, each of one or more connections."""
    from rosbags.interfaces import MessageDefinitionFormat

    languages: dict[MessageDefinitionFormat, Literal["msg", "idl", ""]] = {
        MessageDefinitionFormat.MSG: "msg",
        MessageDefinitionFormat.IDL: "idl",
        MessageDefinitionFormat.NONE: "",
    }
    keys = dict.fromkeys((link.topic, link.msgtype) for link in reader.connections)
    found = []
    for name, message_type in sorted(keys):
        own = [link for link in reader.connections if (link.topic, link.msgtype) == (name, message_type)]
        text = own[0].msgdef
        messages = sum(link.msgcount for link in own)
        channels = tuple(link.id for link in own)
        found.append(Topic(name, message_type, messages, encoding, text.data, languages[text.format], channels))
    return found


def _begins_as_bag(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(13) == b"#ROSBAG V2.0\n"
