from __future__ import annotations

import numpy as np
import pytest

from costly import mostly_long
from taxelflow.acquire.joints import constant_joints
from taxelflow.publish.view.articulation import Fingers, fingers_of
from taxelflow.publish.view.hand_links import solid_of
from taxelflow.sensors.catalogue import load_sensor

JOINT_M = 0.008
JOINTS = {"barretthand-162": "f1", "schunk-sdh2": "sdh_finger_12_joint"}


def fingers(name: str) -> Fingers:
    sensor = load_sensor(name)
    found, _ = fingers_of(sensor, constant_joints({JOINTS[name]: 0.4}, sensor))
    assert found is not None
    return found


@pytest.mark.parametrize("name", mostly_long(["barretthand-162", "schunk-sdh2"], "schunk-sdh2"))
def test_each_link_has_a_solid_that_lies_behind_its_own_taxels(name: str) -> None:
    links = fingers(name).links
    assert sum(len(skin.place) for _, skin in links.values()) == load_sensor(name).layout.taxels
    for ends, skin in links.values():
        solid = solid_of(ends, skin, JOINT_M)
        assert solid is not None
        for place, normal in zip(skin.place, skin.normal, strict=True):
            assert ((solid.vertices - place) @ normal).max() < 0


def test_links_meet_at_their_joints() -> None:
    hand = fingers("barretthand-162")
    T = hand.link_poses()
    ends = {link: ends @ T[link][:3, :3].T + T[link][:3, 3] for link, (ends, _) in hand.links.items()}
    above = np.concatenate([places[1:, 0] for places in ends.values()])
    for link in [*ends][1:]:
        assert np.linalg.norm(above - ends[link][0, 0], axis=1).min() < 1e-9


def test_links_move_with_the_joints_that_carry_them() -> None:
    sensor = load_sensor("barretthand-162")
    poses = []
    for angle in (0.2, 1.0):
        found, _ = fingers_of(sensor, constant_joints({"f1": angle}, sensor))
        assert found is not None
        found.at(0.0)
        poses.append(found.link_poses())
    before, after = poses
    moved = [link for link in before if np.abs(after[link] - before[link]).max() > 1e-6]
    assert len(moved) == 2  # the inner and the outer link of one finger


def test_a_link_without_extent_has_no_solid() -> None:
    hand = fingers("barretthand-162")
    _, skin = hand.links[0]
    nothing = type(skin)(*(part[:0] for part in skin))
    assert solid_of(np.zeros((1, 2, 3)), nothing, JOINT_M) is None
