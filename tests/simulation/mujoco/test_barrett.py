from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from taxelflow.control.baselines import Constant
from taxelflow.control.hold import Hold
from taxelflow.errors import ExtraMissing, GraphicsMissing, ParameterInvalid
from taxelflow.evaluation.control import Course
from taxelflow.evaluation.control_film import film_course
from taxelflow.numerics.geometry import se3_inverse
from taxelflow.numerics.gravity import G_M_S2
from taxelflow.sensors.kinematics import PadKinematics
from taxelflow.simulation.mujoco.barrett import BarrettHand
from taxelflow.simulation.mujoco.events import Happening
from taxelflow.simulation.mujoco.hands import check_objects
from taxelflow.simulation.mujoco.objects import shape
from taxelflow.simulation.mujoco.plant import Actuator, Held
from taxelflow.simulation.mujoco.plants import TRIAL
from taxelflow.simulation.mujoco.trial import Rehearsal, Trial

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.messages import Floats
    from taxelflow.simulation.mujoco.plant import Truth

pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'taxelflow[sim]'")
MASS_KG, FRICTION = 0.3, 0.6
LEAST_N = MASS_KG * G_M_S2 / (2 * FRICTION)
NO_EVENT = Happening("none", MASS_KG, 1.0, 1.0, 0.0, 1.0, 0.0)
MIDDLES = ("finger1_mid", "finger2_mid", "finger3_mid")


def lifted(kind: str, force_n: float, until_s: float) -> tuple[BarrettHand, list[Truth], Floats]:
    """A lift with a constant force: the plant, the truth of each scan, and the last readings."""
    hand, truths = BarrettHand(Held(shape(kind, np.random.default_rng(3)), MASS_KG, FRICTION)), []
    readings = np.zeros(0)
    while hand.t_s < until_s - 1e-9:
        force = -5.0 if hand.t_s < 0.15 else max(force_n, 3.0) if hand.t_s < 0.5 else force_n
        readings, truth = hand.scan(force, NO_EVENT.load(hand.t_s))
        truths.append(truth)
    return hand, truths, readings


@cache
def gripped() -> tuple[BarrettHand, list[Truth], Floats]:
    """A jar at twice the least force, before the lift."""
    return lifted("jar", 2 * LEAST_N, TRIAL.lift_s)


def parts(hand: BarrettHand, readings: Floats) -> dict[str, Floats]:
    layout = hand.sensor.layout
    return {layout.pads[pad]: readings[layout.of_pad(pad)] for pad in range(len(hand.sensor.pads))}


def test_the_grip_has_the_commanded_force_and_taxels_sum_to_the_normal_force() -> None:
    hand, truths, _ = gripped()
    truth = truths[-1]
    assert truth.force_n == pytest.approx(2 * LEAST_N, rel=0.02)
    assert hand.grasps(truth, 2 * LEAST_N)
    assert not hand.grasps(truths[0], 2 * LEAST_N)
    pressed = np.flatnonzero(truth.normal_n)
    assert [hand.sensor.pads[pad].name for pad in pressed] == list(MIDDLES)
    for pad in pressed:
        pressure = hand.pressure(int(pad), truth.normal_n[pad])
        area_m2 = np.prod(hand.sensor.pads[pad].pitch_m)
        assert pressure.sum() * area_m2 == pytest.approx(truth.normal_n[pad], rel=0.02)
        assert (pressure > 0).sum() >= 4


def test_scans_have_the_order_of_the_sensor_and_show_where_the_object_is() -> None:
    hand, truths, readings = gripped()
    layout = hand.sensor.layout
    assert readings.shape == (layout.taxels,) == (162,)
    ribs = [geom for geom in range(hand.model.ngeom) if hand.model.geom_type[geom] == 4]  # ellipsoids
    heights = [hand.model.geom_pos[geom] for geom in ribs]
    assert len(heights) == 11
    for name in MIDDLES:
        pad = layout.pads.index(name)
        own = layout.of_pad(pad)
        x_m, y_m, image = layout.x_m[own], layout.y_m[own], readings[own]
        T = truths[-1].T_pad_object[pad]
        assert abs(T[1, 3]) > 0.002  # the jar's axis lies beside the pad's middle, along its y
        assert image @ y_m / image.sum() == pytest.approx(T[1, 3], abs=0.001)
        assert T[2, 3] == pytest.approx(0.039, abs=0.0015)  # and a radius before its face
        at_m = [(T[:3, :3] @ height + T[:3, 3])[0] for height in heights]
        near, mirrored = (np.exp(-0.5 * ((sign * x_m[:, None] - at_m) / 0.003) ** 2).sum(axis=1) for sign in (1, -1))
        assert image @ near > image @ mirrored


def test_unloaded_pads_read_noise_only() -> None:
    hand, _, readings = gripped()
    for name, image in parts(hand, readings).items():
        assert (image.max() > 5.0) == (name in MIDDLES)  # kPa


def test_pads_are_where_the_sensors_kinematics_puts_them() -> None:
    hand, truths, _ = gripped()
    T_hand_pad = PadKinematics(hand.sensor).poses(hand.joints[np.newaxis])[0]
    T_hand_object = T_hand_pad @ truths[-1].T_pad_object
    np.testing.assert_allclose(T_hand_object, np.tile(T_hand_object[0], (7, 1, 1)), atol=3e-4)


def test_the_truth_of_each_pad_is_a_pose_and_its_velocity() -> None:
    _, truths, _ = lifted("jar", 0.9 * LEAST_N, 1.1)
    before, after = truths[-2], truths[-1]
    assert after.speed_m_s > 0.05
    moved = after.T_pad_object[:, :3, 3] - before.T_pad_object[:, :3, 3]
    np.testing.assert_allclose(100 * moved, (after.twist + before.twist)[:, :3] / 2, atol=0.02 * after.speed_m_s)
    turn = (se3_inverse(before.T_pad_object) @ after.T_pad_object)[:, :3, :3]
    assert np.abs(turn - np.eye(3)).max() < 0.02


@pytest.mark.long
@pytest.mark.parametrize("kind", ["can", "case"])
def test_friction_holds_just_above_the_least_force_and_slides_just_below(kind: str) -> None:
    (_, holding, _), (_, sliding, _) = (lifted(kind, share * LEAST_N, 1.4) for share in (1.02, 0.98))
    assert abs(holding[-1].slid_m[1] - holding[80].slid_m[1]) < 2e-5
    assert sliding[-1].slid_m[1] - sliding[80].slid_m[1] < -5e-3


@pytest.mark.long
def test_hold_catches_a_jar_in_the_hand_that_a_constant_force_would_drop() -> None:
    trial = Trial.drawn(60003, "jar", "weak")
    course = Course(trial, Hold(), "convolution", hand="barrett", end_s=1.9)
    seen = list(course)
    assert course.grasped
    assert seen[-1].slid_m < 0.03
    assert seen[-1].moment.truth.speed_m_s < 1e-3
    assert seen[-1].moment.truth.force_n > trial.least_n(1.9) > trial.first_n
    assert seen[-1].touch.velocity.shape == (7, 3)


@pytest.mark.long
def test_hold_stops_a_jar_that_the_slip_stage_once_did_not_notice() -> None:
    """It slid 20 mm at 220 mm/s while no pad said slip: the fingers had hit it as they closed."""
    course = Course(Trial.drawn(60003, "jar", "weak"), Hold(), hand="barrett", end_s=1.6)
    seen = list(course)
    assert any(one.touch.slipping.any() for one in seen)
    assert seen[-1].slid_m < 0.006
    assert seen[-1].moment.truth.speed_m_s < 1e-3


@pytest.mark.long
def test_hold_catches_a_case_whose_slip_is_only_suspected() -> None:
    """It fell out of the hand while the slip stage waited for the pattern to consent."""
    seen = list(Course(Trial.drawn(77003, "case", "weak"), Hold(), hand="barrett"))
    assert seen[-1].slid_m < 0.005
    assert seen[-1].moment.truth.speed_m_s < 1e-3


@pytest.mark.long
def test_a_can_is_held_by_pads_that_know_that_they_cannot_feel_it_slide() -> None:
    course = Course(Trial.drawn(20600, "can", "none"), Hold(), hand="barrett", end_s=1.4)
    seen = list(course)
    assert seen[-1].blind
    assert seen[-1].slid_m < 0.001


@pytest.mark.long
def test_the_hand_is_filmed_with_the_pads_that_hold(tmp_path: Path) -> None:
    course = Course(Trial.drawn(1, "jar", "none"), Constant(), hand="barrett", end_s=0.84)
    try:
        assert film_course(course, tmp_path / "hand.gif") == 2 + 25
    except (ExtraMissing, GraphicsMissing) as error:
        pytest.skip(str(error))
    assert (tmp_path / "hand.gif").stat().st_size > 10_000


def test_an_object_is_not_grasped_without_force() -> None:
    trial = Trial.drawn(1, "jar", "none")
    weak = Rehearsal(trial, actuator=Actuator(max_n=0.1 * trial.first_n), hand="barrett")
    assert list(weak.start())
    assert not weak.grasped


def test_an_object_that_does_not_fit_the_palm_is_refused() -> None:
    with pytest.raises(ParameterInvalid, match="objects must be one of jar, case, can for"):
        Rehearsal(Trial.drawn(1, "ball", "none"), hand="barrett")
    check_objects("gripper", ["ball", "jar"])
