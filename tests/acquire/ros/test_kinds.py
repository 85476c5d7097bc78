from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from bagged import EPOCH_S, SCANS, STORAGES, bag_of, plain, scans_of, write_bag
from taxelflow.acquire.ros.kinds import KINDS, kind_of
from taxelflow.pipeline.api import read
from taxelflow.sensors.catalogue import builtin_sensors

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize(
    ("message_type", "cells"),
    [
        ("schunk_sdh/msg/PressureArray", [84]),
        ("tactile_msgs/msg/TactileState", [12, 16]),
        ("bhand_controller/msg/TactileArray", [24, 24, 24, 24]),
        ("xela_server_ros2/msg/SensStream", [48, 48]),
        ("std_msgs/msg/Float32MultiArray", [20]),
        ("std_msgs/msg/Float64MultiArray", [20]),
        ("std_msgs/msg/UInt16MultiArray", [20]),
    ],
)
def test_every_message_of_the_table_is_read_from_every_kind_of_bag(
    tmp_path: Path, storage: str, message_type: str, cells: list[int]
) -> None:
    scans = scans_of(*cells)
    path = write_bag(bag_of(tmp_path, storage), {"/touch": (message_type, scans)}, storage=storage)
    recording = read(path, plain(sum(cells)))
    assert recording.scans == SCANS
    raw = recording.load()
    np.testing.assert_array_equal(raw.values, [np.concatenate(parts) for parts in scans])
    stamped = kind_of(message_type).stamp  # type: ignore[union-attr]
    late = 0.005 if stamped else 0.0
    np.testing.assert_allclose(raw.t_s - EPOCH_S + late, 0.01 * np.arange(SCANS), atol=1e-6)
    assert bool(recording.notes) == (not stamped)
    assert recording.blocks().notes == list(recording.notes)


def test_the_table_names_built_in_sensors_once_and_has_text_for_what_ros_does_not_know() -> None:
    names = [name for kind in KINDS for name in kind.types]
    assert len(set(names)) == len(names)
    for kind in KINDS:
        assert kind.definition or all(name.startswith("std_msgs/") for name in kind.types)


def test_the_sensors_that_the_table_names_are_built_in() -> None:
    assert {name for kind in KINDS for name in kind.sensors} <= set(builtin_sensors())


def test_a_type_may_be_named_as_in_ros_1() -> None:
    assert kind_of("tactile_msgs/TactileState") is kind_of("tactile_msgs/msg/TactileState") is not None
    assert kind_of("tactile_msgs/Nothing") is None
