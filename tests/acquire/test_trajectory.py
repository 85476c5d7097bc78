from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from bagged import EPOCH_S, header
from taxelflow.acquire.trajectory import read_trajectory
from taxelflow.errors import ParameterInvalid, TopicUnclear, TruthInvalid

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("first", ["t_s,x_m,y_m", "t_s, x_m, y_m", "\ufefft_s,x_m,y_m"])
def test_a_trajectory_is_times_and_places(tmp_path: Path, first: str) -> None:
    path = tmp_path / "truth.csv"
    path.write_text(first + "\n0,1,2\n0.5,3,4\n", encoding="utf-8")
    found = read_trajectory(str(path))
    np.testing.assert_array_equal(found.t_s, [0, 0.5])
    np.testing.assert_array_equal(found.place_m, [[1, 2], [3, 4]])


def test_theta_is_allowed(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("t_s,x_m,y_m,theta_rad\n0,1,2,9\n1,3,4,9\n")
    np.testing.assert_array_equal(read_trajectory(path).place_m, [[1, 2], [3, 4]])


@pytest.mark.parametrize(
    ("text", "seen"),
    [
        ("", "header"),
        ("t,x,y\n0,1,2\n", "header 't,x,y'"),
        ("t_s,x_m,y_m\n", "0 rows"),
        ("t_s,x_m,y_m\n0,1,2\n", "1 rows"),
        ("t_s,x_m,y_m\n0,1,2\n1,2\n", "row 3"),
        ("t_s,x_m,y_m\n0,1,2\n1,2,far\n", "row 3"),
        ("t_s,x_m,y_m\n0,1,2\n1,2,nan\n", "row 3"),
        ("t_s,x_m,y_m\n0,1,2\n0,1,3\n1,2,3\n", "pose 2"),
        ("t_s,x_m,y_m\n0,1,2\n2,1,3\n1,2,3\n", "pose 3"),
    ],
)
def test_what_is_no_trajectory_is_refused_in_one_line(tmp_path: Path, text: str, seen: str) -> None:
    path = tmp_path / "truth.csv"
    path.write_text(text)
    with pytest.raises(TruthInvalid, match=seen) as error:
        read_trajectory(path)
    assert "\n" not in str(error.value)


def poses(folder: Path, storage: str, topics: tuple[str, ...] = ("/pose",)) -> Path:
    """Ten PoseStamped messages per topic, as ROS 1, sqlite3 or MCAP."""
    writer: Any = Writer1(folder / "a.bag") if storage == "ros1" else Writer2(
        folder / "bag", version=9, storage_plugin=StoragePlugin[storage.upper()]
    )  # fmt: skip
    store = get_typestore(Stores.ROS1_NOETIC if storage == "ros1" else Stores.ROS2_HUMBLE)
    kind = "geometry_msgs/msg/PoseStamped"
    types = store.types
    with writer:
        links = [writer.add_connection(topic, kind, typestore=store) for topic in topics]
        for number in range(10):
            head = header(store, EPOCH_S + 0.1 * number)
            place = types["geometry_msgs/msg/Point"](x=0.01 * number, y=-0.02 * number, z=1.0)
            turn = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
            found = types[kind](header=head, pose=types["geometry_msgs/msg/Pose"](position=place, orientation=turn))
            content = (store.serialize_ros1 if storage == "ros1" else store.serialize_cdr)(found, kind)
            for link in links:
                writer.write(link, EPOCH_S * 10**9 + number * 10**8, content)
    return folder / "a.bag" if storage == "ros1" else folder / "bag"


@pytest.mark.parametrize("storage", ["ros1", "sqlite3", "mcap"])
def test_poses_of_a_bag_are_a_trajectory(tmp_path: Path, storage: str) -> None:
    found = read_trajectory(poses(tmp_path, storage))
    np.testing.assert_allclose(found.t_s - EPOCH_S, np.arange(10) / 10, atol=1e-6)
    np.testing.assert_allclose(found.place_m, np.arange(10)[:, np.newaxis] * [0.01, -0.02])


def test_of_several_topics_one_is_to_be_chosen(tmp_path: Path) -> None:
    path = poses(tmp_path, "ros1", ("/a", "/b"))
    with pytest.raises(TopicUnclear, match=r"2 topics hold .*choose one with --truth-topic: /a"):
        read_trajectory(path)
    with pytest.raises(TopicUnclear, match="no topic /c"):
        read_trajectory(path, "/c")
    assert len(read_trajectory(path, "b").t_s) == 10


@pytest.mark.parametrize("suffix", [".tum", ".txt"])
def test_a_tum_file_is_a_trajectory(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_text("# timestamp tx ty tz qx qy qz qw\n0.5 1 2 3 0 0 0 1\n\n1.5 4 5 6 0 0 0 1  # end\n")
    found = read_trajectory(path)
    assert found.t_s.tolist() == [0.5, 1.5]
    assert found.place_m.tolist() == [[1.0, 2.0], [4.0, 5.0]]


@pytest.mark.parametrize(
    ("content", "seen"),
    [
        ("0 1 2 3\n", "row 1 is '0,1,2,3'"),
        ("0 1 2 3 0 0 0 x\n", "row 1: could not"),
        ("# nothing\n", "0 rows of numbers"),
    ],
)
def test_what_is_no_tum_file_is_refused_in_one_line(tmp_path: Path, content: str, seen: str) -> None:
    (tmp_path / "a.tum").write_text(content)
    with pytest.raises(TruthInvalid, match=seen):
        read_trajectory(tmp_path / "a.tum")


def test_what_is_no_bag_of_poses_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"nothing")
    with pytest.raises(TruthInvalid, match=r"a\.mcap"):
        read_trajectory(tmp_path / "a.mcap")
    (tmp_path / "a.csv").write_text("t_s,x_m,y_m\n0,1,2\n1,2,3\n")
    with pytest.raises(ParameterInvalid, match="truth_topic must be left out"):
        read_trajectory(tmp_path / "a.csv", "/pose")
