"""MCAP files of other writers than ROS 2."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_types_from_idl, get_typestore

from bagged import EPOCH_S, message, store_of
from taxelflow.api import read
from taxelflow.errors import RecordingCorrupt, TopicUnclear
from taxelflow.sensors.catalogue import load_sensor

if TYPE_CHECKING:
    from pathlib import Path

PLAIN = load_sensor("grid:1x4@4mm")
ROWS = np.arange(40.0).reshape(10, 4)


def write(path: Path, schema: tuple[str, str, str], encoding: str, contents: list[bytes], **options: object) -> Path:
    """A file with one topic; schema: name, encoding, text."""
    with path.open("wb") as file:
        writer = Writer(file, **options)  # type: ignore[arg-type]
        writer.start()
        number = writer.register_schema(schema[0], schema[1], schema[2].encode())
        channel = writer.register_channel("/touch", encoding, number)
        for k, content in enumerate(contents):
            at_ns = EPOCH_S * 10**9 + k * 10**7
            writer.add_message(channel, at_ns, content, at_ns)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunked", [True, False])
def test_ros_1_messages_in_mcap_are_read(tmp_path: Path, compression: CompressionType, chunked: bool) -> None:
    kind = "tactile_msgs/msg/TactileState"
    store = store_of(kind, Stores.ROS1_NOETIC)
    text, _ = store.generate_msgdef(kind)
    contents = [
        bytes(store.serialize_ros1(message(store, kind, EPOCH_S + 0.01 * k, [row]), kind)) for k, row in enumerate(ROWS)
    ]
    schema = ("tactile_msgs/TactileState", "ros1msg", text)
    path = write(tmp_path / "a.mcap", schema, "ros1", contents, compression=compression, use_chunking=chunked)
    recording = read(path, PLAIN)
    assert (recording.scans, recording.notes) == (10, ())
    np.testing.assert_array_equal(recording.load().values, ROWS)


def test_a_message_described_in_idl_is_read(tmp_path: Path) -> None:
    kind = "std_msgs/msg/Float64MultiArray"
    text = "module std_msgs { module msg { struct Float64MultiArray { sequence<double> data; }; }; };"
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_idl(text))
    contents = [bytes(store.serialize_cdr(store.types[kind](data=row), kind)) for row in ROWS]
    for schema in (text, "=" * 80 + f"\nIDL: {kind}\n{text}"):
        path = write(tmp_path / "a.mcap", (kind, "ros2idl", schema), "cdr", contents)
        np.testing.assert_array_equal(read(path, PLAIN).load().values, ROWS)


def test_an_encoding_that_is_not_known_is_said(tmp_path: Path) -> None:
    schema = ("std_msgs/msg/Float64MultiArray", "jsonschema", "{}")
    path = write(tmp_path / "a.mcap", schema, "json", [b"{}"])
    with pytest.raises(TopicUnclear, match="no topic has messages of a known type"):
        read(path, PLAIN)
    with pytest.raises(TopicUnclear, match=r"or encoding \('json'\)"):
        read(path, PLAIN, topic="/touch")


def test_a_message_whose_text_lacks_the_field_is_said(tmp_path: Path) -> None:
    schema = ("std_msgs/msg/Float64MultiArray", "ros2msg", "float64[] numbers\n")
    contents = [b"\x00\x01\x00\x00\x00\x00\x00\x00"]
    path = write(tmp_path / "a.mcap", schema, "cdr", contents)
    with pytest.raises(RecordingCorrupt, match=r"message 0: .*has no attribute 'data'") as caught:
        read(path, PLAIN)
    assert "\n" not in str(caught.value)


def test_big_endian_messages_are_read(tmp_path: Path) -> None:
    kind = "std_msgs/msg/Float64MultiArray"
    store = store_of(kind)
    text, _ = store.generate_msgdef(kind, ros_version=2)
    contents = [bytes(store.serialize_cdr(message(store, kind, 0.0, [row]), kind, little_endian=False)) for row in ROWS]
    path = write(tmp_path / "a.mcap", (kind, "ros2msg", text), "cdr", contents)
    np.testing.assert_array_equal(read(path, PLAIN).load().values, ROWS)
