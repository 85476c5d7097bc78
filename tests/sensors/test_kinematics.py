from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from taxelflow.errors import ExtraMissing, SensorFileInvalid
from taxelflow.numerics.geometry import se3_exp, se3_log
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.hand import Hand, HandModelInvalid, JointsInvalid, check_hand, joint_angles
from taxelflow.sensors.kinematics import Kinematics, PadKinematics, angles_of

ARM = """<robot name="arm"><link name="base"/><link name="upper"/><link name="lower"/><link name="pad"/>
<joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="b" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.1 0 0"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/><mimic joint="a" multiplier="0.5"/></joint>
<joint name="fix" type="fixed"><parent link="lower"/><child link="pad"/><origin xyz="0.05 0 0.01"/></joint></robot>"""
MJCF = """<mujoco><compiler angle="degree"/><worldbody><body name="base"><geom type="mesh" mesh="none"/>
<body name="upper" pos="0 0 0"><joint name="a" axis="0 0 1"/>
<body name="lower" pos="0.1 0 0"><joint name="b" axis="0 0 1"/>
<body name="pad" pos="0.05 0 0.01"/></body></body></body></worldbody>
<equality><joint joint1="b" joint2="a" polycoef="0 0.5 0 0 0"/></equality></mujoco>"""


@pytest.mark.parametrize("text", [ARM, MJCF])
def test_links_follow_the_joints_and_coupled_ones_their_drivers(text: str) -> None:
    hand = Kinematics(text, "base", "test")
    assert hand.joints == ("a",)
    assert hand.drivers == {"b": "a"}
    (T,) = hand.poses(np.array([[0.6]]), [hand.link("pad")])
    place = 0.1 * np.array([np.cos(0.6), np.sin(0.6)]) + 0.05 * np.array([np.cos(0.9), np.sin(0.9)])
    np.testing.assert_allclose(T[0, :3, 3], [*place, 0.01], atol=1e-12)
    assert np.isnan(hand.poses(np.array([[np.nan]]), [hand.link("pad")])).all()


def test_xacro_that_is_not_expanded_is_refused() -> None:
    """Its macros would be left out without a word, and with them links and joints."""
    macro = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="arm"><xacro:finger name="c"/>'
    with pytest.raises(HandModelInvalid, match="it holds xacro that is not expanded; give what `xacro FILE` prints"):
        Kinematics(ARM.replace('<robot name="arm">', macro), "base", "test")
    expanded = macro.replace('<xacro:finger name="c"/>', "")
    assert Kinematics(ARM.replace('<robot name="arm">', expanded), "base", "test").joints == ("a",)


def test_ranges_of_joints_are_those_of_the_model() -> None:
    assert Kinematics(ARM, "base", "test").ranges.tolist() == [[-3.0, 3.0]]  # without the coupled joint
    assert Kinematics(MJCF, "base", "test").ranges.tolist() == [[-np.inf, np.inf]]
    limited = MJCF.replace('name="a" axis', 'name="a" range="-90 45" axis')
    np.testing.assert_allclose(Kinematics(limited, "base", "test").ranges, np.radians([[-90.0, 45.0]]))
    barrett = PadKinematics(load_sensor("barretthand-162")).model
    assert barrett is not None
    assert dict(zip(barrett.joints, barrett.ranges.tolist(), strict=True))["spread"] == [0.0, 3.1416]


def test_links_that_no_unknown_joint_moves_are_placed() -> None:
    text = ARM.replace(' multiplier="0.5"/>', ' multiplier="0.5"/>', 1)
    branch = '<link name="other"/><joint name="c" type="revolute"><parent link="upper"/><child link="other"/>'
    branch += '<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>'
    hand = Kinematics(text.replace("</robot>", branch), "base", "test")
    links = [hand.link(name) for name in ("upper", "pad", "other")]
    angles = np.array([[0.6, 0.2], [0.6, np.nan], [np.nan, 0.2]])
    a, c = hand.joints.index("a"), hand.joints.index("c")
    T = hand.poses(angles[:, [a, c]] if a < c else angles[:, [1, 0]], links)
    assert np.isfinite(T[..., 0, 0]).tolist() == [[True] * 3, [True, True, False], [False] * 3]
    np.testing.assert_array_equal(T[0, :2], T[1, :2])
    upper = Kinematics(text.replace("</robot>", branch), "upper", "test")
    assert np.isfinite(upper.poses(angles[2:], [upper.link("other")])).all()  # a moves both


def test_poses_are_relative_to_the_base() -> None:
    hand = Kinematics(ARM, "upper", "test")
    (T,) = hand.poses(np.array([[0.6]]), [hand.link("lower")])
    np.testing.assert_allclose(T[0, :3, 3], [0.1, 0, 0], atol=1e-12)


def test_the_jacobian_is_the_twist_of_a_link() -> None:
    sensor = load_sensor("barretthand-162")
    pads = PadKinematics(sensor)
    q = angles_of(pads.joints, joint_angles("spread=60deg f1=1.2 f2=1.1 f3=1.0"), "test")
    rate = np.array([0.3, -0.2, 0.1, 0.4])
    ahead, back = pads.poses((q + 1e-5 * rate)[np.newaxis]), pads.poses((q - 1e-5 * rate)[np.newaxis])
    twist = se3_log((ahead @ np.linalg.inv(back))[0]) / 2e-5
    np.testing.assert_allclose(pads.jacobians(q[np.newaxis])[0] @ rate, twist, atol=1e-6)


@pytest.mark.parametrize("base", ["base", "upper", "lower"])
def test_the_jacobian_follows_a_coupling_that_is_no_line_and_any_base(base: str) -> None:
    hand = Kinematics(MJCF.replace("0 0.5 0 0 0", "0.1 0.5 -0.3 0.2 0.1"), base, "test")
    links, angle, step = [hand.link(name) for name in ("upper", "pad")], 0.7, 1e-6
    ahead, back = hand.poses(np.array([[angle + step], [angle - step]]), links)
    twist = se3_log(ahead @ np.linalg.inv(back)) / (2 * step)
    np.testing.assert_allclose(hand.jacobians(np.array([[angle]]), links)[0, ..., 0], twist, atol=1e-8)
    assert np.isnan(hand.jacobians(np.array([[np.nan]]), [hand.link("base")])).all() == (base != "base")


def test_the_barrett_hand_is_symmetric_and_closes_around_the_palms_axis() -> None:
    sensor = load_sensor("barretthand-162")
    pads = PadKinematics(sensor)
    named = "" if sensor.hand is None else sensor.hand.pose("spread") or ""
    T = dict(
        zip(
            (pad.name for pad in sensor.pads),
            pads.poses(angles_of(pads.joints, joint_angles(named), "")[np.newaxis])[0],
            strict=True,
        )
    )
    left, right = T["finger1_tip"][:3, 3], T["finger2_tip"][:3, 3]
    np.testing.assert_allclose(left * [-1, 1, 1], right, atol=1e-9)
    assert left[0] < 0
    for name in ("finger1_tip", "finger2_tip", "finger3_tip", "finger1_mid"):
        place, normal = T[name][:3, 3], T[name][:3, 2]
        assert normal[:2] @ place[:2] < -0.8 * np.hypot(*place[:2])  # it faces the axis


def test_the_knuckle_of_the_sdh_turns_both_fingers() -> None:
    pads = PadKinematics(load_sensor("schunk-sdh2"))
    assert len(pads.joints) == 7
    T = pads.poses(angles_of(pads.joints, {"sdh_knuckle_joint": np.pi / 2}, "")[np.newaxis])[0]
    names = [pad.name for pad in load_sensor("schunk-sdh2").pads]
    one, two = T[names.index("finger1_distal")], T[names.index("finger2_distal")]
    np.testing.assert_allclose(one[:3, 3] * [1, -1, 1], two[:3, 3], atol=1e-5)
    np.testing.assert_allclose(one[1, 2] * two[1, 2], -1, atol=1e-5)  # face to face


def test_errors_name_what_is_wrong() -> None:
    with pytest.raises(HandModelInvalid, match="it has no link 'tip'; choose one of base, upper, lower, pad"):
        Kinematics(ARM, "tip", "test")
    with pytest.raises(HandModelInvalid, match="it is no XML"):
        Kinematics("<robot", "", "test")
    with pytest.raises(HandModelInvalid, match="its root is <hand>"):
        Kinematics("<hand/>", "", "test")
    with pytest.raises(HandModelInvalid, match="includes other files"):
        Kinematics('<mujoco><include file="x.xml"/></mujoco>', "", "test")
    with pytest.raises(HandModelInvalid, match="no joint 'c'; its joints are a"):
        angles_of(("a",), {"c": 1.0}, "test")
    with pytest.raises(JointsInvalid, match="joint 'f1' has two angles; give each joint one"):
        joint_angles("f1=1 f2=2 f1=3")
    with pytest.raises(JointsInvalid, match="joint 'f 1' has two angles"):
        joint_angles("f 1=1, f 1=3")


@pytest.mark.parametrize(
    ("given", "part"),
    [
        ("f1:1", "f1:1"),
        ("", ""),
        ("a=1 index joint 1=x b=2", "index joint 1=x"),
        ("a=1, b", "b"),
        ("a=1degrees", "a=1degrees"),
        ("a = 1", "a ="),
        ("=1", "=1"),
    ],
)
def test_what_is_no_angle_of_a_joint_is_named(given: str, part: str) -> None:
    with pytest.raises(JointsInvalid, match=f"{part!r} is not JOINT=ANGLE; give JOINT=ANGLE pairs .*unit\\)$"):
        joint_angles(given)


def test_names_of_joints_may_hold_blanks() -> None:
    assert joint_angles(" index joint 1=0.2 thumb=1.5rad,ring joint\t2=-.5e0 ") == {
        "index joint 1": 0.2,
        "thumb": 1.5,
        "ring joint\t2": -0.5,
    }
    check_hand(Hand("m", joints="index joint 1=0.2", poses=("half open: index joint 1=0.2 thumb=1",)), {}, "test")


def test_without_mujoco_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ExtraMissing, match=r"mujoco is not installed; .*taxelflow\[sim\]"):
        Kinematics(ARM, "", "test")


def test_a_sensor_file_names_its_model_and_links(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    pad = 'rows = 4\ncols = 4\npitch_m = [0.005, 0.005]\nlink = "pad"\npose = [0, 0, 0.002, 0, 0, 0, 1]\n'
    text = (
        'name = "arm"\nunit = "Pa"\n[hand]\nurdf = "{}"\nbase = "base"\njoints = "a=0.2"\n[[pads]]\nname = "p"\n' + pad
    )
    (tmp_path / "arm.toml").write_text(text.format("arm.urdf"))
    sensor = load_sensor(str(tmp_path / "arm.toml"))
    T = PadKinematics(sensor).poses(np.array([[0.0]]))[0, 0]
    np.testing.assert_allclose(T, se3_exp(np.array([0.15, 0, 0.012, 0, 0, 0])), atol=1e-12)
    (tmp_path / "arm.toml").write_text(text.format("none.urdf"))
    with pytest.raises(SensorFileInvalid, match=r"\[hand\], field urdf: the model 'none.urdf' cannot be read"):
        load_sensor(str(tmp_path / "arm.toml"))
    (tmp_path / "arm.toml").write_text('name = "arm"\nunit = "Pa"\n[[pads]]\nname = "p"\n' + pad)
    with pytest.raises(SensorFileInvalid, match="link 'pad' of pad 'p' without a hand"):
        load_sensor(str(tmp_path / "arm.toml"))
