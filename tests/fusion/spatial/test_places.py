"""What `estimate` says, and writes, where joint angles are missing."""

from __future__ import annotations

import csv
from dataclasses import replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest

from linked import carried, linked_hand
from synthetic import assert_same
from taxelflow.acquire.joints import asked_joints, constant_joints, joints_of
from taxelflow.cli import main
from taxelflow.fusion.spatial.places import Places
from taxelflow.messages import cut, joined
from taxelflow.pipeline.api import convert, estimator, read, recording
from taxelflow.pipeline.stages import Pipeline
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.hand import JointsInvalid
from taxelflow.sensors.kinematics import PadKinematics

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


def test_a_gap_between_angles_is_named(tmp_path: Path, capsys: Capture) -> None:
    rows = "".join(f"{t_s:.2f},0.0\n" for t_s in [*np.arange(0.0, 0.9, 0.1), 8.0])
    code, said, placed = _estimated(tmp_path, capsys, "--joints", _csv(tmp_path, f"t_s,slide\n{rows}"))
    assert (code, placed > 0) == (0, True)
    assert "angles are from 0.000 to 8.000 s with gaps of up to 7.2 s (0.5 s at most are interpolated), scans" in said


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("t_s,slide\n500,0\n501,0\n", "in any of 70 scans: angles are from 500.000 to 501.000 s with gaps of"),
        ("t_s,slide\n500,0\n500.5,0\n", "in any of 70 scans: angles are from 500.000 to 500.500 s, scans from 0.000"),
        ("t_s,slide\n0,\n1,\n", "no row has a time and an angle"),
    ],
)
def test_angles_that_fit_no_scan_are_refused(tmp_path: Path, capsys: Capture, text: str, says: str) -> None:
    code, said, placed = _estimated(tmp_path, capsys, "--joints", _csv(tmp_path, text))
    assert (code, placed) == (2, 0)
    assert says in said


def test_a_recording_without_angles_names_the_option_to_give_them(tmp_path: Path, capsys: Capture) -> None:
    code, said, placed = _estimated(tmp_path, capsys)
    assert (code, placed) == (0, 0)
    assert "the pads are on links, and there are no joint angles; give `estimate` --joints (JOINT=ANGLE pairs," in said
    assert "or a csv), or write joints in [hand] of the sensor file" in said  # which `run` has, without the option


def test_there_is_no_note_where_all_angles_are_known(tmp_path: Path, capsys: Capture) -> None:
    code, said, placed = _estimated(tmp_path, capsys, joints=True)
    assert (code, placed > 0, "space" in said) == (0, True, False)


def test_frames_of_pads_that_are_read_late_in_some_scans_are_those_of_each_scan_alone(tmp_path: Path) -> None:
    sensor = linked_hand(tmp_path)
    turned = tuple(
        msgspec.structs.replace(pad, pose=(0.01 * k, 0.02, 0.03, *(0.5 * np.array([0.6, 0.8, -1.0, 2**0.5])).tolist()))
        for k, pad in enumerate(sensor.pads)
    )
    sensor = msgspec.structs.replace(sensor, pads=turned)
    places = Places(sensor, constant_joints({"slide": 0.01}, sensor))
    random = np.random.default_rng(0)
    point, t_s = random.uniform(-0.01, 0.01, (60, 2, 2)), np.repeat(0.01 * np.arange(60.0)[:, np.newaxis], 2, axis=1)
    t_s[30:, 1] += 0.003
    single = [places.frames(t_s[scan : scan + 1], point[scan : scan + 1]) for scan in range(60)]
    assert np.array_equal(places.frames(t_s, point), np.concatenate(single))


def test_errors_of_joint_angles_count_alike_in_all_blocks(tmp_path: Path) -> None:
    held = read(carried(tmp_path, "held.npz", stays=True))
    hand = msgspec.structs.replace(held.sensor.hand, joint_std_rad=1e-5)
    held, raw = replace(held, sensor=msgspec.structs.replace(held.sensor, hand=hand)), held.load()
    found = []
    for blocks in ([cut(raw, scan, scan + 1) for scan in range(len(raw))], [raw]):
        run = Pipeline(estimator("lnorm"), mode="stream").start(held)
        found.append(joined([*map(run.step, blocks), run.finish()]).spatial)
    one, whole = found
    assert one is not None
    assert whole is not None
    assert (one.rank > 0).any()
    assert_same(one, whole)


@pytest.mark.parametrize(
    ("angles", "notes"),
    [
        ({}, []),
        ({"f1": 2.5, "spread": -0.05}, []),  # by less than encoders are off
        (
            {"f1": 69.0, "spread": 60.0},
            [
                "joint spread is at 60 rad, its range is 0 to 3.142 rad: check that its angles are in rad",
                "joint f1 is at 69 rad, its range is 0 to 2.443 rad: check that its angles are in rad",
            ],
        ),
    ],
    ids=["none", "within", "degrees"],
)
def test_angles_beyond_the_range_of_a_joint_are_noted(angles: dict[str, float], notes: list[str]) -> None:
    sensor = load_sensor("barretthand-162")
    assert Places(sensor, constant_joints(angles, sensor)).notes == notes


def test_a_joint_that_moves_is_noted_with_its_unit(tmp_path: Path) -> None:
    sensor = linked_hand(tmp_path)
    moved = joints_of(("slide", "wrist"), np.array([0.0, 1.0, 2.0]), np.array([[0.5, 90.0], [40.0, 0.0], [1.0, 0.0]]))
    says = "joint slide is at 0.5 to 40 m, its range is -1 to 1 m: check that its angles are in m"
    assert Places(sensor, moved).notes == [says]
    assert Places(sensor, joints_of(("wrist",), np.zeros(1), np.full((1, 1), 90.0))).notes == []  # not of the hand


def test_the_note_says_when_all_angles_are_known(tmp_path: Path) -> None:
    sensor = linked_hand(tmp_path)
    names = PadKinematics(sensor).joints
    angles = np.zeros((21, len(names)))
    angles[:10, 0] = np.nan
    places = Places(sensor, joints_of(names, 0.1 * np.arange(21), angles))
    places.count(0.1 * np.arange(21))
    assert "angles are from 1.000 to 2.000 s, scans from 0.000 to 2.000 s" in places.notes[0]


def test_the_note_names_the_joints_that_are_given() -> None:
    """A misspelt one is found by that."""
    sensor = load_sensor("schunk-sdh2")
    names = PadKinematics(sensor).joints
    t_s = 0.1 * np.arange(21)
    places = Places(sensor, joints_of((*names[:-1], "typo"), t_s, np.zeros((21, len(names)))))
    places.count(t_s)
    assert places.notes[0].endswith(f": no angles of {names[-1]}; those given are of {', '.join(names[:-1])}, typo")


def test_estimate_notes_degrees_that_were_given_as_radians(tmp_path: Path, capsys: Capture) -> None:
    code, said, _ = _estimated(tmp_path, capsys, "--joints", "slide=45")
    assert code == 0
    assert "taxelflow: joint slide is at 45 m, its range is -1 to 1 m: check that its angles are in m\n" in said


def test_joints_left_out_are_at_0_where_the_angles_are_constant(tmp_path: Path) -> None:
    sensor = load_sensor("schunk-sdh2")
    joints = asked_joints("sdh_finger_12_joint=-0.5", sensor)
    assert len(joints.names) == 7
    assert joints.angles.tolist() == [[-0.5 if name == "sdh_finger_12_joint" else 0.0 for name in joints.names]]
    assert asked_joints("slide=0.1", linked_hand(tmp_path)).angles.tolist() == [[0.1]]


def test_angles_that_fit_no_scan_are_refused_beside_a_pad_on_the_palm(tmp_path: Path) -> None:
    linked_hand(tmp_path)
    (path := tmp_path / "hand.toml").write_text(path.read_text().replace('link = "finger"', 'link = "base"', 1))
    sensor = load_sensor(str(path))
    fitting, late = (
        Places(sensor, asked_joints(_csv(tmp_path, text), sensor))
        for text in ("t_s,slide\n0,0\n0.4,0\n", "t_s,slide\n500,0\n500.4,0\n")
    )
    for places in (fitting, late):
        places.count(0.1 * np.arange(5))
    fitting.check()
    with pytest.raises(JointsInvalid, match=r"no moving pad has a place in any of 5 scans: angles are from 500\.000"):
        late.check()


def test_a_joint_without_any_angle_is_left_out() -> None:
    angles: Floats = np.array([[0.1, np.nan], [np.nan, np.nan], [0.3, np.nan]])
    joints = joints_of(("a", "b"), np.array([0.0, 1.0, 2.0]), angles)
    assert (joints.names, joints.t_s.tolist(), joints.angles.tolist()) == (("a",), [0.0, 2.0], [[0.1], [0.3]])


def test_a_table_without_a_known_angle_is_refused(tmp_path: Path) -> None:
    with pytest.raises(JointsInvalid, match="no row has a time"):
        asked_joints(_csv(tmp_path, "t_s,slide\n,0.1\n"), linked_hand(tmp_path))
