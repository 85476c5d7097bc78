"""Topics of a bag, independent of its file format, and the choice of one."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, Protocol

from taxelflow.acquire.ros.kinds import SCAN, Kind, kind_of, known_types
from taxelflow.errors import TopicUnclear

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


_UNKNOWN = (
    "record the readings as std_msgs/Float32MultiArray or tactile_msgs/TactileState, or announce the type by an entry "
    "point of the group taxelflow.message"
)
"""What to do about messages of a type that nobody knows."""


@dataclass(frozen=True)
class Topic:
    """A topic and the type of its messages, `package/msg/Name`.

    messages: their number, None if the file does not contain it. encoding: of the messages' bytes. definition: of the
    message in the file, in `language`. channels: identifiers of the topic in its source.
    """

    name: str
    message_type: str
    messages: int | None
    encoding: str
    definition: str = field(default="", repr=False)
    language: Literal["msg", "idl", ""] = ""
    channels: tuple[Any, ...] = field(default=(), repr=False)

    @property
    def kind(self) -> Kind | None:
        """Its entry in the table of messages; None if type or encoding is unknown."""
        return kind_of(self.message_type) if self.encoding in ("ros1", "cdr") else None


class Source(Protocol):
    """An open bag, read from the start at each call of `messages`.

    metadata: texts by name that `taxelflow convert` wrote to the file.
    """

    @property
    def topics(self) -> list[Topic]:
        """All topics, of known types or not."""

    @property
    def metadata(self) -> dict[str, str]:
        """Texts by name."""

    def messages(self, topic: Topic) -> Iterator[tuple[int, bytes]]:
        """Time of receipt in ns and bytes of each message. Raises RecordingTruncated where the file is damaged."""


def _shown(topic: Topic) -> str:
    """Name and type as one line."""
    return " ".join(f"{topic.name} ({topic.message_type})".split())


def choose(path: Path, topics: list[Topic], name: str | None) -> tuple[Topic, Kind]:
    """The topic of that name, or the only one of a known type. Raises TopicUnclear, which lists them."""
    listed = [_shown(topic) for topic in topics]
    if name is not None:
        fitting = [topic for topic in topics if topic.name.strip("/") == name.strip("/")]
        if not fitting:
            raise TopicUnclear(path, f"no topic {name}", listed)
        if fitting[0].kind is None:
            known = ", ".join(one.split("/")[-1] for one in known_types())
            seen = f"{_shown(fitting[0])} is of no known type ({known}) or encoding ({fitting[0].encoding!r})"
            raise TopicUnclear(path, seen, listed, remedy=_UNKNOWN)
    else:
        usable = [topic for topic in topics if topic.kind is not None]
        fitting = [topic for topic in usable if topic.messages != 0]
        fitting = fitting or [topic for topic in usable if topic.kind is SCAN]  # our own, refused as empty
        if not fitting:
            remedy = _UNKNOWN if listed and not usable else ""
            raise TopicUnclear(path, "no topic has messages of a known type", listed, remedy=remedy)
        if len(fitting) > 1:
            raise TopicUnclear(path, f"{len(fitting)} topics fit", [_shown(t) for t in fitting])
    topic = fitting[0]
    if topic.kind is None:
        raise RuntimeError("topics without a kind were refused")
    return topic, topic.kind
