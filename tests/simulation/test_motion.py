from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from taxelflow.simulation.motion import move
from taxelflow.simulation.parameters import Motion

STICK_SLIP = Motion("stick-slip", travel_m=0.02, middle_m=(0.01, -0.02), rest_s=0.5, turn_rad_s=0.5)
seeds = st.integers(0, 1000)


def test_strokes_go_to_and_fro_between_rests() -> None:
    motion = Motion(speed_m_s=0.02, travel_m=0.04, direction_rad=0.0, rest_s=1.0, middle_m=(0.0, 0.0))
    path = move(motion, np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 5.5]))
    np.testing.assert_allclose(path.pose[:, 0], [-0.02, -0.02, 0.0, 0.02, 0.0, -0.02, -0.02], atol=1e-15)
    np.testing.assert_array_equal(path.slipping, [False, False, True, True, True, False, False])
    np.testing.assert_allclose(path.travelled_m, [0.0, 0.0, 0.02, 0.04, 0.06, 0.08, 0.08])


def test_one_stroke_is_a_pull() -> None:
    path = move(Motion(strokes=1, direction_rad=0.0, travel_m=0.1, rest_s=0.0), np.array([0.0, 4.0, 9.0]))
    np.testing.assert_allclose(path.pose[:, 0], [-0.05, 0.05, 0.05])


@given(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-2.0, 2.0))
def test_turning_about_a_centre_keeps_the_distance_from_it(x: float, y: float, rate: float) -> None:
    motion = Motion(travel_m=0.0, turn_rad_s=rate, centre_m=(x, y), middle_m=(0.02, 0.01), angle_rad=0.3)
    pose = move(motion, np.linspace(0.0, motion.duration_s, 50)).pose
    arms = pose[:, :2] - [x, y]
    np.testing.assert_allclose(np.hypot(*arms.T), np.hypot(0.02 - x, 0.01 - y), atol=1e-12)
    turned = pose[:, 2] - 0.3
    expected = np.stack([np.cos(turned), -np.sin(turned)], 1) * arms[0]
    np.testing.assert_allclose(arms[:, 0], expected.sum(axis=1), atol=1e-12)


def test_the_centre_slides_along() -> None:
    sliding = Motion(travel_m=0.04, turn_rad_s=0.5, centre_m=(0.0, 0.0), middle_m=(0.03, 0.0))
    t_s = np.linspace(0.0, sliding.duration_s, 50)
    alone = Motion(travel_m=0.04, middle_m=(0.0, 0.0))
    centre = move(alone, t_s).pose[:, :2]
    np.testing.assert_allclose(np.hypot(*(move(sliding, t_s).pose[:, :2] - centre).T), 0.03)


@given(seeds)
@example(20)
@example(180)
def test_slipping_is_true_where_and_only_where_the_pose_moves(seed: int) -> None:
    t_s = np.arange(0.0, STICK_SLIP.duration_s, 1e-3)
    path = move(STICK_SLIP, t_s, seed)
    moves = np.abs(np.diff(path.pose, axis=0)).max(axis=1) > 1e-15  # rounding alone moves a turned place
    inside = path.slipping[1:] == path.slipping[:-1]  # a step across a change holds some of both
    end_s = STICK_SLIP.rest_s + STICK_SLIP.stick_slip_s
    inside[np.searchsorted(t_s, end_s) - 1] = False  # the last slip is cut there, and may be shorter than a step
    np.testing.assert_array_equal(moves[inside], path.slipping[1:][inside])
    speed = np.hypot(*np.diff(path.pose[:, :2], axis=0).T) / 1e-3
    within = moves & path.slipping[1:] & path.slipping[:-1]
    assert speed[within].min() > 0.003 * (1 - 1e-9)
    assert speed[within].max() < 0.015 * (1 + 1e-9)


@given(seeds)
def test_stick_and_slip_take_turns_and_stay_near_the_middle(seed: int) -> None:
    t_s = np.arange(0.0, STICK_SLIP.duration_s, 1e-3)
    path = move(STICK_SLIP, t_s, seed)
    assert np.hypot(*(path.pose[:, :2] - STICK_SLIP.middle_m).T).max() <= 0.01 + 1e-12
    changes = np.flatnonzero(np.diff(path.slipping))
    lasts_s = np.array([1e-3 * (after - before) for before, after in pairwise(changes)])
    assert lasts_s[:-1].min() > 0.15 - 2e-3
    assert lasts_s.max() < 0.4 + 2e-3
    assert not path.slipping[(t_s < 0.5) | (t_s > 10.5)].any()


def test_stick_and_slip_are_the_seeds() -> None:
    t_s = np.linspace(0.0, STICK_SLIP.duration_s, 100)
    np.testing.assert_array_equal(move(STICK_SLIP, t_s, 4).pose, move(STICK_SLIP, t_s, 4).pose)
    assert np.abs(move(STICK_SLIP, t_s, 5).pose - move(STICK_SLIP, t_s, 4).pose).max() > 1e-4


@pytest.mark.parametrize("motion", [STICK_SLIP, Motion(), Motion(travel_m=0.0, turn_rad_s=1.0, centre_m=(0.1, 0.0))])
def test_times_may_have_any_shape(motion: Motion) -> None:
    t_s = np.linspace(0.0, motion.duration_s, 60)
    flat, folded = move(motion, t_s, 1, 0.01), move(motion, t_s.reshape(20, 3), 1, 0.01)
    np.testing.assert_array_equal(folded.pose, flat.pose.reshape(20, 3, 3))
    np.testing.assert_array_equal(folded.slipping, flat.slipping.reshape(20, 3))
    np.testing.assert_array_equal(folded.travelled_m, flat.travelled_m.reshape(20, 3))
    assert (np.diff(flat.travelled_m) >= -1e-15).all()
