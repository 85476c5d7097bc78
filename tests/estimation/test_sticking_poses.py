"""Poses of objects that stick, combined with the place where they were touched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from synthetic import assert_same
from taxelflow.estimation.sticking_poses import STICKS, StickingPoses
from taxelflow.messages import AMBIGUOUS, LOST, OK, Slips, cut

PITCH_M = 0.004
PRIOR_M = STICKS * PITCH_M
lengths = st.floats(1e-5, 0.02)


def slips(places_m: list[float], deviation_m: float = 0.01, *, touching: str = "", quality: int = AMBIGUOUS) -> Slips:
    """Scans of one pad at these places along x, without an angle; touching: a character a scan, `.` for no."""
    count = len(places_m)
    contact = np.array([[one != "."] for one in touching or "x" * count])
    pose = np.full((count, 1, 3), np.nan)
    pose[:, 0, 0], pose[:, 0, 1] = places_m, 0.0
    covariance = np.full((count, 1, 3, 3), np.nan)
    covariance[..., :2, :2] = deviation_m**2 * np.eye(2)
    one, steps = np.ones((count, 1)), np.full((count, 1, 3), 1e-3)
    border, worth = np.zeros((count, 1, 2), dtype=np.bool_), np.full((count, 1), quality, dtype=np.uint8)
    t_s = 0.1 * np.arange(count)
    return Slips(t_s, contact, border, steps, pose, covariance, covariance, 0.1 * one, 0 * one, one, one, worth)


def held(given_slips: Slips, *, sticks: bool = True) -> Slips:
    poses = StickingPoses(np.array([PITCH_M]))
    flags = np.full(given_slips.contact.shape, sticks)
    return poses.held(given_slips, poses.touched(given_slips), flags & given_slips.contact)


def test_an_open_pose_is_where_the_object_was_touched() -> None:
    found = held(slips([0.0, 0.015, -0.02], deviation_m=0.05))
    assert_allclose(found.pose[:, 0, 0], 0.0, atol=1e-5)
    assert (found.quality == OK).all()
    assert_allclose(np.sqrt(found.covariance[:, 0, 0, 0]), PRIOR_M, rtol=1e-3)
    assert not found.displacement[..., :2].any()
    assert np.isnan(found.pose[..., 2]).all()


@given(lengths, lengths)
def test_a_pose_and_its_prior_weigh_by_their_variances(away_m: float, deviation_m: float) -> None:
    found = held(slips([0.0, away_m], deviation_m))
    weight = PRIOR_M**2 / (PRIOR_M**2 + deviation_m**2)
    assert_allclose(found.pose[1, 0, 0], weight * away_m, rtol=1e-6)
    assert_allclose(found.covariance[1, 0, 0, 0], weight * deviation_m**2, rtol=1e-6)


def test_an_angle_that_goes_with_the_place_follows_it() -> None:
    whole = slips([0.0, 0.004])
    whole.pose[..., 2] = 0.4
    whole.covariance[...] = np.eye(3) * [1e-4, 1e-4, 1.0]
    whole.covariance[..., 0, 2] = whole.covariance[..., 2, 0] = 5e-3
    found = held(whole)
    gain = 5e-3 / (1e-4 + PRIOR_M**2)
    assert_allclose(found.pose[1, 0, 2], 0.4 - gain * 0.004)
    assert_allclose(found.covariance[1, 0, 2, 2], 1.0 - gain * 5e-3)
    assert (np.linalg.eigvalsh(found.covariance[1, 0]) > 0).all()


def test_what_does_not_stick_or_is_lost_stays_as_it_is() -> None:
    assert_same(held(slips([0.0, 0.01]), sticks=False), slips([0.0, 0.01]))
    assert (held(slips([0.0, 0.01], quality=LOST)).quality == LOST).all()


def test_a_pose_that_may_be_anywhere_along_one_axis_keeps_variances_above_0() -> None:
    open_ = slips([0.0, 0.001, 0.002])
    along = np.array([0.6, 0.8])
    open_.covariance[..., :2, :2] = 1e6 * np.outer(along, along) + 1e-9 * np.eye(2)
    left = held(open_).covariance[:, 0, :2, :2]
    assert_allclose(left @ along, np.broadcast_to(PRIOR_M**2 * along, (3, 2)), rtol=1e-6)
    assert (np.linalg.eigvalsh(left) > -1e-6 * PRIOR_M**2).all()


def test_the_first_scan_of_a_contact_has_no_displacement() -> None:
    begun = slips([0.0, 0.001])
    begun.displacement[0] = np.nan
    found = held(begun)
    assert np.isnan(found.displacement[0]).all()
    assert not found.displacement[1, 0, :2].any()


def test_an_object_that_is_touched_again_has_another_place() -> None:
    found = held(slips([0.0, 0.0, np.nan, 0.0071], touching="xx.x"))
    assert found.pose[3, 0, 0] == 0.0071


@given(st.lists(st.floats(-0.01, 0.01), min_size=2, max_size=8), st.data())
def test_blocks_do_not_matter(places_m: list[float], data: st.DataObject) -> None:
    whole, at = slips(places_m), data.draw(st.integers(1, len(places_m) - 1))
    poses, parts = StickingPoses(np.array([PITCH_M])), [cut(whole, 0, at), cut(whole, at, len(whole))]
    parts = [poses.held(part, poses.touched(part), part.contact) for part in parts]
    joined = replace(whole, pose=np.concatenate([part.pose for part in parts]))
    assert_allclose(joined.pose, held(whole).pose)
