from __future__ import annotations

from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from bagged import EPOCH_S, SCANS, SDH, SDH_CELLS, STORAGES, bag_of, plain, scans_of, write_bag
from synthetic import grid_sensor
from taxelflow.errors import (
    ParameterInvalid,
    PitchNeeded,
    RecordingCorrupt,
    SensorNeeded,
    TaxelCountWrong,
    TopicUnclear,
)
from taxelflow.pipeline.api import read
from taxelflow.sensors.catalogue import load_sensor

if TYPE_CHECKING:
    from pathlib import Path


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
    for recording in (read(path), read(path, "schunk-sdh2")):
        assert (recording.sensor.unit, recording.sensor.to_si) == ("Pa", 1.0)
        assert "read as Pa" in recording.notes[0]
        assert recording.load().values.max() == max(part.max() for parts in scans for part in parts)


def test_a_sensor_file_gives_the_unit_of_pressures_of_the_sdh(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", {"/p": ("schunk_sdh/msg/PressureArrayList", scans_of(*SDH_CELLS))})
    of_file = msgspec.structs.replace(load_sensor("schunk-sdh2"), unit="MPa", scale_pa=None, full_scale=None)
    recording = read(path, of_file)
    assert recording.sensor == of_file
    assert not recording.notes


@pytest.mark.parametrize(
    ("stamps_s", "said"),
    [
        (np.zeros(SCANS), "not set"),
        (np.full(SCANS, 5.0), "are constant"),
        (100.0 - np.arange(SCANS), "decrease"),
        (np.arange(1, SCANS + 1), "advance 100 times as fast"),
    ],
)
def test_invalid_stamps_give_way_to_times_of_receipt_with_a_note(tmp_path: Path, stamps_s: Any, said: str) -> None:
    path = write_bag(tmp_path / "a.bag", {"/dsa": (SDH, scans_of(*SDH_CELLS))}, stamps_s=stamps_s)
    recording = read(path)
    assert said in recording.notes[0]
    assert "times are those of receipt" in recording.notes[0]
    np.testing.assert_allclose(recording.load().t_s - EPOCH_S, 0.01 * np.arange(SCANS), atol=1e-6)


def test_times_of_receipt_are_the_nearest_numbers_as_in_a_csv(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", {"/dsa": (SDH, scans_of(*SDH_CELLS))}, stamps_s=np.zeros(SCANS))
    with AnyReader([path]) as bag:
        received_ns = [received for _, received, _ in bag.messages()]
    assert read(path).load().t_s.tolist() == [float(f"{ns // 10**9}.{ns % 10**9:09}") for ns in received_ns]


def test_a_sensors_own_clock_is_believed(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", {"/dsa": (SDH, scans_of(*SDH_CELLS))}, stamps_s=3 + 0.0101 * np.arange(SCANS))
    recording = read(path)
    assert recording.notes == ()
    np.testing.assert_allclose(recording.load().t_s, 3 + 0.0101 * np.arange(SCANS), atol=1e-8)


def test_a_topic_means_nothing_for_other_formats(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, t=np.arange(3.0), pressure=np.zeros((3, 6)))
    with pytest.raises(ParameterInvalid, match=r"topic must be left out for .* \(got '/a'\)"):
        read(path, grid_sensor(2, 3), topic="/a")


def test_a_sensor_is_required_where_the_message_has_none(tmp_path: Path) -> None:
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


TWO_PADS = """name = "two"
unit = "kPa"
[[pads]]
name = "a"
rows = 1
cols = 2
pitch_m = [0.01, 0.01]
[[pads]]
name = "b"
rows = 3
cols = 1
pitch_m = [0.01, 0.01]
"""


@pytest.mark.parametrize("order", ["", 'first = "bottom-left"\n'])
def test_parts_with_the_names_of_the_pads_are_read_by_them(tmp_path: Path, order: str) -> None:
    """A publisher may send them in any order, and in another one later."""
    (tmp_path / "two.toml").write_text(TWO_PADS + order)
    a, b = [1.0, 2.0], [3.0, 4.0, 5.0]
    turned: list[Any] = [{"b": b, "a": a}] * 5 + [{"a": a, "b": b}, {"b": b, "a": a}, {"a": a, "b": b}]
    path = write_bag(tmp_path / "a.bag", {"/t": ("tactile_msgs/msg/TactileState", turned)})
    sensor = load_sensor(str(tmp_path / "two.toml"))
    values = np.concatenate([block.values for block in read(path, sensor).blocks()])
    np.testing.assert_array_equal(values, [[*a, *(b[::-1] if order else b)]] * len(turned))
    others: list[Any] = [{"x": a, "a": b}] * 5
    path = write_bag(tmp_path / "b.bag", {"/t": ("tactile_msgs/msg/TactileState", others)})
    np.testing.assert_array_equal(next(read(path, sensor).blocks()).values[0], [*a, *(b[::-1] if order else b)])


def test_an_empty_topic_is_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", {"/dsa": (SDH, []), "/log": ("std_msgs/msg/String", [["x"]])})
    with pytest.raises(TopicUnclear, match="no topic has messages of a known type"):
        read(path)
    with pytest.raises(RecordingCorrupt, match="not damaged, but topic /dsa holds no messages, so there are no scans"):
        read(path, topic="/dsa")


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
