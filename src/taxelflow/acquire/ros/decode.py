"""Bytes of messages to stamps and readings, many at once where all messages have the same binary form."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.acquire.limits import MOST_MESSAGE_BYTES
from taxelflow.messages import Floats
from taxelflow.sensors.pads import MOST_TAXELS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray
    from rosbags.typesys.store import Typestore

    from taxelflow.acquire.ros.kinds import Kind
    from taxelflow.acquire.ros.topics import Topic
    from taxelflow.messages import Bytes


_MOST_DEFINITION = 1 << 17
"""Characters of a message definition at most."""
_MOST_ELEMENTS = MOST_TAXELS
"""Elements of an array of fixed length in a message at most."""


class Decoder:
    """Decodes the messages of one topic. Raises the errors of `rosbags` for an invalid message definition."""

    def __init__(self, topic: Topic, kind: Kind) -> None:
        store = store_of(topic.message_type, topic.definition, topic.language, kind.definition)
        self._ros1 = topic.encoding == "ros1"
        self._read = store.deserialize_ros1 if self._ros1 else store.deserialize_cdr
        self._type, self._kind = topic.message_type, kind
        self._form: _Form | None = None

    def one(self, content: bytes) -> tuple[float, list[Floats]]:
        """Stamp in s (NaN if the message has none) and readings per part, in the order of the message."""
        if len(content) > MOST_MESSAGE_BYTES:
            raise ValueError(f"it has {len(content)} bytes, and may have {MOST_MESSAGE_BYTES}")
        stamp, parts = self._fields(content)
        with np.errstate(invalid="ignore"):  # a signalling NaN is a missing reading like any other
            return stamp, [part.astype(np.float64) for part in parts]

    def named(self, content: bytes) -> tuple[float, list[str], list[float]]:
        """Stamp in s, names and readings of a message with a field `name`."""
        stamp, parts = self.one(content)
        return (
            stamp,
            list(follow(self._read(memoryview(content), self._type), "name")[0]),
            parts[0].tolist() if parts else [],
        )

    def part_names(self, content: bytes) -> tuple[str, ...]:
        """Names of the parts, where the kind of message has any."""
        if not self._kind.names:
            return ()
        return tuple(map(str, follow(self._read(memoryview(content), self._type), self._kind.names)))

    def block(self, contents: Sequence[bytes]) -> tuple[Floats, Floats] | None:
        """Stamps (messages,) and readings (messages, cells); None if the messages differ in their binary form."""
        if self._form is None or not self._form.fits(contents):
            self._form = self._formed(contents[0])
            if self._form is None or not self._form.fits(contents):
                return None
        return self._form.read(contents)

    def _fields(self, content: bytes) -> tuple[float, list[NDArray[Any]]]:
        message = self._read(memoryview(content), self._type)  # a view, so that arrays point into it
        found = parts_of([item for path in self._kind.values for item in follow(message, path)])
        stamps = follow(message, self._kind.stamp) if self._kind.stamp else []
        return (_seconds(stamps[0]) if stamps else np.nan), found

    def _formed(self, content: bytes) -> _Form | None:
        """The binary form of a message; None if readings or stamp are not contiguous in its bytes."""
        stamp, parts = self._fields(content)
        whole = np.frombuffer(content, np.uint8)
        base = whole.__array_interface__["data"][0]
        spans = []
        free = np.zeros(len(whole), dtype=np.bool_)
        for part in parts:
            start = part.__array_interface__["data"][0] - base
            if not 0 <= start <= len(whole) - part.nbytes:
                return None
            spans.append((start, start + part.nbytes, part.dtype))
            free[start : start + part.nbytes] = True
        at = None
        if self._kind.stamp:
            at = 0 if self._ros1 and self._kind.stamp == "t_s" else 4  # after seq in ROS 1, the encapsulation in CDR
            if len(whole) < at + 8 or _stamps(whole[np.newaxis], at, self._kind.stamp)[0] != stamp:
                return None
            free[at : at + 8] = True
            free[:at] |= self._ros1  # seq counts up, an encapsulation stays
        fixed = np.flatnonzero(~free)
        return _Form(len(whole), fixed, whole[fixed], tuple(spans), self._kind.stamp, at)


@dataclass(frozen=True, slots=True)
class _Form:
    """Binary form of messages of one length.

    fixed, frame: positions and values of the bytes that are equal in all. spans: start, stop and type of the readings
    per part. stamp: field of the stamp, stamp_at: position of its 8 bytes, None without one.
    """

    length: int
    fixed: NDArray[np.int64]
    frame: Bytes
    spans: tuple[tuple[int, int, np.dtype[Any]], ...]
    stamp: str
    stamp_at: int | None

    def fits(self, contents: Sequence[bytes]) -> bool:
        """Whether all messages have this form."""
        if any(len(content) != self.length for content in contents):
            return False
        return bool((self._stacked(contents)[:, self.fixed] == self.frame).all())

    def read(self, contents: Sequence[bytes]) -> tuple[Floats, Floats]:
        """Stamps (messages,) and readings (messages, cells) of messages of this form."""
        stacked = self._stacked(contents)
        parts = [stacked[:, start:stop].copy().view(kind) for start, stop, kind in self.spans]
        values = np.concatenate(parts, axis=1, dtype=np.float64) if parts else np.zeros((len(contents), 0))
        if self.stamp_at is None:
            return np.full(len(contents), np.nan), values
        return _stamps(stacked, self.stamp_at, self.stamp), values

    def _stacked(self, contents: Sequence[bytes]) -> Bytes:
        return np.frombuffer(b"".join(contents), np.uint8).reshape(len(contents), self.length)


def _stamps(stacked: Bytes, at: int, stamp: str) -> Floats:
    """Stamps (messages,) in s, stored as a float64 or as seconds and nanoseconds in uint32."""
    own = stacked[:, at : at + 8].copy()
    if stamp == "t_s":
        number: Floats = own.view("<f8")[:, 0]
        return number
    pair = own.view("<u4").astype(np.float64)
    seconds: Floats = pair[:, 0] + pair[:, 1] * 1e-9
    return seconds


def _seconds(stamp: Any) -> float:
    return float(stamp.sec + stamp.nanosec * 1e-9 if hasattr(stamp, "nanosec") else stamp)


def parts_of(items: list[Any]) -> list[NDArray[Any]]:
    """Readings of a message per part (cells,): arrays are parts, single numbers together are one."""
    return items if not items or np.ndim(items[0]) else [np.array(items)]


def follow(message: Any, path: str) -> list[Any]:
    """Values at a path of `Kind`, of a message or of one as a dict. Raises AttributeError or KeyError where the message
    has no such field.
    """
    found = [message]
    for step in path.split("."):
        names, iterates, key = step.removesuffix("]").partition("[")
        found = [_field(one, name) for one in found for name in names.split(",")]
        if iterates:
            found = [item for items in found for item in (_in_order(items, key) if key else items)]
    return found


def _in_order(items: Sequence[Any], key: str) -> list[Any]:
    return sorted(items, key=lambda item: _field(item, key))


def _field(message: Any, name: str) -> Any:
    return message[name] if isinstance(message, dict) else getattr(message, name)


@lru_cache(maxsize=64)
def store_of(message_type: str, definition: str, language: str, fallback: str) -> Typestore:
    """Store with a message type and those it contains, from a definition in `language`, else from `fallback`."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    if len(definition) > _MOST_DEFINITION:
        raise ValueError(f"the definition of {message_type} has {len(definition)} characters")
    if not language:
        store = get_typestore(Stores.ROS2_HUMBLE)
        if message_type not in store.fielddefs:
            text = fallback.replace("{package}", message_type.split("/", maxsplit=1)[0])
            store.register(get_types_from_msg(text, message_type))
        return store
    store = get_typestore(Stores.EMPTY)
    if language == "msg":
        _register(store, get_types_from_msg(definition, message_type))
        return store
    for part in filter(str.strip, definition.split("=" * 80 + "\n")):
        _register(store, get_types_from_idl(part.partition("\n")[2] if part.startswith("IDL: ") else part))
    return store


def _register(store: Typestore, types: Any) -> None:
    """Add types of a file. Raises ValueError for an array whose length would make code or messages of any size."""
    from rosbags.interfaces import Nodetype

    for name, (_, fields) in types.items():
        for field, (kind, detail) in fields:
            if kind == Nodetype.ARRAY and not 0 < detail[1] <= _MOST_ELEMENTS:
                raise ValueError(f"field {field} of {name} is an array of {detail[1]} elements")
    store.register(types)
