from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_idl, get_typestore

from bagged import PLAIN, ROWS, SDH, SDH_CELLS, message, plain, scans_of, store_of, write_bag, write_mcap_file
from taxelflow.acquire.devices.base import Faults
from taxelflow.acquire.devices.rosbridge import RosbridgeParser
from taxelflow.acquire.ros.decode import Decoder
from taxelflow.acquire.ros.kinds import kind_of
from taxelflow.acquire.ros.topics import Topic
from taxelflow.errors import RecordingCorrupt
from taxelflow.pipeline.api import read

if TYPE_CHECKING:
    from pathlib import Path


def test_a_message_described_in_idl_is_read(tmp_path: Path) -> None:
    kind = "std_msgs/msg/Float64MultiArray"
    text = "module std_msgs { module msg { struct Float64MultiArray { sequence<double> data; }; }; };"
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_idl(text))
    contents = [bytes(store.serialize_cdr(store.types[kind](data=row), kind)) for row in ROWS]
    for schema in (text, "=" * 80 + f"\nIDL: {kind}\n{text}"):
        path = write_mcap_file(tmp_path / "a.mcap", (kind, "ros2idl", schema), "cdr", contents)
        np.testing.assert_array_equal(read(path, PLAIN).load().values, ROWS)


def test_a_message_whose_text_lacks_the_field_is_refused(tmp_path: Path) -> None:
    schema = ("std_msgs/msg/Float64MultiArray", "ros2msg", "float64[] numbers\n")
    contents = [b"\x00\x01\x00\x00\x00\x00\x00\x00"]
    path = write_mcap_file(tmp_path / "a.mcap", schema, "cdr", contents)
    with pytest.raises(RecordingCorrupt, match=r"message 0: .*has no attribute 'data'") as caught:
        read(path, PLAIN)
    assert "\n" not in str(caught.value)


def test_big_endian_messages_are_read(tmp_path: Path) -> None:
    kind = "std_msgs/msg/Float64MultiArray"
    store = store_of(kind)
    text, _ = store.generate_msgdef(kind, ros_version=2)
    contents = [bytes(store.serialize_cdr(message(store, kind, 0.0, [row]), kind, little_endian=False)) for row in ROWS]
    path = write_mcap_file(tmp_path / "a.mcap", (kind, "ros2msg", text), "cdr", contents)
    np.testing.assert_array_equal(read(path, PLAIN).load().values, ROWS)


def test_a_message_without_text_in_the_file_is_read_by_ours(tmp_path: Path) -> None:
    scans = scans_of(*SDH_CELLS)
    path = write_bag(tmp_path / "bag", {"/dsa": (SDH, scans)}, storage="sqlite3", defined=False)
    assert read(path).load().values.sum() > 0
    scans = scans_of(20)
    path = write_bag(
        tmp_path / "b", {"/m": ("std_msgs/msg/Float32MultiArray", scans)}, storage="sqlite3", defined=False
    )
    np.testing.assert_array_equal(read(path, plain(20)).load().values, [parts[0] for parts in scans])


def test_messages_that_are_not_built_alike_are_read_one_by_one(tmp_path: Path) -> None:
    scans = [[parts[0][:8], parts[0][8:]] if n % 3 else parts for n, parts in enumerate(scans_of(20))]
    path = write_bag(tmp_path / "a.bag", {"/t": ("tactile_msgs/msg/TactileState", scans)})
    np.testing.assert_array_equal(read(path, plain(20)).load().values, [np.concatenate(parts) for parts in scans])


def test_sensors_of_a_message_are_read_in_the_order_of_their_positions() -> None:
    kind, parts = "xela_server_ros2/msg/SensStream", [np.arange(6), np.arange(6, 12)]
    store = store_of(kind)
    sent = message(store, kind, 2.5, parts)
    sent.sensors.reverse()
    sent.sensors[0].time = 2.6
    form = kind_of(kind)
    assert form is not None
    stamp, (values,) = Decoder(Topic("", kind, None, "cdr"), form).one(bytes(store.serialize_cdr(sent, kind)))
    assert (stamp, values.tolist()) == (2.5, list(range(12)))


def test_so_they_are_through_rosbridge() -> None:
    def sensor(position: int, numbers: list[int]) -> dict[str, Any]:
        return {"sensor_pos": position, "time": float(position), "taxels": [dict(zip("xyz", numbers, strict=True))]}

    sent = {"op": "publish", "msg": {"sensors": [sensor(2, [4, 5, 6]), sensor(1, [1, 2, 3])]}}
    faults = Faults()
    parser = RosbridgeParser(plain(6), kind_of("xela_server_ros2/SensStream"), faults, timed=True)
    ((t_s, values),) = parser.feed(json.dumps(sent).encode())
    assert (t_s, values.tolist(), dict(faults.counts)) == (1.0, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], {})


def test_a_reading_that_is_a_signalling_nan_is_missing() -> None:
    kind, number = "std_msgs/msg/Float32MultiArray", kind_of("std_msgs/Float32MultiArray")
    assert number is not None
    store = store_of(kind)
    content = bytes(store.serialize_cdr(message(store, kind, 0.0, [np.array([0.0, 1.0])]), kind))
    odd = content.replace(bytes(4) + np.float32(1.0).tobytes(), bytes.fromhex("0000A07F") + np.float32(1.0).tobytes())
    _, [values] = Decoder(Topic("/m", kind, None, "cdr"), number).one(odd)
    np.testing.assert_array_equal(values, [np.nan, 1.0])
