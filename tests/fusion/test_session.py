from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synthetic import assert_same, seen_slips
from taxelflow.errors import ParameterInvalid
from taxelflow.fusion.parameters import RigidField
from taxelflow.messages import AMBIGUOUS, Floats, Motions, Slips, cut, joined
from taxelflow.numerics.geometry import inverse_transform, transform
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.pads import Group, Pad, Patch
from taxelflow.sensors.sensor import Sensor

ORIGINS = ((-0.08, 0.0), (0.08, 0.01), (0.0, -0.07), (0.01, 0.06))
ANGLES = (1.5, -1.5, 3.0, 0.2)


def hand(count: int = 4, *, placed: bool = True, groups: tuple[Group, ...] = (), unseen_error: float = 0.0) -> Sensor:
    pads = tuple(
        Pad(
            name=f"pad{number}",
            rows=4,
            cols=4,
            pitch_m=(0.005, 0.005),
            origin_m=ORIGINS[number] if placed else None,
            angle_rad=ANGLES[number],
        )
        for number in range(count)
    )
    return Sensor(name="hand", unit="Pa", pads=pads, groups=groups, unseen_error=unseen_error)


def slips_of(sensor: Sensor, poses: Floats, points: Floats, *, dt: float = 0.01, std_m: float = 1e-5) -> Slips:
    """What pads see of an object (poses (scans, 3) in the hand) whose point points[p] touches pad p."""
    layout = sensor.layout
    home = np.nan_to_num(layout.T_hand)
    seen = inverse_transform(home, transform(poses[:, np.newaxis], points))
    scans, pads = seen.shape[:2]
    pose = np.full((scans, pads, 3), np.nan)
    pose[..., :2] = seen
    displacement = np.full_like(pose, np.nan)
    displacement[1:, :, :2] = np.diff(seen, axis=0)
    covariance = np.full((scans, pads, 3, 3), np.nan)
    covariance[..., :2, :2] = std_m**2 * np.eye(2)
    return seen_slips(dt * np.arange(scans), pose, displacement, covariance)


def fused(sensor: Sensor, *blocks: Slips) -> Motions:
    session = RigidField().start(sensor.layout)
    return joined([session.step(block, block.pose[..., :2]) for block in blocks])


def spin(scans: int, twist: tuple[float, float, float], dt: float = 0.01) -> Floats:
    return dt * np.arange(scans)[:, np.newaxis] * np.array(twist)


def points_of(sensor: Sensor) -> Floats:
    return np.nan_to_num(sensor.layout.T_hand)[:, :2] + np.array([[0.001, 0.002]])


moderate = st.floats(-0.05, 0.05)


@given(vx=moderate, vy=moderate, omega=st.floats(-2, 2))
def test_a_rigid_twist_comes_out_of_its_slip_vectors(vx: float, vy: float, omega: float) -> None:
    sensor = hand()
    points = points_of(sensor)
    slips = slips_of(sensor, np.zeros((2, 3)), points)
    v = np.array([vx, vy]) + omega * np.stack([-points[:, 1], points[:, 0]], axis=1)
    half = 0.005 * omega  # the middles of the ways have the velocities of the twist, the points are their ends
    v = v @ np.linalg.inv(np.array([[1.0, -half], [half, 1.0]])).T
    home = sensor.layout.T_hand.copy()
    home[:, :2] = 0
    slips.displacement[1, :, :2] = inverse_transform(home, 0.01 * v)
    motions = fused(sensor, slips)
    np.testing.assert_allclose(motions.velocity[1], [vx, vy, omega], atol=1e-9)
    assert motions.rotor[1] == pytest.approx(2 * omega, abs=1e-8)
    if abs(omega) > 0.2:
        np.testing.assert_allclose(motions.centre[1], [-vy / omega, vx / omega], atol=1e-8)


def test_a_pad_that_knows_one_direction_bends_no_rotor() -> None:
    sensor = hand()
    slips = slips_of(sensor, np.zeros((2, 3)), points_of(sensor))
    home = sensor.layout.T_hand.copy()
    home[:, :2] = 0
    slips.displacement[1, :, :2] = inverse_transform(home, np.full((4, 2), 5e-4))
    slips.displacement[1, 3, 0] = 0.0
    slips.displacement_covariance[1, 3, 0, 0] = 0.05**2
    motions = fused(sensor, slips)
    np.testing.assert_allclose(motions.velocity[1], [0.05, 0.05, 0.0], atol=1e-4)
    assert motions.rotor[1] == pytest.approx(0.0, abs=1e-3)


@given(x=moderate, y=moderate, theta=st.floats(-3, 3))
def test_the_pose_is_how_far_the_point_at_the_origin_has_moved_and_turned(x: float, y: float, theta: float) -> None:
    sensor = hand()
    poses = np.linspace(0, 1, 30)[:, np.newaxis] * np.array([x, y, theta])
    motions = fused(sensor, slips_of(sensor, poses, points_of(sensor)))
    np.testing.assert_allclose(motions.pose[:, :2], poses[:, :2], atol=1e-7)
    np.testing.assert_allclose(motions.pose[1:, 2], poses[1:, 2], atol=1e-6)
    np.testing.assert_array_equal(motions.pose[0], 0)


@given(cuts=st.lists(st.integers(0, 40), max_size=4))
def test_no_result_depends_on_how_the_stream_is_cut(cuts: list[int]) -> None:
    sensor = hand()
    slips = slips_of(sensor, spin(40, (0.01, 0.02, 0.5)), points_of(sensor))
    slips.contact[10:15] = False
    slips.pose[10:15] = np.nan
    whole = fused(sensor, slips)
    edges = [0, *sorted(cuts), 40]
    assert_same(fused(sensor, *(cut(slips, a, b) for a, b in itertools.pairwise(edges))), whole)


def test_a_contact_that_comes_later_joins_where_the_object_is_by_then() -> None:
    sensor = hand()
    poses = spin(60, (0.01, -0.02, 1.0))
    slips = slips_of(sensor, poses, points_of(sensor))
    for pad, (first, last) in enumerate([(0, 40), (0, 30), (20, 60), (25, 60)]):
        away = (np.arange(60) < first) | (np.arange(60) >= last)
        slips.contact[away, pad] = False
        slips.pose[away, pad] = np.nan
    motions = fused(sensor, slips)
    np.testing.assert_allclose(motions.pose[1:], poses[1:], atol=1e-6)


def test_all_contacts_lost_means_a_new_beginning() -> None:
    sensor = hand()
    slips = slips_of(sensor, spin(30, (0.01, 0, 0.3)), points_of(sensor))
    slips.contact[10:12] = False
    slips.pose[10:12] = np.nan
    motions = fused(sensor, slips)
    assert np.isnan(motions.pose[10:12]).all()
    np.testing.assert_array_equal(motions.pose[12], 0)
    assert motions.pose[20, 0] == pytest.approx(8 * 0.01 * 0.01, rel=0.2)


def test_one_pad_gives_translation_and_no_turn() -> None:
    sensor = hand(1)
    motions = fused(sensor, slips_of(sensor, spin(10, (0.01, 0.02, 0)), points_of(sensor)))
    np.testing.assert_allclose(motions.velocity[1:, :2], [[0.01, 0.02]] * 9, rtol=1e-9)
    assert np.isnan(motions.velocity[:, 2]).all()
    assert np.isnan(motions.rotor).all()
    assert np.isnan(motions.centre).all()
    np.testing.assert_allclose(motions.pose[-1, :2], 9 * 0.01 * np.array([0.01, 0.02]), rtol=1e-9)


def test_a_pad_that_measures_its_own_turn_gives_the_turn_of_the_object() -> None:
    sensor = hand(1)
    slips = slips_of(sensor, spin(10, (0, 0, 0.5)), points_of(sensor))
    slips.pose[..., 2] = 0.005 * np.arange(10)[:, np.newaxis]
    slips.displacement[1:, :, 2] = 0.005
    slips.covariance[..., 2, 2] = slips.displacement_covariance[..., 2, 2] = 1e-8
    motions = fused(sensor, slips)
    np.testing.assert_allclose(motions.velocity[1:, 2], 0.5, rtol=1e-6)
    assert motions.pose[-1, 2] == pytest.approx(0.045, rel=1e-3)


def test_pads_without_a_place_give_their_mean_translation() -> None:
    sensor = hand(2, placed=False)
    slips = slips_of(sensor, np.zeros((2, 3)), np.zeros((2, 2)))
    slips.displacement[1, :, :2] = [[1e-4, 0], [3e-4, 2e-4]]
    motions = fused(sensor, slips)
    np.testing.assert_allclose(motions.velocity[1, :2], [0.02, 0.01], rtol=1e-9)
    assert np.isnan(motions.velocity[1, 2])


def test_groups_take_the_place_of_the_pad_that_they_cut_up() -> None:
    halves = tuple(
        Group(name=name, patches=(Patch(pad="pad0", cols=cols),)) for name, cols in (("l", (0, 1)), ("r", (2, 3)))
    )
    sensor = hand(2, groups=halves)
    layout = sensor.layout
    points = np.nan_to_num(layout.T_hand)[:, :2] + np.array([[0, 0], [0, 0], [-0.005, 0], [0.005, 0]])
    motions = fused(sensor, slips_of(sensor, spin(5, (0, 0, 1.0)), points))
    assert motions.pads.tolist() == [0, 3, 3, 3, 3]
    np.testing.assert_allclose(motions.velocity[1:, 2], 1.0, rtol=1e-2)


def test_a_contact_at_a_border_counts_less() -> None:
    sensor = hand(3)
    slips = slips_of(sensor, spin(3, (0.02, 0, 0)), points_of(sensor))
    slips.displacement[1:, 0, :2] *= 0.2  # cut off by the border, it seems slow
    plain = fused(sensor, slips)
    slips.border[:, 0] = True
    np.testing.assert_array_equal(fused(sensor, slips).velocity, plain.velocity)  # its covariance holds at a border
    slips.quality[:, 0] = AMBIGUOUS
    doubted = fused(sensor, slips)
    assert abs(doubted.velocity[1, 0] - 0.02) < 0.5 * abs(plain.velocity[1, 0] - 0.02)


def test_the_covariance_is_that_of_many_draws() -> None:
    sensor, random = hand(), np.random.default_rng(0)
    draws = 3000
    slips = slips_of(sensor, np.zeros((draws, 3)), points_of(sensor), std_m=2e-5)
    slips.displacement[:, :, :2] = random.normal(0, 2e-5 * 2**0.5, (draws, 4, 2))
    motions = fused(sensor, slips)
    expected = motions.velocity_covariance[0]
    std = np.sqrt(np.diagonal(expected))
    np.testing.assert_allclose(np.cov(motions.velocity.T) / np.outer(std, std), expected / np.outer(std, std), atol=0.1)


def test_two_equal_pads_halve_the_variance_of_one() -> None:
    one, two = (
        fused(sensor, slips_of(sensor, spin(2, (0.01, 0, 0)), points_of(sensor)))
        for sensor in (hand(1), hand(2, placed=True))
    )
    ratio = one.velocity_covariance[1, 0, 0] / two.velocity_covariance[1, 0, 0]
    assert ratio == pytest.approx(2, rel=0.05)


def test_a_negative_doubt_is_refused() -> None:
    with pytest.raises(ParameterInvalid, match="edge_doubt"):
        RigidField(edge_doubt=-1)


def test_the_papers_hand_fuses_its_fingers_and_the_groups_of_its_palm() -> None:
    sensor = load_sensor("barretthand-162")
    points = np.nan_to_num(sensor.layout.T_hand)[:, :2] + np.array([[0.003, 0.002]])
    motions = fused(sensor, slips_of(sensor, spin(3, (0, 0, 0.5)), points))
    assert motions.pads.tolist() == [0, 9, 9]


def pressed_on(until: int) -> tuple[Sensor, Floats, Slips]:
    """An object that moves from twice `until` on, once all pads have been pressed on. As their loads rise, up to scan
    `until`, the patterns drift by 5 mm, far beyond their covariance.
    """
    sensor = hand(unseen_error=0.05)
    poses = np.concatenate([np.zeros((2 * until, 3)), spin(60, (0.02, -0.01, 0.4))])
    slips = slips_of(sensor, poses, points_of(sensor))
    rise = np.minimum(np.arange(1, len(poses) + 1) / until, 1.0)[:, np.newaxis]
    slips.pose[..., 0] += 5e-3 * (rise - 1.0) * [1, -1, 1, 1]
    slips.displacement[1:] = np.diff(slips.pose, axis=0)
    slips.load[:] = rise
    return sensor, poses, slips


def test_poses_of_contacts_that_form_do_not_move_the_object() -> None:
    sensor, poses, slips = pressed_on(until=30)
    found = fused(sensor, slips)
    formed = np.isfinite(found.pose[:, 0])
    assert not formed[:30].any()
    assert formed[60:].all()
    np.testing.assert_allclose(found.pose[formed], poses[formed], atol=1e-7)


def test_a_pose_is_unknown_until_a_contact_has_formed_and_does_not_depend_on_blocks() -> None:
    sensor, _, slips = pressed_on(until=30)
    whole = fused(sensor, slips)
    parts = fused(sensor, *(cut(slips, k, k + 1) for k in range(len(slips))))
    assert np.isnan(whole.pose_covariance[:30]).all()
    assert_same(whole, parts)
