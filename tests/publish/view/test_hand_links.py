from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from costly import mostly_long
from taxelflow.acquire.joints import constant_joints
from taxelflow.publish.view.articulation import Fingers, fingers_of
from taxelflow.publish.view.hand_links import HandLinks, Skin, solid_of
from taxelflow.sensors.catalogue import load_sensor

if TYPE_CHECKING:
    from taxelflow.messages import Floats

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


PITCH_M = 0.004
BARE = Skin(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3, 2)))
NO_AXIS, ALONG_X = np.zeros(3), np.array([1.0, 0.0, 0.0])


def flat(height_m: float) -> Skin:
    """Four by four taxels that face up."""
    place = np.mgrid[-1.5:2.5, -1.5:2.5].reshape(2, -1).T * PITCH_M
    places = np.column_stack([place, np.full(16, height_m)])
    across = PITCH_M * np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
    return Skin(places, np.tile([0.0, 0.0, 1.0], (16, 1)), np.tile(across, (16, 1, 1)))


def solid(*ends: tuple[Any, Any], skin: Skin = BARE) -> Floats:
    """(n, 3), corners of a link with joints at these places with these axes."""
    found = solid_of(np.array(ends), skin, JOINT_M)
    assert found is not None
    return np.asarray(found.vertices)


def widest(corners: Floats, directions: int = 72) -> tuple[float, float]:
    """Least and largest reach from the x axis over all directions across it."""
    angle = 2 * np.pi * np.arange(directions) / directions
    reach = (corners[:, 1:] @ np.stack([np.cos(angle), np.sin(angle)])).max(axis=0)
    return float(reach.min()), float(reach.max())


def test_a_pad_is_backed_a_third_of_a_pitch_behind_and_a_little_beyond_its_outer_taxels() -> None:
    corners = solid((np.zeros(3), NO_AXIS), skin=flat(0.03))
    top = corners[corners[:, 2] > 0.029 - 0.5 * PITCH_M]
    assert 0.25 < (0.03 - corners[:, 2].max()) / PITCH_M < 0.35
    assert top[:, :2].max(axis=0) / PITCH_M == pytest.approx(1.5 + 0.62, abs=0.1)
    assert top[:, :2].min(axis=0) / PITCH_M == pytest.approx(-1.5 - 0.62, abs=0.1)


def test_a_hinge_without_skin_is_a_cylinder_about_its_axis() -> None:
    corners = solid(([0.05, 0.0, 0.01], ALONG_X)) - [0.05, 0.0, 0.01]
    assert np.abs(corners[:, 0]) == pytest.approx(JOINT_M)
    assert widest(corners) == pytest.approx((JOINT_M, JOINT_M), rel=0.03)


def test_a_fixed_joint_is_a_ball_and_a_link_reaches_from_one_joint_to_the_next() -> None:
    corners = solid(([0.01, 0.0, 0.0], ALONG_X), ([0.09, 0.0, 0.0], NO_AXIS))
    assert corners[:, 0].max() == pytest.approx(0.09 + JOINT_M)
    assert corners[:, 0].min() == pytest.approx(0.01 - JOINT_M)


def test_a_joint_under_a_pad_is_thinner_and_one_that_has_none_near_is_not() -> None:
    widths = [
        -solid(([0.0, 0.0, height_m - below], ALONG_X), skin=flat(height_m))[:, 2].min() + height_m - below
        for height_m, below in ((0.03, 0.5 * JOINT_M), (0.03, 2.0 * JOINT_M))
    ]
    assert widths == pytest.approx([0.45 * JOINT_M, JOINT_M], rel=0.05)


def test_no_joint_comes_through_its_pad() -> None:
    corners = solid(([0.0, 0.0, 0.03 - 0.1 * JOINT_M], ALONG_X), skin=flat(0.03))
    assert corners[:, 2].max() == pytest.approx(0.03 - 0.3 * PITCH_M, abs=1e-9)


def test_a_palm_is_mounted_on_a_disc_across_the_way_to_its_fingers() -> None:
    fingers_m = [([0.1, y, z], ALONG_X) for y, z in ((0.04, 0.0), (-0.04, 0.0), (0.0, 0.04), (0.0, -0.04))]
    corners = solid((np.zeros(3), NO_AXIS), *fingers_m)
    foot = corners[corners[:, 0] < 1e-6]
    assert foot[:, 0] == pytest.approx(0.0, abs=1e-9)
    assert widest(foot) == pytest.approx((0.6 * 0.04, 0.6 * 0.04), rel=0.03)


def test_corners_and_solids_are_where_the_links_are() -> None:
    added: dict[str, SimpleNamespace] = {}

    def add(name: str, vertices: Floats, _faces: Any, **more: Any) -> SimpleNamespace:
        added[name] = SimpleNamespace(vertices=vertices, **more)
        return added[name]

    server = SimpleNamespace(scene=SimpleNamespace(add_batched_meshes_simple=add))
    ends = np.array([[[0.05, 0.0, 0.0], ALONG_X]])
    links = HandLinks(server, {3: (ends, BARE), 4: (np.zeros((1, 2, 3)), BARE)}, 0.25)
    T = np.eye(4)
    T[:3] = [[0.0, -1.0, 0.0, 0.2], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.1]]  # x to y
    links.move({3: T, 4: np.eye(4)})
    corners = links.corners()
    assert list(added) == ["/hand/3"]  # nothing is drawn of a link without extent
    assert corners.mean(axis=0) == pytest.approx([0.2, 0.05, 0.1])
    assert np.abs(corners - corners.mean(axis=0)).max(axis=0) == pytest.approx(0.25 * 0.032, rel=0.03)
    assert added["/hand/3"].batched_positions.tolist() == [[0.2, 0.0, 0.1]]
    assert added["/hand/3"].batched_wxyzs[0] == pytest.approx([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
