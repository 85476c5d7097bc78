from __future__ import annotations

import numpy as np
import pytest

from taxelflow.acquire.trajectory import Trajectory
from taxelflow.evaluation.robot_path import robot_path
from taxelflow.messages import Floats

SCAN_S = 0.02


def circle(t_s: Floats) -> Floats:
    return 0.004 * np.stack([np.sin(1.95 * t_s), np.cos(1.95 * t_s)], axis=1)


def slope(way: object, t_s: Floats) -> Floats:
    return np.diff(way(t_s), axis=0) / np.diff(t_s)[:, np.newaxis]  # type: ignore[operator, no-any-return]


def test_a_log_without_noise_is_kept() -> None:
    t_s, between = np.arange(0, 20, 0.01), np.linspace(0, 19.9, 3001)
    path = robot_path(Trajectory(t_s, circle(t_s)), SCAN_S)
    np.testing.assert_allclose(path.at(t_s), circle(t_s), atol=1e-12)
    np.testing.assert_allclose(path.at(between), circle(between), atol=1e-7)
    assert path.doubt(between).max() < 1e-6


@pytest.mark.parametrize("jitter_s", [0.0, 0.002])
def test_the_slope_is_that_of_the_motion_not_of_the_noise(jitter_s: float) -> None:
    random = np.random.default_rng(0)
    t_s = np.arange(0, 20, 0.005)
    t_s = t_s + random.uniform(-jitter_s, jitter_s, len(t_s))
    noisy = circle(t_s) + random.normal(0, 3e-4, (len(t_s), 2))
    path, fine = robot_path(Trajectory(t_s, noisy), SCAN_S), np.arange(1, 19, 0.001)
    assert np.std(path.at(fine) - circle(fine)) < 6e-5
    assert np.std(slope(path.at, fine) - slope(circle, fine)) < 0.15 * 0.0078  # of the speed; lines: 10 times it


def test_samples_that_are_far_apart_leave_a_doubt_that_holds_the_error() -> None:
    t_s, between = np.arange(0.0, 20.0), np.linspace(2, 17, 301)
    path = robot_path(Trajectory(t_s, circle(t_s)), SCAN_S)
    assert np.abs(path.at(between) - circle(between)).max() < 4e-4  # lines: 0.0017
    assert np.mean(path.doubt(between)) > np.mean(np.abs(path.at(between) - circle(between)))


def test_nothing_swings_over_a_gap() -> None:
    def start(t_s: Floats) -> Floats:
        return 0.01 * np.stack([np.maximum(t_s - 20.0, 0.0)] * 2, axis=1)

    t_s = np.arange(0, 30, 0.02)
    t_s = t_s[(t_s < 10) | (t_s > 20)]
    everywhere = np.linspace(0, 29.9, 9999)
    path = robot_path(Trajectory(t_s, start(t_s)), SCAN_S)
    assert np.abs(path.at(everywhere) - start(everywhere)).max() < 3e-4


def test_samples_at_nearly_the_same_time_count_as_one() -> None:
    t_s = np.unique(np.concatenate([np.arange(0, 20, 0.02), np.arange(0, 20, 0.02) + 1e-9]))
    noisy = circle(t_s) + np.random.default_rng(0).normal(0, 1e-4, (len(t_s), 2))
    path, fine = robot_path(Trajectory(t_s, noisy), SCAN_S), np.arange(0, 19.9, 0.001)
    assert np.abs(path.at(fine) - circle(fine)).max() < 2e-4


def test_few_samples_are_joined_by_lines_and_the_ends_hold() -> None:
    path = robot_path(Trajectory(np.array([0.0, 1.0, 3.0]), np.array([[0.0, 0.0], [1.0, 2.0], [1.0, 0.0]])), SCAN_S)
    np.testing.assert_allclose(
        path.at(np.array([-1.0, 0.5, 2.0, 9.0])), np.array([[0.0, 0.0], [0.5, 1.0], [1.0, 1.0], [1.0, 0.0]])
    )
    assert path.t_s.tolist() == [0.0, 3.0]


def test_a_robot_at_rest_stays_there() -> None:
    t_s = np.arange(0, 5, 0.02)
    path = robot_path(Trajectory(t_s, np.full((len(t_s), 2), 0.3)), SCAN_S)
    np.testing.assert_allclose(path.at(np.linspace(0, 5, 77)), 0.3)
