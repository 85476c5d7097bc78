"""MCAP files of other writers than ROS 2."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from mcap.writer import CompressionType
from rosbags.typesys import Stores

from bagged import EPOCH_S, PLAIN, ROWS, message, store_of, write_mcap_file
from taxelflow.errors import TopicUnclear
from taxelflow.pipeline.api import read

if TYPE_CHECKING:
    from pathlib import Path


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
    path = write_mcap_file(tmp_path / "a.mcap", schema, "ros1", contents, compression=compression, use_chunking=chunked)
    recording = read(path, PLAIN)
    assert (recording.scans, recording.notes) == (10, ())
    np.testing.assert_array_equal(recording.load().values, ROWS)


def test_an_unknown_encoding_is_named(tmp_path: Path) -> None:
    schema = ("std_msgs/msg/Float64MultiArray", "jsonschema", "{}")
    path = write_mcap_file(tmp_path / "a.mcap", schema, "json", [b"{}"])
    with pytest.raises(TopicUnclear, match="no topic has messages of a known type"):
        read(path, PLAIN)
    with pytest.raises(TopicUnclear, match=r"or encoding \('json'\)"):
        read(path, PLAIN, topic="/touch")
