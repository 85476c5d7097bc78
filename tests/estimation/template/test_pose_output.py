from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from taxelflow.estimation.template.pose_output import Poses
from taxelflow.estimation.template.rivals import apart_by_turn, distance
from taxelflow.messages import AMBIGUOUS, OK

PITCH_M = 0.002


def test_hypotheses_that_follow_two_points_of_one_body_do_not_differ() -> None:
    theta = np.linspace(0.0, 0.6, 30)
    own = np.zeros((30, 5))
    own[:, 0], own[:, 2] = np.linspace(0.0, 3.0, 30), theta
    other = own.copy()
    other[:, :2] += np.column_stack([np.cos(theta) - 2 * np.sin(theta), np.sin(theta) + 2 * np.cos(theta)])
    assert np.abs(distance(own, other, theta)).max() < 1e-9
    other[:, 1] += np.sin(np.arange(30))
    assert 0.5 < np.abs(distance(own, other, theta)[:, 1]).max() <= 1.5


def test_one_that_turns_differs_from_one_that_does_not_by_its_angle() -> None:
    """The mean angle is a choice of the frame. Places of a body that turns about a point of both are the same."""
    turning, held = np.zeros((30, 5)), np.zeros((30, 5))
    turning[:, 2] = np.linspace(3.0, 3.6, 30)  # past half a turn
    theta = turning[:, 2].copy()
    turning[:, 2] = np.angle(np.exp(1j * theta))
    of_fits = [SimpleNamespace(states=states, turns=turns) for states, turns in ((turning, True), (held, False))]
    for best, rival in (of_fits, of_fits[::-1]):
        apart = apart_by_turn(best, rival)
        np.testing.assert_allclose(apart[:, :2], 0.0, atol=1e-9)
        np.testing.assert_allclose(apart[:, 2], theta - theta.mean(), atol=1e-9)


def test_a_rival_hypothesis_widens_the_covariance_along_its_distance() -> None:
    poses = Poses(np.zeros((3, 3)), np.tile(1e-8 * np.eye(3), (3, 1, 1)), np.full(3, OK, np.uint8))
    rival = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.3], [0.0, 1.0, 0.0]])
    doubted = poses.doubted(rival, PITCH_M)
    added = doubted.covariance - poses.covariance
    away = np.array([0.1 * PITCH_M, 0.0, 0.3])
    np.testing.assert_allclose(added[1], np.outer(away, away), rtol=1e-6)
    np.testing.assert_allclose(added[2], np.diag([0.0, PITCH_M**2, 0.0]))
    assert doubted.quality.tolist() == [OK, OK, AMBIGUOUS]
    t_s, present = np.arange(3.0), np.ones(3, np.bool_)
    np.testing.assert_allclose(doubted.steps(t_s, present)[1], poses.steps(t_s, present)[1])
    assert poses.doubted(rival[:0], PITCH_M) is poses
