from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taxelflow.acquire.joints import asked_joints, joints_of, read_joints
from taxelflow.errors import RecordingCorrupt
from taxelflow.messages import Joints
from taxelflow.pipeline import api
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.hand import JointsInvalid
from taxelflow.sensors.kinematics import hand_model

DATA = Path(os.environ.get("TAXELFLOW_DATA", Path(__file__).parents[3] / "shared" / "data"))
SDH = DATA / "sdh-dsa" / "tennisball.dsa"


def test_angles_are_interpolated_and_never_invented() -> None:
    joints = Joints(("a", "b"), np.array([1.0, 1.2, 3.0]), np.array([[0.0, 1.0], [0.2, 1.0], [0.4, 2.0]]))
    found = joints.at(np.array([0.5, 1.1, 1.2, 2.0, 3.0, 9.0]), ["b", "a", "c"])
    np.testing.assert_allclose(found[1:3], [[1.0, 0.1, np.nan], [1.0, 0.2, np.nan]])
    assert np.isnan(found[[0, 3, 5]]).all()  # before, in a gap, after
    np.testing.assert_allclose(found[4, :2], [2.0, 0.4])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_joint_that_starts_again_at_minus_pi_goes_the_shorter_way(sign: float) -> None:
    t_s, fine = np.arange(0, 9.0, 0.1), np.linspace(0.0, 8.9, 700)
    turned = sign * (1.0 + 2.5 * t_s)
    joints = Joints(("a", "b"), t_s, np.stack([np.angle(np.exp(1j * turned)), np.sin(t_s)], axis=1))
    found = joints.at(fine, ["a", "b"])
    np.testing.assert_allclose(np.exp(1j * found[:, 0]), np.exp(1j * sign * (1.0 + 2.5 * fine)), atol=1e-9)
    np.testing.assert_array_equal(found[:, 1], np.interp(fine, t_s, np.sin(t_s)))
    np.testing.assert_array_equal(joints.at(t_s, ["a"]), joints.angles[:, :1])
    parts = [joints.at(part, ["a", "b"]) for part in np.array_split(fine, 7)]
    np.testing.assert_array_equal(np.concatenate(parts), found)
    np.testing.assert_allclose(
        Joints(("a",), np.array([0.0, 0.1]), np.array([[3.13], [-3.13]])).at(np.array([0.05]), ["a"]), np.pi
    )


def test_constant_angles_hold_at_all_times() -> None:
    joints = asked_joints("f1=30deg f2=1.5", load_sensor("barretthand-162"))
    np.testing.assert_allclose(joints.at(np.array([-5.0, 1e9]), ["f2", "f1"]), [[1.5, np.pi / 6]] * 2)


def test_a_named_pose_of_the_hand_is_known_by_its_name() -> None:
    joints = asked_joints("hook", load_sensor("barretthand-162"))
    assert joints.at(np.zeros(1), ["f1"])[0, 0] == pytest.approx(np.radians(100))


def test_a_csv_with_joints_is_read_and_a_bad_one_named(tmp_path: Path) -> None:
    path = tmp_path / "joints.csv"
    path.write_text("t_s,a,b\n0.0,1,2\n0.1,1.5,2\n")
    np.testing.assert_allclose(read_joints(path).at(np.array([0.05]), ["a"]), [[1.25]])
    for text, seen in (
        ("a,b\n1,2\n", "its header is 'a,b'"),
        ("t_s,a\n1,x\n", "no number"),
        ("t_s,a\n1\n", "as long as"),
    ):
        path.write_text(text)
        with pytest.raises(JointsInvalid, match=seen):
            read_joints(path)
    with pytest.raises(JointsInvalid, match=r"cannot be read \(No such file or directory\)"):
        read_joints(tmp_path / "none.csv")


def test_angles_of_a_coupled_joint_name_the_joint_that_it_follows(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    sensor, path = load_sensor("barretthand-162"), tmp_path / "joints.csv"
    assert sensor.hand is not None
    (follower, driver), *_ = hand_model(sensor.hand.urdf, sensor.hand.base, sensor.name).drivers.items()
    path.write_text(f"t_s,{driver},{follower}\n0,1,1\n")
    for given in (f"{follower}=1", str(path)):
        with pytest.raises(JointsInvalid, match=f"joint '{follower}' follows '{driver}'; leave {follower} out$"):
            asked_joints(given, sensor)


def test_repeated_and_unknown_times_are_left_out() -> None:
    joints = joints_of(("a",), np.array([2.0, 1.0, 1.0, 3.0]), np.array([[2.0], [1.0], [9.0], [np.nan]]))
    assert joints.t_s.tolist() == [1.0, 2.0]
    assert joints.angles[:, 0].tolist() == [1.0, 2.0]


def test_a_joint_that_starts_late_or_pauses_leaves_the_others_known() -> None:
    t_s = 0.1 * np.arange(41)
    late, pausing = np.where(t_s > 1.95, t_s, np.nan), np.where((t_s < 1.05) | (t_s > 1.95), 1.0, np.nan)
    seldom = np.where(np.arange(41) % 4 == 0, -t_s, np.nan)
    angles = np.column_stack([late, pausing, seldom, t_s])
    joints = joints_of(("late", "pausing", "seldom", "always"), t_s, angles)
    found = joints.at(np.array([0.5, 1.5, 1.98, 2.5, 4.02]), joints.names)
    expected = [[np.nan, 1, -0.5, 0.5], [np.nan, np.nan, -1.5, 1.5], [2, np.nan, -1.98, 1.98], [2.5, 1, -2.5, 2.5]]
    np.testing.assert_allclose(found, [*expected, [4, 1, -4, 4]])
    again = joints_of(joints.names, joints.t_s, joints.angles)  # as a converted recording is read
    np.testing.assert_array_equal(again.angles, joints.angles)


def table(tmp_path: Path) -> Path:
    path = tmp_path / "scans.csv"
    header = ["t_s", "joint:a", *(f"value{n}" for n in range(16)), "joint:b"]
    rows = [",".join(header)] + [",".join(map(str, [0.1 * k, 0.01 * k, *[1.0] * 16, 0.5])) for k in range(8)]
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize("suffix", ["npz", "mcap", "parquet"])
def test_joint_columns_of_a_csv_stay_with_the_recording(tmp_path: Path, suffix: str) -> None:
    recording = api.read(table(tmp_path), "grid:4x4@4mm")
    assert recording.joints is not None
    np.testing.assert_allclose(recording.joints.at(np.array([0.35]), ["a", "b"]), [[0.035, 0.5]])
    assert recording.load().values.shape == (8, 16)
    api.convert(recording, tmp_path / f"copy.{suffix}")
    again = api.read(tmp_path / f"copy.{suffix}").joints
    assert again is not None
    assert again.names == recording.joints.names
    np.testing.assert_array_equal(again.angles, recording.joints.angles)


@pytest.mark.parametrize("suffix", ["npz", "mcap", "parquet"])
@pytest.mark.parametrize("known", [0, 3])
def test_unknown_angles_stay_unknown_in_a_copy(tmp_path: Path, suffix: str, known: int) -> None:
    rows = [",".join(map(str, [0.1 * k, 0.5 if k < known else "", *[1.0] * 16, ""])) for k in range(8)]
    header = ",".join(["t_s", "joint:a", *(f"value{n}" for n in range(16)), "joint:b"])
    (tmp_path / "scans.csv").write_text("\n".join([header, *rows]) + "\n")
    api.convert(api.read(tmp_path / "scans.csv", "grid:4x4@4mm"), tmp_path / f"copy.{suffix}")
    again = api.read(tmp_path / f"copy.{suffix}").joints
    assert again is not None
    assert np.isfinite(again.at(0.1 * np.arange(8), ["a", "b"])).sum(axis=0).tolist() == [known, 0]


def test_an_npz_with_half_of_the_joints_is_corrupt(tmp_path: Path) -> None:
    path = tmp_path / "scans.npz"
    np.savez(path, t=np.arange(3.0), pressure=np.zeros((3, 16)), joint_names=np.array(["a"]), joint_t_s=np.zeros(1))
    with pytest.raises(RecordingCorrupt, match="member joint_angles is missing"):
        api.read(path, "grid:4x4@4mm")
    np.savez(
        path,
        t=np.arange(3.0),
        pressure=np.zeros((3, 16)),
        joint_names=np.array(["a"]),
        joint_t_s=np.zeros(1),
        joint_angles=np.zeros((2, 2)),
    )
    with pytest.raises(RecordingCorrupt, match=r"joint_angles float64 \(2, 2\)"):
        api.read(path, "grid:4x4@4mm")


def test_two_columns_of_angles_for_one_joint_are_refused(tmp_path: Path) -> None:
    """A copied column would leave the joint that it was meant for without angles."""
    t_s, scans = np.arange(3.0), np.zeros((3, 16))
    path = tmp_path / "scans.npz"
    np.savez(path, t=t_s, pressure=scans, joint_names=["a", "a"], joint_t_s=t_s, joint_angles=np.zeros((3, 2)))
    with pytest.raises(RecordingCorrupt, match="joint 'a' has two columns of angles; give each joint one"):
        api.read(path, "grid:4x4@4mm")
    text = table(tmp_path).read_text().replace("joint:b", "joint:a")
    (tmp_path / "scans.csv").write_text(text)
    with pytest.raises(RecordingCorrupt, match="joint 'a' has two columns of angles; give each joint one"):
        api.read(tmp_path / "scans.csv", "grid:4x4@4mm")
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    names = ["t_s", *(f"value{n}" for n in range(16)), "joint:a", "joint:a"]
    parquet.write_table(arrow.table([t_s] * len(names), names=names), tmp_path / "scans.parquet")
    with pytest.raises(RecordingCorrupt, match="joint 'a' has two columns of angles; give each joint one"):
        api.read(tmp_path / "scans.parquet", "grid:4x4@4mm")


def test_joint_states_beside_the_scans_of_a_bag_are_read(tmp_path: Path) -> None:
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = store.types
    with Writer(tmp_path / "bag", version=9) as writer:
        scans = writer.add_connection("/scan", "std_msgs/msg/Float32MultiArray", typestore=store)
        states = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        layout = kinds["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        for k in range(5):
            at_ns = 10**18 + k * 10**8
            array = kinds["std_msgs/msg/Float32MultiArray"](layout=layout, data=np.ones(16, np.float32))
            writer.write(scans, at_ns, store.serialize_cdr(array, "std_msgs/msg/Float32MultiArray"))
            stamp = kinds["builtin_interfaces/msg/Time"](sec=10**9, nanosec=k * 10**8)
            header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="")
            empty = np.zeros(0)
            state = kinds["sensor_msgs/msg/JointState"](
                header=header, name=["a", "b"], position=np.array([0.1 * k, 1.0]), velocity=empty, effort=empty
            )
            writer.write(states, at_ns, store.serialize_cdr(state, "sensor_msgs/msg/JointState"))
    recording = api.read(tmp_path / "bag", "grid:4x4@4mm")
    assert recording.joints is not None
    np.testing.assert_allclose(recording.joints.at(np.array([1e9 + 0.25]), ["a", "b"]), [[0.25, 1.0]], atol=1e-6)


def test_the_states_of_an_arm_do_not_bridge_a_pause_of_the_hand(tmp_path: Path) -> None:
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds, empty = store.types, np.zeros(0)
    layout = kinds["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    with Writer(tmp_path / "bag", version=9) as writer:
        scans = writer.add_connection("/scan", "std_msgs/msg/Float32MultiArray", typestore=store)
        topics = {
            name: writer.add_connection(f"/{name}/joint_states", "sensor_msgs/msg/JointState", typestore=store)
            for name in ("hand", "arm")
        }
        for k in range(50):
            at_ns = 10**18 + k * 10**8
            stamp = kinds["builtin_interfaces/msg/Time"](sec=10**9 + k // 10, nanosec=k % 10 * 10**8)
            array = kinds["std_msgs/msg/Float32MultiArray"](layout=layout, data=np.ones(16, np.float32))
            writer.write(scans, at_ns, store.serialize_cdr(array, "std_msgs/msg/Float32MultiArray"))
            for name in ("arm",) if 10 < k < 40 else ("arm", "hand"):
                state = kinds["sensor_msgs/msg/JointState"](
                    header=kinds["std_msgs/msg/Header"](stamp=stamp, frame_id=""),
                    name=[name],
                    position=np.array([0.1 * k]),
                    velocity=empty,
                    effort=empty,
                )
                writer.write(topics[name], at_ns, store.serialize_cdr(state, "sensor_msgs/msg/JointState"))
    joints = api.read(tmp_path / "bag", "grid:4x4@4mm").joints
    assert joints is not None
    found = joints.at(1e9 + np.array([0.5, 2.5, 4.5]), ["arm", "hand"])
    np.testing.assert_allclose(found, [[0.5, 0.5], [2.5, np.nan], [4.5, 4.5]], atol=1e-6)


def stamped_bag(folder: Path, joint_s: float | None = None, cut_message: int | None = None) -> Path:
    """A bag of 20 stamped scans in 1.9 s and of one joint that turns. joint_s: stamp of all its messages instead of
    their own. cut_message: number of one that has lost its end.
    """
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    from taxelflow.acquire.ros.kinds import kind_of

    touch, states = "tactile_msgs/msg/TactileState", "sensor_msgs/msg/JointState"
    kind = kind_of(touch)
    assert kind is not None
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(kind.definition, touch))
    kinds, empty = store.types, np.zeros(0)

    def header(t_s: float) -> Any:
        sec, nanosec = divmod(round(1e9 * t_s), 10**9)
        return kinds["std_msgs/msg/Header"](kinds["builtin_interfaces/msg/Time"](sec, nanosec), "")

    channel = kinds["sensor_msgs/msg/ChannelFloat32"]("all", np.ones(16, np.float32))
    with Writer(folder / "bag", version=9) as writer:
        scans = writer.add_connection("/touch", touch, typestore=store)
        joints = writer.add_connection("/joint_states", states, typestore=store)
        for k in range(20):
            t_s = 1000.0 + 0.1 * k
            writer.write(scans, round(1e9 * t_s), store.serialize_cdr(kinds[touch](header(t_s), [channel]), touch))
            own_s = t_s if joint_s is None else joint_s
            state = kinds[states](header(own_s), ["a"], np.array([0.1 * k]), empty, empty)
            content = store.serialize_cdr(state, states)
            writer.write(joints, round(1e9 * t_s), content[:30] if k == cut_message else content)
    return folder / "bag"


def test_joint_states_whose_stamps_are_not_set_are_at_their_times_of_receipt(tmp_path: Path) -> None:
    joints = api.read(stamped_bag(tmp_path, joint_s=0.0), "grid:4x4@4mm").joints
    assert joints is not None
    np.testing.assert_allclose(joints.at(np.array([1000.25, 1001.5]), ["a"])[:, 0], [0.25, 1.5], atol=1e-6)


def test_a_joint_state_that_is_cut_is_named_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(RecordingCorrupt, match=r"bag: message 7 of /joint_states: .*; record it again"):
        api.read(stamped_bag(tmp_path, cut_message=7), "grid:4x4@4mm")


@pytest.mark.long
@pytest.mark.skipif(not SDH.is_file(), reason="the recordings are not here: set TAXELFLOW_DATA")
def test_the_sdh_recordings_with_joint_angles_go_through_it_all() -> None:
    recording = api.read(SDH)
    assert recording.joints is not None
    assert len(recording.joints.names) == 7
    result = api.estimate(recording)
    assert result.spatial is not None
    both = result.spatial.pads == 2
    assert both.sum() > 1000
    rank = result.spatial.rank[both]  # two contacts without turns tell four numbers; where the ball seems smooth, fewer
    assert rank.max() <= 4
    assert np.mean(rank >= 2) > 0.99
    known = result.spatial.pose[np.isfinite(result.spatial.pose[:, 0])]
    assert np.abs(known[:, :3]).max() < 0.1
