from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from compiled import compiled
from synthetic import assert_same, seen_slips
from taxelflow.errors import ParameterInvalid
from taxelflow.fusion.parameters import RigidField
from taxelflow.fusion.spatial.parameters import SpatialField
from taxelflow.fusion.spatial.pose import factor_in_body
from taxelflow.messages import UNRESOLVED, Floats, Slips, SpatialMotions, Texture, cut, joined
from taxelflow.numerics.geometry import adjoint, se3_exp, se3_inverse, se3_log, se3_of
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor

DT = 0.01
LOOSE = {"blind_m_s": 100.0, "blind_m": 1.0}


def turned(angle: float, x: float, y: float) -> tuple[float, ...]:
    return (x, y, 0.0, 0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2))


FLAT = tuple(
    turned(a, x, y) for a, x, y in ((1.5, -0.08, 0.0), (-1.5, 0.08, 0.01), (3.0, 0.0, -0.07), (0.2, 0.01, 0.06))
)


def around(count: int, radius_m: float = 0.04) -> tuple[tuple[float, ...], ...]:
    """Pads on a cylinder about z, at two heights, that face its axis."""
    poses = []
    for k in range(count):
        a, height = 2 * np.pi * k / count + 0.3 * (k % 2), 0.02 * (k % 2)
        out = np.array([np.cos(a), np.sin(a), 0.0])
        axes = Rotation.from_matrix(np.column_stack([[np.sin(a), -np.cos(a), 0.0], [0.0, 0.0, 1.0], -out]))
        poses.append((*(radius_m * out + [0.0, 0.0, 0.1 + height]).tolist(), *axes.as_quat().tolist()))
    return tuple(poses)


def hand(poses: tuple[tuple[float, ...], ...], *, flat: bool = False, unseen_error: float = 0.0) -> Sensor:
    pads = tuple(
        Pad(
            name=f"pad{k}",
            rows=4,
            cols=4,
            pitch_m=(0.005, 0.005),
            pose=pose,
            origin_m=(pose[0], pose[1]) if flat else None,
            angle_rad=float(2 * np.arctan2(pose[5], pose[6])) if flat else 0.0,
        )
        for k, pose in enumerate(poses)
    )
    return Sensor(name="hand", unit="Pa", pads=pads, unseen_error=unseen_error)


def slips_of(sensor: Sensor, X: Floats, *, spins: bool = True, std_m: float = 1e-5, std_rad: float = 1e-3) -> Slips:
    """What pads see of an object at poses X (scans, 4, 4): where its point that lay at (1, 2) mm is, and its turn."""
    T = np.array([se3_of(np.array(pad.pose[:3]), np.array(pad.pose[3:])) for pad in sensor.pads if pad.pose])
    start = T.copy()
    start[:, :3, 3] += T[:, :3, :3] @ np.array([0.001, 0.002, 0.0])
    rel = se3_inverse(T) @ X[:, np.newaxis] @ start
    scans, pads = rel.shape[:2]
    pose = np.full((scans, pads, 3), np.nan)
    pose[..., :2] = rel[..., :2, 3]
    covariance = np.full((scans, pads, 3, 3), np.nan)
    covariance[..., :2, :2] = std_m**2 * np.eye(2)
    if spins:
        pose[..., 2] = np.arctan2(rel[..., 1, 0], rel[..., 0, 0])
        covariance[:] = np.diag([std_m**2, std_m**2, std_rad**2])
    displacement = np.full_like(pose, np.nan)
    displacement[1:] = np.diff(pose, axis=0)
    return seen_slips(DT * np.arange(scans), pose, displacement, covariance)


def fused(sensor: Sensor, *blocks: Slips, **asked: float) -> SpatialMotions:
    session = SpatialField(**asked).start(sensor, None)
    assert session is not None
    return joined([session.step(block, block.pose[..., :2]) for block in blocks])


def moved(scans: int, twist: Floats) -> Floats:
    return se3_exp(DT * np.arange(scans)[:, np.newaxis] * twist)


def planar(scans: int) -> Floats:
    return moved(scans, np.array([0.02, -0.01, 0.0, 0.0, 0.0, 0.8]))


def test_on_a_flat_hand_the_solution_is_the_planar_one() -> None:
    sensor = hand(FLAT, flat=True)
    slips = slips_of(sensor, planar(20))
    noise = np.random.default_rng(0).normal(0, 1e-5, slips.pose.shape) * [1, 1, 100]
    slips.pose[:] += noise
    slips.displacement[1:] = np.diff(slips.pose, axis=0)
    flat = RigidField().start(sensor.layout).step(slips, slips.pose[..., :2])
    space = fused(sensor, slips, window_s=0.0, **LOOSE)
    np.testing.assert_allclose(space.twist[1:, [0, 1, 5]], flat.velocity[1:], atol=1e-9)
    np.testing.assert_allclose(
        space.twist_covariance[1:3][:, [0, 1, 5]][..., [0, 1, 5]], flat.velocity_covariance[1:3], rtol=1e-7
    )  # later ones are widened by the misfit of the scans before
    np.testing.assert_allclose(space.pose[:, :2], flat.pose[:, :2], atol=1e-9)
    np.testing.assert_allclose(2 * np.arctan2(space.pose[:, 5], space.pose[:, 6]), flat.pose[:, 2], atol=1e-9)
    assert (space.rank[1:] == 3).all()
    assert np.isnan(space.twist[:, 2:5]).all()


def test_a_twist_of_six_components_comes_out_of_pads_around_the_object() -> None:
    sensor, twist = hand(around(6)), np.array([0.01, -0.02, 0.015, 0.3, -0.2, 0.4])
    X = moved(2, twist)
    found = fused(sensor, slips_of(sensor, X), window_s=0.0, **LOOSE)
    assert found.rank[1] == 6
    np.testing.assert_allclose(found.twist[1], twist, rtol=0.02, atol=5e-4)


def test_the_pose_is_the_objects_pose() -> None:
    sensor = hand(around(6))
    X = moved(40, np.array([0.01, -0.02, 0.015, 0.3, -0.2, 0.4]))
    found = fused(sensor, slips_of(sensor, X))
    T = np.array([se3_of(pose[:3], pose[3:]) for pose in found.pose])
    error = se3_log(T @ se3_inverse(X))
    np.testing.assert_allclose(error, 0, atol=1e-6)


def test_the_twist_is_the_mean_of_the_window() -> None:
    sensor, twist = hand(around(6)), np.array([0.0, 0.0, 0.015, 0.0, 0.0, 0.2])  # along all pads
    found = fused(sensor, slips_of(sensor, moved(60, twist)), window_s=0.25)
    np.testing.assert_allclose(found.twist[30:], np.tile(twist, (30, 1)), atol=1e-3)
    assert np.isnan(found.twist[:8]).all()


def test_the_covariances_are_those_of_many_draws() -> None:
    sensor, random = hand(around(6)), np.random.default_rng(1)
    scans = 400
    slips = slips_of(sensor, np.tile(np.eye(4), (scans, 1, 1)))
    slips.pose[:] += random.normal(size=slips.pose.shape) * [1e-5, 1e-5, 1e-3]
    slips.displacement[1:] = np.diff(slips.pose, axis=0)
    found = fused(sensor, slips, window_s=0.0)
    nees = np.einsum("ki,kij,kj->k", found.twist[1:], np.linalg.inv(found.twist_covariance[1:]), found.twist[1:]) / 6
    assert nees.mean() == pytest.approx(1, abs=0.2)
    T = np.array([se3_of(pose[:3], pose[3:]) for pose in found.pose[1:]])
    xi = se3_log(T)
    own = np.cov(xi.T)
    whole = found.pose_covariance[1:].mean(axis=0)  # of now and of the anchors, in equal parts
    assert np.trace(np.linalg.solve(whole, own)) / 6 == pytest.approx(0.5, abs=0.15)


def test_one_wrong_pad_of_seven_is_blamed_and_changes_little() -> None:
    sensor, random, twist = hand(around(7)), np.random.default_rng(2), np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.4])
    slips = slips_of(sensor, moved(60, twist))
    slips.pose[:] += random.normal(size=slips.pose.shape) * [1e-5, 1e-5, 1e-3]
    right = fused(sensor, slips)
    slips.pose[:, 3] = slips.pose[:1, 3]  # it sticks to the skin
    wrong = fused(sensor, slips)
    error = [np.sqrt(np.mean((found.twist[30:] - right.twist[30:].mean(axis=0)) ** 2)) for found in (right, wrong)]
    assert error[1] < 1.5 * error[0]
    assert wrong.blamed[30:, 3].all()
    assert not np.delete(wrong.blamed[30:], 3, axis=1).any()
    assert not right.blamed.any()


def test_a_pad_that_sticks_is_blamed_though_its_contact_began_unresolved() -> None:
    sensor, random = hand(around(7)), np.random.default_rng(4)
    X = moved(90, np.zeros(6))
    X[30:] = moved(60, np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.4]))
    slips = slips_of(sensor, X)
    slips.pose[:] += random.normal(size=slips.pose.shape) * [1e-5, 1e-5, 1e-3]
    slips.pose[:4] += random.normal(size=slips.pose[:4].shape) * [1e-3, 1e-3, 0.0]  # while it is pressed on
    slips.quality[:4] = UNRESOLVED
    right = fused(sensor, slips)
    slips.pose[30:, 3] = slips.pose[29, 3]
    wrong = fused(sensor, slips)
    for found in (right, wrong):
        T = np.array([se3_of(pose[:3], pose[3:]) for pose in found.pose[30:]])
        apart = se3_log(se3_inverse(X[30:]) @ T)
        assert np.abs(apart - apart[0])[:, :3].max() < 2e-4
    assert wrong.blamed[35:, 3].all()
    assert not np.delete(wrong.blamed[35:], 3, axis=1).any()


def test_scans_that_are_not_resolved_as_pads_are_pressed_on_do_not_place_the_object() -> None:
    sensor, random = hand(around(6)), np.random.default_rng(5)
    X = moved(60, np.zeros(6))
    X[30:] = moved(30, np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.4]))
    slips = slips_of(sensor, X)
    slips.pose[:4] += random.normal(size=slips.pose[:4].shape) * [5e-3, 5e-3, 0.1]  # far beyond their covariance
    slips.quality[:4] = UNRESOLVED
    found = fused(sensor, slips)
    assert np.isnan(found.pose[:4]).all()
    T = np.array([se3_of(pose[:3], pose[3:]) for pose in found.pose[4:]])
    assert np.abs(se3_log(se3_inverse(X[4:]) @ T)).max() < 1e-6
    assert not found.contradicted.any()


def pressed_on(scans: int, until: int) -> tuple[Floats, Slips]:
    """An object at rest until all pads have been pressed on, which then moves. As their loads rise, up to a scan, the
    patterns drift by 5 mm, far beyond their covariance.
    """
    X = moved(scans, np.zeros(6))
    X[2 * until :] = moved(scans - 2 * until, np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.4]))
    slips = slips_of(hand(around(6)), X)
    rise = np.minimum(np.arange(1, scans + 1) / until, 1.0)[:, np.newaxis]
    slips.pose[..., 0] += 5e-3 * (rise - 1.0) * [1, -1, 1, 1, -1, 1]
    slips.displacement[1:] = np.diff(slips.pose, axis=0)
    slips.load[:] = rise
    return X, slips


def test_poses_of_contacts_that_form_do_not_move_the_object() -> None:
    X, slips = pressed_on(120, until=30)
    found = fused(hand(around(6), unseen_error=0.05), slips)
    formed = np.isfinite(found.pose[:, 0])
    assert not formed[:30].any()
    assert formed[60:].all()
    T = np.array([se3_of(pose[:3], pose[3:]) for pose in found.pose[formed]])
    assert np.abs(se3_log(se3_inverse(X[formed]) @ T)).max() < 1e-6
    assert not found.contradicted.any()


def test_a_load_that_rises_on_and_on_does_not_leave_a_contact_out_for_ever() -> None:
    _, slips = pressed_on(300, until=1000)
    found = fused(hand(around(6), unseen_error=0.05), slips)
    assert np.isnan(found.pose[:200, 0]).all()
    assert np.isfinite(found.pose[202:, 0]).all()


def test_a_contact_that_is_pressed_harder_goes_on() -> None:
    _, slips = pressed_on(120, until=30)
    slips.load[90:] *= 5.0
    found = fused(hand(around(6), unseen_error=0.05), slips)
    assert np.isfinite(found.pose[60:, 0]).all()


def test_contacts_that_are_never_resolved_place_the_object_after_a_window() -> None:
    sensor = hand(around(6))
    slips = slips_of(sensor, moved(60, np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.4])))
    slips.quality[:] = UNRESOLVED
    found = fused(sensor, slips)
    assert np.isnan(found.pose[:25]).all()
    assert np.isfinite(found.pose[26:]).all()


def test_a_pad_that_sticks_is_blamed_after_scans_in_which_nobody_could_be() -> None:
    sensor, random, twist = hand(around(6)), np.random.default_rng(6), np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.4])
    slips = slips_of(sensor, moved(140, twist))
    slips.pose[:] += random.normal(size=slips.pose.shape) * [1e-5, 1e-5, 1e-3]
    slips.pose[:, 3] = slips.pose[:1, 3]
    slips.pose[:50, 5] = slips.pose[:1, 5]  # two of six: no third is left to judge by
    found = fused(sensor, slips)
    assert not found.blamed[40:50, 5].any()
    late = slice(80, None)  # the misfit of before still counts for half
    assert found.blamed[late, 3].all()
    assert not np.delete(found.blamed[late], 3, axis=1).any()
    np.testing.assert_allclose(found.twist[late], np.broadcast_to(twist, (60, 6)), atol=5e-3)


def test_a_contact_that_only_looks_smooth_moves_with_the_surface_though_another_pad_sticks() -> None:
    sensor, random, twist = hand(around(6)), np.random.default_rng(7), np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.4])
    slips = slips_of(sensor, moved(80, twist))
    slips.pose[:] += random.normal(size=slips.pose.shape) * [1e-5, 1e-5, 1e-3]
    slips.pose[:, 4] = slips.pose[:1, 4]
    smooth = np.zeros(slips.contact.shape, dtype=np.bool_)
    smooth[:, 1] = True
    texture = Texture(slips.t_s, smooth, ~smooth, np.zeros((*smooth.shape, 2, 2)))
    session = SpatialField().start(sensor, None)
    assert session is not None
    found = session.step(slips, slips.pose[..., :2], texture)
    assert found.blamed[40:, 4].all()
    assert not found.blamed[40:, 1].any()
    np.testing.assert_allclose(found.twist[40:], np.broadcast_to(twist, (40, 6)), atol=5e-3)


def test_with_three_pads_nobody_can_be_blamed() -> None:
    sensor = hand(around(3))
    slips = slips_of(sensor, moved(60, np.array([0.02, -0.01, 0.015, 0.0, 0.0, 0.4])), spins=False)
    slips.covariance[..., 2, :] = slips.covariance[..., :, 2] = np.nan
    spun = slips_of(sensor, moved(60, np.array([0.02, -0.01, 0.015, 0.0, 0.0, 0.4])))
    spun.pose[:, 1] = spun.pose[:1, 1]
    right = fused(sensor, slips_of(sensor, moved(60, np.array([0.02, -0.01, 0.015, 0.0, 0.0, 0.4]))))
    found = fused(sensor, spun)
    assert found.contradicted[10]  # at once; later the covariances of all have been widened
    assert not found.blamed[30:].any()
    assert (np.diagonal(found.twist_covariance[40], axis1=0, axis2=1) > np.diagonal(right.twist_covariance[40])).all()


def test_a_contact_that_comes_later_inherits_the_error_of_the_pose() -> None:
    sensor = hand(around(6))
    X = moved(60, np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.2]))  # along all pads
    slips = slips_of(sensor, X)
    slips.contact[:20, 3:] = False
    slips.pose[:20, 3:] = np.nan
    slips.contact[40:, :3] = False
    slips.pose[40:, :3] = np.nan
    found = fused(sensor, slips)
    always = fused(sensor, slips_of(sensor, X))
    T = np.array([se3_of(pose[:3], pose[3:]) for pose in found.pose])
    np.testing.assert_allclose(se3_log(T @ se3_inverse(X))[1:], 0, atol=2e-4)
    assert np.trace(found.pose_covariance[50]) > 1.5 * np.trace(always.pose_covariance[50])


def test_a_direction_that_one_finger_does_not_show_counts_from_when_the_others_touch() -> None:
    sensor = hand(around(6))
    X = moved(60, np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.2]))
    slips = slips_of(sensor, X)
    slips.contact[:10, 1:] = False
    slips.pose[:10, 1:] = np.nan
    found = fused(sensor, slips)
    assert (found.pose_rank[1:11] == 3).all()
    assert (found.pose_rank[11:] == 6).all()
    assert not np.nan_to_num(found.pose_blind[11:]).any()
    assert (np.diagonal(found.pose_covariance[11:], axis1=1, axis2=2)[:, :3] < 2e-4**2).all()
    T = np.array([se3_of(pose[:3], pose[3:]) for pose in found.pose])
    since = T[11:] @ se3_inverse(T[11]) @ se3_inverse(X[11:] @ se3_inverse(X[11]))
    np.testing.assert_allclose(se3_log(since), 0, atol=2e-4)


def test_the_covariance_holds_though_contacts_join_a_pose_with_blind_directions() -> None:
    sensor, random, std = hand(around(6)), np.random.default_rng(11), np.array([1e-5, 1e-5, 1e-3])
    slow = moved(30, np.array([0.0006, -0.0009, 0.00045, 0.009, -0.006, 0.012]))
    X = np.concatenate([np.tile(np.eye(4), (30, 1, 1)), slow])
    nees = []
    for _ in range(40):
        slips = slips_of(sensor, X, std_m=std[0], std_rad=std[2])
        slips.pose[:] += random.normal(size=slips.pose.shape) * std
        slips.displacement[1:] = np.diff(slips.pose, axis=0)
        slips.contact[:20, 1:] = False
        slips.pose[:20, 1:] = slips.displacement[:21, 1:] = np.nan
        found = fused(sensor, slips)
        error = se3_log(se3_of(found.pose[-1, :3], found.pose[-1, 3:]) @ se3_inverse(X[-1]))
        nees.append(error @ np.linalg.solve(found.pose_covariance[-1], error) / 6)
    assert 0.6 < np.mean(nees) < 1.3


@pytest.mark.parametrize("rank", [1, 3, 5])
def test_what_contacts_inherit_has_a_factor_though_directions_are_left_out(rank: int) -> None:
    factor: Any = compiled(factor_in_body)
    rng = np.random.default_rng(rank)
    for _ in range(300):
        columns = rng.standard_normal((6, rank)) * 10.0 ** rng.uniform(-6, -1, rank)
        T = se3_exp(rng.normal(0, 0.3, 6))
        covariance, root = columns @ columns.T, np.zeros((6, 6))
        factor(covariance, T, root)
        inside = adjoint(T) @ covariance @ adjoint(T).T
        np.testing.assert_allclose(root @ root.T, inside, rtol=0, atol=1e-11 * np.abs(inside).max() + 1e-17)


def test_a_direction_that_was_shown_and_is_lost_for_a_while_stays_unknown() -> None:
    sensor = hand(around(6))
    slips = slips_of(sensor, moved(60, np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.2])))
    slips.contact[20:30, 1:] = False
    slips.pose[20:30, 1:] = np.nan
    found = fused(sensor, slips)
    centre = np.eye(6)  # to the mean of the contacts, turns times the length
    centre[:3, 3:] = -np.cross(np.mean([pad.pose[:3] for pad in sensor.pads if pad.pose], axis=0), np.eye(3)).T
    scale = np.diag([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
    for scan, rank in ((15, 6), (25, 3), (32, 3), (59, 3)):
        whole = scale @ centre @ found.pose_covariance[scan] @ centre.T @ scale
        known = int((np.linalg.eigvalsh(whole) < 0.005**2).sum())
        assert found.pose_rank[scan] == known == rank
        assert (np.abs(np.nan_to_num(found.pose_blind[scan])).max(axis=1) > 0.0).sum() == 6 - rank
    assert (found.rank[55:] == 6).all()  # the twist is known all the same


def test_a_gap_that_the_method_does_not_measure_across_makes_no_jump() -> None:
    sensor = hand(around(6))
    slips = slips_of(sensor, moved(60, np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.2])))
    slips.pose[30:, :2] += [0.02, 0.01, 0.0]  # two pads lose their way, and begin anew elsewhere
    slips.displacement[30, :2] = np.nan
    found = fused(sensor, slips)
    T = np.array([se3_of(pose[:3], pose[3:]) for pose in found.pose])
    X = moved(60, np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.2]))
    np.testing.assert_allclose(se3_log(T @ se3_inverse(X))[1:], 0, atol=1e-3)
    assert not found.blamed.any()
    assert np.abs(found.twist[30:] - found.twist[29]).max() < 0.02


def test_after_a_gap_of_all_pads_the_pose_goes_on_with_a_larger_covariance() -> None:
    sensor = hand(around(6))
    slips = slips_of(sensor, moved(40, np.zeros(6)))
    slips.pose[20:] += [0.02, 0.0, 0.0]
    slips.displacement[20] = np.nan
    found = fused(sensor, slips)
    assert np.abs(found.pose[20:, :3] - found.pose[19, :3]).max() < 1e-4
    assert (np.sqrt(np.diagonal(found.pose_covariance[30])[:3]) > 0.02).all()
    assert (found.pose_rank[:20] == 6).all()
    assert (found.pose_rank[20:] == 0).all()


def test_all_contacts_lost_means_a_new_beginning_and_no_result_depends_on_blocks() -> None:
    sensor = hand(around(6))
    slips = slips_of(sensor, moved(40, np.array([0.01, 0.0, 0.01, 0.0, 0.1, 0.2])))
    slips.contact[15:18] = False
    slips.pose[15:18] = slips.displacement[15:18] = np.nan
    whole = fused(sensor, slips)
    assert np.isnan(whole.pose[15:18]).all()
    np.testing.assert_allclose(whole.pose[18], [0, 0, 0, 0, 0, 0, 1], atol=1e-12)
    assert_same(fused(sensor, *(cut(slips, k, k + 1) for k in range(40))), whole)


def test_a_twist_in_another_frame_is_the_adjoint() -> None:
    T = se3_of(np.array([0.1, -0.2, 0.05]), np.array([0.1, 0.2, 0.3, 0.9]))
    poses, other = around(6), []
    for pose in poses:
        P = T @ se3_of(np.array(pose[:3]), np.array(pose[3:]))
        other.append((*P[:3, 3], *_quaternion(P[:3, :3])))
    twist = np.array([0.02, -0.01, 0.015, 0.3, -0.2, 0.4])
    X = moved(3, twist)
    one = fused(hand(poses), slips_of(hand(poses), X), window_s=0.0)
    two = fused(hand(tuple(other)), slips_of(hand(tuple(other)), T @ X @ se3_inverse(T)), window_s=0.0)
    np.testing.assert_allclose(two.twist[1:], one.twist[1:] @ adjoint(T).T, atol=1e-7)


def _quaternion(R: Floats) -> Floats:
    from taxelflow.numerics.geometry import quaternion_of

    return quaternion_of(R)


def test_bad_parameters_are_refused() -> None:
    with pytest.raises(ParameterInvalid, match=r"spatial\.window_s"):
        SpatialField(window_s=-1)
    with pytest.raises(ParameterInvalid, match=r"spatial\.length_m"):
        SpatialField(length_m=0)


def test_a_hand_without_places_in_space_has_no_session() -> None:
    sensor = hand(FLAT)
    nowhere = msgspec.structs.replace(
        sensor, pads=tuple(msgspec.structs.replace(pad, pose=None) for pad in sensor.pads)
    )
    assert SpatialField().start(nowhere, None) is None


def test_contacts_that_come_to_a_blind_pose_are_not_held_to_it() -> None:
    """As fingers close: three contacts, whose first places are far beyond their covariance, and then all six."""
    sensor, random = hand(around(6)), np.random.default_rng(6)
    X = moved(60, np.zeros(6))
    X[30:] = moved(30, np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.4]))
    slips = slips_of(sensor, X)
    slips.pose[:] += random.normal(size=slips.pose.shape) * [1e-5, 1e-5, 1e-3]
    slips.contact[0, 3:] = False
    slips.pose[0, 3:] = np.nan
    slips.pose[0, :3] += random.normal(size=(3, 3)) * [1e-3, 1e-3, 0.03]
    found = fused(sensor, slips)
    T = np.array([se3_of(pose[:3], pose[3:]) for pose in found.pose[2:]])
    apart = se3_log(se3_inverse(X[2:]) @ T)
    assert np.abs(apart - apart[0])[:, :3].max() < 1e-4
