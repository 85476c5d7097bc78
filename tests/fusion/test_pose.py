from __future__ import annotations

import numpy as np
import pytest

from taxelflow.fusion.anchors import Anchor, Body
from taxelflow.fusion.hand_frame import Carried
from taxelflow.fusion.pose import follow_pose
from taxelflow.fusion.twist import Equations, Row
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.geometry import transform
from taxelflow.numerics.records import Records, records, unknown

POINTS = np.array([[-0.08, 0.01], [0.07, 0.02], [0.0, -0.06]])
STD_M = 1e-5


def followed(
    places: Floats,
    *,
    touching: Bools | None = None,
    own_turn: Floats | None = None,
    turns: bool = True,
    std_m: float = STD_M,
) -> Records:
    """Rows of scans in which contacts lie at places (scans, pads, 2), known to a standard deviation."""
    scans, pads = places.shape[:2]
    rows, flags = unknown(Row, scans), np.ones((scans, pads), np.bool_) if touching is None else touching
    covariance = np.tile(std_m**2 * np.eye(2), (scans, pads, 1, 1))
    nothing = np.full((scans, pads, 2), np.nan)
    own = nothing if own_turn is None else own_turn
    here = Carried(places, nothing, nothing, own, flags, flags, flags)
    follow_pose(here, covariance, turns, records(Anchor, pads), records(Body, 1), records(Equations, 1), rows)
    return rows


def seen(poses: Floats, points: Floats = POINTS) -> Floats:
    """Where contacts on an object lie at its poses (scans, 3)."""
    return transform(np.asarray(poses)[:, np.newaxis], points)


def test_the_pose_is_that_of_the_object_and_0_in_the_first_scan() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [0.01, -0.02, 0.3], [0.02, 0.01, -0.4]])
    rows = followed(seen(poses))
    np.testing.assert_allclose(rows["pose"], poses, atol=1e-9)
    assert (rows["pose_covariance"][0] == 0.0).all()


def test_the_covariance_is_that_of_a_fit_with_the_noise_of_now_and_of_the_anchor() -> None:
    rows = followed(seen(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])))
    J = np.concatenate([np.array([[1.0, 0.0, -y], [0.0, 1.0, x]]) for x, y in POINTS])
    np.testing.assert_allclose(rows["pose_covariance"][1], 2 * STD_M**2 * np.linalg.inv(J.T @ J), rtol=1e-6)


def test_one_contact_has_a_translation_and_no_turn() -> None:
    rows = followed(seen(np.array([[0.0, 0.0, 0.0], [0.01, 0.02, 0.0]]), POINTS[:1]))
    np.testing.assert_allclose(rows["pose"][1, :2], [0.01, 0.02], atol=1e-12)
    assert np.isnan(rows["pose"][1, 2])
    assert np.isnan(rows["pose_covariance"][1, 2]).all()
    np.testing.assert_allclose(rows["pose_covariance"][1, :2, :2], 2 * STD_M**2 * np.eye(2), rtol=1e-6)


def test_unknown_places_give_no_turn() -> None:
    rows = followed(seen(np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.2]])), turns=False)
    assert np.isnan(rows["pose"][1, 2])


@pytest.mark.parametrize(("std_m", "known"), [(0.03, True), (0.05, False)])
def test_a_turn_less_certain_than_half_a_radian_stays_empty(std_m: float, known: bool) -> None:
    rows = followed(seen(np.zeros((2, 3))), std_m=std_m)
    assert np.isfinite(rows["pose"][1, 2]) == known
    assert np.isfinite(rows["pose"][1, :2]).all()
    turn_std = np.sqrt(2) * std_m / np.sqrt(np.sum((POINTS - POINTS.mean(axis=0)) ** 2))
    assert (turn_std < 0.5) == known


def test_places_that_determine_no_turn_give_none_that_adds_up() -> None:
    places = seen(np.zeros((300, 3))) + 0.05 * np.random.default_rng(0).standard_normal((300, 3, 2))
    rows = followed(places, std_m=0.05)
    assert np.isnan(rows["pose"][1:, 2]).all()
    sigmas = rows["pose"][1:, :2] / np.sqrt(rows["pose_covariance"][1:, [0, 1], [0, 1]])
    assert np.abs(sigmas).max() < 4.5


def test_a_pads_own_theta_counts_half() -> None:
    own = np.full((2, 1, 2), np.nan)
    own[:, 0] = [[0.1, 1e-6], [0.3, 1e-6]]
    rows = followed(seen(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.2]]), POINTS[:1]), own_turn=own)
    assert rows["pose"][1, 2] == pytest.approx(0.2, abs=1e-9)
    assert rows["pose_covariance"][1, 2, 2] == pytest.approx(2e-6, rel=1e-3)


def test_a_pads_own_theta_counts_from_the_objects_turn_at_which_it_was_anchored() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.2], [0.0, 0.0, 0.3]])
    touching = np.array([[True, True, False], [True, True, True], [False, False, True]])
    own = np.full((3, 3, 2), np.nan)
    own[:, 2] = [[np.nan, np.nan], [0.05, 1e-6], [0.15, 1e-6]]
    rows = followed(seen(poses), touching=touching, own_turn=own)
    np.testing.assert_allclose(rows["pose"][1:, 2], [0.2, 0.3], atol=1e-9)


def test_a_contact_that_lifts_and_returns_is_anchored_again() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.1], [0.02, 0.0, 0.2], [0.03, 0.0, 0.3]])
    places = seen(poses)
    places[2:, 2] = seen(poses, POINTS + 0.02)[2:, 2]  # it touches another point of the object
    touching = np.array([[True, True, True], [True, True, False], [True, True, True], [True, True, True]])
    np.testing.assert_allclose(followed(places, touching=touching)["pose"], poses, atol=1e-9)


@pytest.mark.parametrize("turning", [0.0, 0.02])
def test_contacts_that_follow_one_another_inherit_the_error_of_the_pose(turning: float) -> None:
    random, scans = np.random.default_rng(0), 24
    poses = np.linspace(0.0, 1.0, scans)[:, np.newaxis] * [0.01, -0.02, turning * scans]
    points = np.vstack([POINTS, [[0.05, 0.04]]])
    touching = np.array([[(scan // 2 + pad) % 4 != 0 for pad in range(4)] for scan in range(scans)])
    nees = []
    for _ in range(100):
        rows = followed(seen(poses, points) + random.normal(0, STD_M, (scans, 4, 2)), touching=touching)
        error = rows["pose"][-1] - poses[-1]
        nees.append(error @ np.linalg.solve(rows["pose_covariance"][-1], error) / 3)
    assert 0.8 < np.mean(nees) < 1.25


def test_a_turn_that_was_never_seen_is_not_inherited() -> None:
    touching = np.array([[True, False, False]] * 3 + [[True, True, True]] * 3)
    rows = followed(seen(np.zeros((6, 3))), touching=touching)
    J = np.concatenate([np.array([[1.0, 0.0, -y], [0.0, 1.0, x]]) for x, y in POINTS])
    alone = 2 * STD_M**2 * np.linalg.inv(J.T @ J)
    assert np.isnan(rows["pose"][3, 2])
    assert alone[2, 2] < rows["pose_covariance"][-1, 2, 2] < 4 * alone[2, 2]


def lapse(turn: float, *, kept: bool) -> tuple[Records, Floats]:
    """An object that turns while one pad of three touches, or while the others' places are unknown: rows and poses."""
    turns = np.array([0.0, 0.1, 0.1, 0.1 + turn / 2, 0.1 + turn, 0.1 + turn, 0.1 + turn])
    poses = np.stack([0 * turns, 0 * turns, turns], axis=1)
    alone = np.zeros((7, 3), np.bool_)
    alone[2:5, 1:] = True
    rows, nothing, flags = unknown(Row, 7), np.full((7, 3, 2), np.nan), np.ones((7, 3), np.bool_)
    here = Carried(seen(poses), nothing, nothing, nothing, flags, ~alone, flags if kept else ~alone)
    covariance = np.tile(STD_M**2 * np.eye(2), (7, 3, 1, 1))
    follow_pose(here, covariance, True, records(Anchor, 3), records(Body, 1), records(Equations, 1), rows)
    return rows, poses


@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_a_turn_that_goes_on_while_one_pad_touches_is_unknown_afterwards(turn: float) -> None:
    rows, poses = lapse(turn, kept=False)
    assert rows["pose"][1, 2] == pytest.approx(poses[1, 2], abs=1e-9)
    assert np.isnan(rows["pose"][2:, 2]).all()
    assert np.isfinite(rows["pose"][:, :2]).all()


def test_contacts_that_stay_on_the_object_show_the_turn_that_went_on_unseen() -> None:
    rows, poses = lapse(0.3, kept=True)
    np.testing.assert_allclose(rows["pose"][5:], poses[5:], atol=1e-9)
    assert np.isnan(rows["pose"][2:5, 2]).all()
    assert rows["pose_covariance"][5, 2, 2] == pytest.approx(rows["pose_covariance"][1, 2, 2], rel=0.01)


def test_everything_is_forgotten_while_nothing_touches() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.1], [0.0, 0.0, 0.0], [0.02, 0.0, 0.2], [0.03, 0.01, 0.3]])
    touching = np.ones((5, 3), np.bool_)
    touching[2] = False
    rows = followed(seen(poses), touching=touching)
    assert np.isnan(rows["pose"][2]).all()
    assert (rows["pose"][3] == 0.0).all()
    assert rows["pose"][4, 2] == pytest.approx(0.1, abs=1e-9)


def test_a_contact_that_is_far_off_counts_less_and_widens_the_covariance() -> None:
    places = seen(np.zeros((40, 3)), np.vstack([POINTS, POINTS + 0.01]))
    exact = followed(places)
    places[1:, 0] += 100 * STD_M
    off = followed(places)
    assert np.abs(off["pose"][1:, :2]).max() < 0.5 * 100 * STD_M / 6
    assert off["pose_covariance"][-1, 0, 0] > exact["pose_covariance"][-1, 0, 0]


def test_contacts_without_a_place_give_no_pose() -> None:
    anchors, rows, nothing = records(Anchor, 3), unknown(Row, 2), np.full((2, 3, 2), np.nan)
    touching = np.ones((2, 3), np.bool_)
    here = Carried(nothing, nothing, nothing, nothing, ~touching, ~touching, touching)
    covariance = np.full((2, 3, 2, 2), np.nan)
    follow_pose(here, covariance, True, anchors, records(Body, 1), records(Equations, 1), rows)
    assert np.isnan(rows["pose"]).all()
    assert np.isnan(rows["pose_covariance"]).all()
