from __future__ import annotations

import numpy as np
import pytest

from taxelflow.acquire.joints import constant_joints
from taxelflow.messages import Joints
from taxelflow.publish.plots.space import in_space
from taxelflow.publish.view.articulation import fingers_of
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.kinematics import PadKinematics

HAND = load_sensor("barretthand-162")
NAMES = PadKinematics(HAND).joints
FINGER1 = HAND.layout.pads.index("finger1_tip")


def closing() -> Joints:
    """Finger 1 closes from 0 to 1 rad in a second."""
    angles = np.zeros((11, len(NAMES)))
    angles[:, NAMES.index("f1")] = np.linspace(0.0, 1.0, 11)
    return Joints(NAMES, np.linspace(0.0, 1.0, 11), angles)


def test_pads_stand_where_the_model_of_the_hand_puts_them() -> None:
    fingers, note = fingers_of(HAND, constant_joints({"f1": 0.7}, HAND))
    assert fingers is not None
    assert note == ""
    assert not fingers.moving
    expected = in_space(HAND, "f1=0.7")
    assert fingers.at(3.0).place == pytest.approx(expected.places, abs=1e-9)
    assert fingers.at(3.0).normal == pytest.approx(expected.normals, abs=1e-9)


def test_a_finger_moves_with_its_joint_and_no_other_does() -> None:
    fingers, _ = fingers_of(HAND, closing())
    assert fingers is not None
    assert fingers.moving
    before, after = fingers.at(0.0), fingers.at(1.0)
    moved = np.linalg.norm(after.place - before.place, axis=1)
    own = HAND.layout.of_pad(FINGER1)
    assert moved[own].min() > 0.01
    assert moved[HAND.layout.of_pad(HAND.layout.pads.index("palm"))].max() < 1e-12
    assert (fingers.box[0] <= np.minimum(before.place, after.place).min(axis=0)).all()


def test_the_hand_stays_as_it_was_while_its_angles_are_unknown() -> None:
    fingers, _ = fingers_of(HAND, closing())
    assert fingers is not None
    last = fingers.at(1.0).place
    assert np.array_equal(fingers.at(9.0).place, last)


def test_angles_known_at_some_times_only_place_the_hand_by_those() -> None:
    joints = closing()
    joints.angles[:5, NAMES.index("f2")] = np.nan
    fingers, _ = fingers_of(HAND, joints)
    assert fingers is not None
    assert np.isfinite(fingers.box).all()
    joints.angles[5:, NAMES.index("f1")] = np.nan
    assert fingers_of(HAND, joints) == (
        None,
        "the fingers do not move: no time at which the angles of all joints are known",
    )


def test_missing_joints_are_named_and_the_hand_is_laid_flat() -> None:
    fingers, note = fingers_of(HAND, Joints(("f1",), np.zeros(1), np.full((1, 1), 0.5)))
    assert fingers is None
    assert "spread" in note
    assert fingers_of(HAND, None) == (None, "")
