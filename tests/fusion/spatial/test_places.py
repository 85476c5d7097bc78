"""What `estimate` says, and writes, where joint angles are missing."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

import numpy as np
import pytest

from linked import carried, linked_hand
from taxelflow.acquire.joints import asked_joints, joints_of
from taxelflow.cli import main
from taxelflow.pipeline.api import convert, read, recording
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.hand import JointsInvalid

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.messages import Floats

    Capture = pytest.CaptureFixture[str]

pytest.importorskip("mujoco")


def _estimated(folder: Path, capsys: Capture, *asked: str, joints: bool = False) -> tuple[int, str, int]:
    """Exit code, stderr and the number of scans in which a pad had a place, of a recording with or without joints."""
    path = carried(folder, "held.npz", stays=True)
    if not joints:
        held = read(path)
        convert(recording(held.load().t_s, held.load().values, held.sensor), path)
    code = main(["estimate", str(path), "--out", str(folder / "out"), *asked])
    table = folder / "out" / "object3d.csv"
    rows = list(csv.DictReader(table.read_text().splitlines())) if table.exists() else []
    return code, capsys.readouterr().err, sum(row["pads"] != "0" for row in rows)


def _csv(folder: Path, text: str) -> str:
    (folder / "joints.csv").write_text(text)
    return str(folder / "joints.csv")


def test_angles_of_some_scans_place_pads_in_those(tmp_path: Path, capsys: Capture) -> None:
    rows = "".join(f"{t_s:.2f},0.0\n" for t_s in np.arange(0.0, 0.9, 0.1))
    code, said, placed = _estimated(tmp_path, capsys, "--joints", _csv(tmp_path, f"t_s,slide\n{rows}"))
    assert (code, placed > 0) == (0, True)
    assert "no place in space in 27 of 70 scans for left, right: angles are from 0.000 to 0.800 s, scans from" in said


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("t_s,slide\n500,0\n501,0\n", "in any of 70 scans: angles are from 500.000 to 501.000 s, scans from 0.000 to"),
        ("t_s,slide\n0,\n1,\n", "no row has a time and all its angles"),
    ],
)
def test_angles_that_fit_no_scan_are_refused(tmp_path: Path, capsys: Capture, text: str, says: str) -> None:
    code, said, placed = _estimated(tmp_path, capsys, "--joints", _csv(tmp_path, text))
    assert (code, placed) == (2, 0)
    assert says in said


def test_a_recording_without_angles_names_the_option_to_give_them(tmp_path: Path, capsys: Capture) -> None:
    code, said, placed = _estimated(tmp_path, capsys)
    assert (code, placed) == (0, 0)
    assert "the pads are on links, and there are no joint angles; give --joints (JOINT=ANGLE pairs, or a csv)" in said


def test_there_is_no_note_where_all_angles_are_known(tmp_path: Path, capsys: Capture) -> None:
    code, said, placed = _estimated(tmp_path, capsys, joints=True)
    assert (code, placed > 0, "space" in said) == (0, True, False)


def test_joints_left_out_are_at_0_where_the_angles_are_constant(tmp_path: Path) -> None:
    sensor = load_sensor("schunk-sdh2")
    joints = asked_joints("sdh_finger_12_joint=-0.5", sensor)
    assert len(joints.names) == 7
    assert joints.angles.tolist() == [[-0.5 if name == "sdh_finger_12_joint" else 0.0 for name in joints.names]]
    assert asked_joints("slide=0.1", linked_hand(tmp_path)).angles.tolist() == [[0.1]]


def test_a_joint_without_any_angle_is_left_out() -> None:
    angles: Floats = np.array([[0.1, np.nan], [np.nan, np.nan], [0.3, np.nan]])
    joints = joints_of(("a", "b"), np.array([0.0, 1.0, 2.0]), angles)
    assert (joints.names, joints.t_s.tolist(), joints.angles.tolist()) == (("a",), [0.0, 2.0], [[0.1], [0.3]])


def test_a_table_without_a_known_angle_is_refused(tmp_path: Path) -> None:
    with pytest.raises(JointsInvalid, match="no row has a time"):
        asked_joints(_csv(tmp_path, "t_s,slide\n,0.1\n"), linked_hand(tmp_path))
