from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bagged import EPOCH_S, write_bag
from synthetic import grid_sensor
from taxelflow.acquire.ros.kinds import KINDS, kind_of
from taxelflow.acquire.ros.open import open_bag
from taxelflow.api import read
from taxelflow.errors import (
    ParameterInvalid,
    PitchNeeded,
    RecordingCorrupt,
    SensorNeeded,
    TaxelCountWrong,
    TopicUnclear,
)
from taxelflow.sensors.catalogue import builtin_sensors, load_sensor
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor

if TYPE_CHECKING:
    from pathlib import Path

STORAGES = ("ros1", "sqlite3", "mcap")
SCANS = 12
RANDOM = np.random.default_rng(3)
SDH_CELLS = [84, 78, 84, 78, 84, 78]
SDH = "schunk_sdh/msg/TactileSensor"


def scans_of(*cells: int, scans: int = SCANS) -> list[list[Any]]:
    return [[RANDOM.integers(0, 4000, n) for n in cells] for _ in range(scans)]


def bag_of(folder: Path, storage: str = "ros1") -> Path:
    return folder / ("a.bag" if storage == "ros1" else "bag")


def plain(cells: int) -> Sensor:
    return Sensor("plain", "count", (Pad("pad", 1, cells, (0.004, 0.004)),))


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


@pytest.mark.parametrize("storage", STORAGES)
def test_the_sdh_is_known_by_its_message_and_its_pads_are_put_into_the_controllers_order(
    tmp_path: Path, storage: str
) -> None:
    scans = scans_of(*SDH_CELLS)
    path = write_bag(bag_of(tmp_path, storage), {"/dsa": (SDH, scans)}, storage=storage)
    recording = read(path)
    assert recording.sensor == load_sensor("schunk-sdh2")
    layout, values = recording.layout, recording.load().values
    for number, name in enumerate(("thumb_proximal", "thumb_distal", "finger1_proximal", "finger1_distal")):
        pad = layout.pads.index(name)
        for scan in (0, SCANS - 1):
            grid = layout.grid(pad, values[scan], fill=-1.0)
            sent = scans[scan][number].reshape(grid.shape)
            np.testing.assert_array_equal(grid[grid >= 0], sent[grid >= 0])


def test_pressures_of_the_sdh_are_pascals(tmp_path: Path) -> None:
    scans = scans_of(*SDH_CELLS)
    path = write_bag(tmp_path / "a.bag", {"/p": ("schunk_sdh/msg/PressureArrayList", scans)})
    recording = read(path)
    assert (recording.sensor.unit, recording.sensor.to_si) == ("Pa", 1.0)
    assert "read as Pa" in recording.notes[0]
    assert recording.load().values.max() == max(part.max() for parts in scans for part in parts)


def test_a_message_without_text_in_the_file_is_read_by_ours(tmp_path: Path) -> None:
    scans = scans_of(*SDH_CELLS)
    path = write_bag(tmp_path / "bag", {"/dsa": (SDH, scans)}, storage="sqlite3", defined=False)
    assert read(path).load().values.sum() > 0
    scans = scans_of(20)
    path = write_bag(
        tmp_path / "b", {"/m": ("std_msgs/msg/Float32MultiArray", scans)}, storage="sqlite3", defined=False
    )
    np.testing.assert_array_equal(read(path, plain(20)).load().values, [parts[0] for parts in scans])


@pytest.mark.parametrize(("storage", "pattern"), [("sqlite3", "*.db3"), ("mcap", "*.mcap")])
def test_the_storage_file_of_a_ros_2_bag_may_be_given_alone(tmp_path: Path, storage: str, pattern: str) -> None:
    path = write_bag(tmp_path / "bag", {"/dsa": (SDH, scans_of(*SDH_CELLS))}, storage=storage)
    alone = open_bag(next(path.glob(pattern)), None)
    np.testing.assert_array_equal(alone.load().values, read(path).load().values)


def test_messages_that_are_not_built_alike_are_read_one_by_one(tmp_path: Path) -> None:
    scans = [[parts[0][:8], parts[0][8:]] if n % 3 else parts for n, parts in enumerate(scans_of(20))]
    path = write_bag(tmp_path / "a.bag", {"/t": ("tactile_msgs/msg/TactileState", scans)})
    np.testing.assert_array_equal(read(path, plain(20)).load().values, [np.concatenate(parts) for parts in scans])


def test_a_long_bag_comes_in_blocks_and_twice_the_same(tmp_path: Path) -> None:
    scans = scans_of(4, scans=2100)
    path = write_bag(tmp_path / "a.bag", {"/t": ("std_msgs/msg/Float32MultiArray", scans)})
    recording = read(path, plain(4))
    assert [len(block) for block in recording.blocks()] == [1024, 1024, 52]
    np.testing.assert_array_equal(recording.load().values, recording.load().values)


@pytest.mark.parametrize(
    ("stamps_s", "said"),
    [
        (np.zeros(SCANS), "not set"),
        (np.full(SCANS, 5.0), "are constant"),
        (100.0 - np.arange(SCANS), "decrease"),
        (np.arange(1, SCANS + 1), "advance 100 times as fast"),
    ],
)
def test_stamps_that_are_not_sane_give_way_to_times_of_receipt_and_that_is_said(
    tmp_path: Path, stamps_s: Any, said: str
) -> None:
    path = write_bag(tmp_path / "a.bag", {"/dsa": (SDH, scans_of(*SDH_CELLS))}, stamps_s=stamps_s)
    recording = read(path)
    assert said in recording.notes[0]
    assert "times are those of receipt" in recording.notes[0]
    np.testing.assert_allclose(recording.load().t_s - EPOCH_S, 0.01 * np.arange(SCANS), atol=1e-6)


def test_a_sensors_own_clock_is_believed(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", {"/dsa": (SDH, scans_of(*SDH_CELLS))}, stamps_s=3 + 0.0101 * np.arange(SCANS))
    recording = read(path)
    assert recording.notes == ()
    np.testing.assert_allclose(recording.load().t_s, 3 + 0.0101 * np.arange(SCANS), atol=1e-8)


def test_of_several_topics_that_fit_one_is_to_be_chosen(tmp_path: Path) -> None:
    one, other = scans_of(*SDH_CELLS), scans_of(*SDH_CELLS)
    path = write_bag(
        tmp_path / "a.bag", {"/left": (SDH, one), "/right": (SDH, other), "/log": ("std_msgs/msg/String", [["x"]])}
    )
    with pytest.raises(
        TopicUnclear, match=r"2 topics fit; choose one with --topic: /left \(schunk_sdh/msg/Tac.*, /right"
    ):
        read(path)
    chosen = read(path, topic="right")
    assert chosen.format == "ros1 bag, /right"
    assert chosen.load().values.max() == max(part.max() for parts in other for part in parts)


def test_a_topic_that_is_not_there_is_answered_with_those_that_are(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", {"/left": (SDH, scans_of(*SDH_CELLS))})
    with pytest.raises(TopicUnclear, match=r"no topic /middle; .*: /left \(schunk_sdh/msg/TactileSensor\)"):
        read(path, topic="/middle")


@pytest.mark.parametrize("topic", [None, "/log"])
def test_an_unknown_message_is_answered_with_topics_and_types(tmp_path: Path, topic: str | None) -> None:
    path = write_bag(tmp_path / "a.bag", {"/log": ("std_msgs/msg/String", [["x"]])})
    match = (
        r"/log \(std_msgs/msg/String\)"
        if topic is None
        else r"/log \(std_msgs/msg/String\) is of no known type \(Scan, Tactile"
    )
    with pytest.raises(TopicUnclear, match=match):
        read(path, topic=topic)


def test_a_topic_means_nothing_for_other_formats(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, t=np.arange(3.0), pressure=np.zeros((3, 6)))
    with pytest.raises(ParameterInvalid, match=r"topic must be left out for .* \(got '/a'\)"):
        read(path, grid_sensor(2, 3), topic="/a")


def test_a_sensor_is_asked_for_where_the_message_does_not_tell(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", {"/t": ("tactile_msgs/msg/TactileState", scans_of(12))})
    with pytest.raises(SensorNeeded, match="--sensor"):
        read(path)


def test_a_wrong_number_of_cells_is_named(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", {"/t": ("tactile_msgs/msg/TactileState", scans_of(12))})
    with pytest.raises(TaxelCountWrong, match="12 taxels per scan but sensor 'plain' has 20"):
        read(path, plain(20))


def test_pads_of_other_sizes_in_the_same_number_do_not_fit(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", {"/dsa": (SDH, scans_of(78, 84, 84, 78, 84, 78))})
    with pytest.raises(SensorNeeded):
        read(path)


def test_a_message_of_another_size_ends_the_recording_after_those_before_it(tmp_path: Path) -> None:
    scans = [*scans_of(12, scans=5), *scans_of(13, scans=1), *scans_of(12, scans=5)]
    path = write_bag(tmp_path / "a.bag", {"/t": ("tactile_msgs/msg/TactileState", scans)})
    reading = read(path, plain(12)).blocks()
    assert len(next(reading)) == 5
    with pytest.raises(RecordingCorrupt, match="message 5 has 13 values, the first one 12"):
        next(reading)


def test_an_empty_topic_is_said(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", {"/dsa": (SDH, []), "/log": ("std_msgs/msg/String", [["x"]])})
    with pytest.raises(TopicUnclear, match="no topic has messages of a known type"):
        read(path)
    with pytest.raises(RecordingCorrupt, match="topic /dsa holds no messages"):
        read(path, topic="/dsa")


def test_the_sensors_that_the_table_names_are_built_in() -> None:
    assert {name for kind in KINDS for name in kind.sensors} <= set(builtin_sensors())


@pytest.mark.parametrize("storage", STORAGES)
def test_the_barrett_hand_is_known_by_its_message(tmp_path: Path, storage: str) -> None:
    scans = scans_of(24, 24, 24, 24)
    path = write_bag(bag_of(tmp_path, storage), {"/t": ("bhand_controller/msg/TactileArray", scans)}, storage=storage)
    recording = read(path)
    assert recording.sensor == load_sensor("barretthand-bh280-96")
    sent = np.array([np.concatenate(parts) for parts in scans])
    np.testing.assert_array_equal(recording.load().values, recording.sensor.channel_map.to_readings(sent))


def test_of_an_xela_module_the_axis_normal_to_the_skin_is_read_and_its_pitch_asked_for(tmp_path: Path) -> None:
    scans = scans_of(48)
    path = write_bag(tmp_path / "a.bag", {"/x": ("xela_server_ros2/msg/SensStream", scans)})
    with pytest.raises(PitchNeeded, match="xela-4x4@"):
        read(path)
    raw = read(path, "xela-4x4@4.7mm").load()
    np.testing.assert_array_equal(raw.values, [parts[0][2::3] for parts in scans])


def test_the_real_bags_are_read(recordings: Path) -> None:
    for name, scans in (("slip_up", 288), ("no_slippage", 286)):
        recording = read(recordings / "sdh-bags" / f"{name}.bag")
        raw = recording.load()
        assert (recording.scans, recording.notes, len(raw)) == (scans, (), scans)
        assert recording.sensor.name == "schunk-sdh2"
        assert 30 < 1 / np.median(np.diff(raw.t_s)) < 33
