from __future__ import annotations

import numpy as np
import pytest

from taxelflow.estimation.smoothing.filter import STATES, Memory, Smoothed, run_filter, run_smoother
from taxelflow.messages import Floats
from taxelflow.numerics.records import Records, records

TAU = np.array([0.0, 0.01, 0.03, 0.035, 0.06, 0.07])
DENSITY = np.array([1e-4, 2e-4, 1e-1])
NOISE = np.diag([1e-8, 4e-8, 1e-4])
START = np.diag([*np.diagonal(NOISE), 1.0, 1.0, 100.0**2])
"""Of a track's first state: the pose's noise, and the prior of velocities."""


def rows_of(pose: Floats, *, smooth: bool) -> Records:
    rows, touched = records(Smoothed, len(pose)), np.ones(len(pose), np.bool_)
    for name in ("state", "covariance", "before", "before_covariance", "moved_covariance", "span_s"):
        rows[name] = np.nan
    run_filter(TAU, pose, np.tile(NOISE, (len(pose), 1, 1)), touched, DENSITY, records(Memory, 1), rows)
    if smooth:
        run_smoother(TAU, DENSITY, rows)
    return rows


def jointly(pose: Floats) -> tuple[Floats, Floats]:
    """States (n, 6) of all poses at once, by dense least squares, and their joint covariance (6 n, 6 n)."""
    count = len(pose)
    information, right = np.zeros((6 * count, 6 * count)), np.zeros(6 * count)
    information[:6, :6] = np.linalg.inv(START)
    right[:3] = np.linalg.solve(NOISE, pose[0])
    for k in range(1, count):
        here, dt = slice(6 * k, 6 * k + 3), TAU[k] - TAU[k - 1]
        information[here, here] += np.linalg.inv(NOISE)
        right[here] += np.linalg.solve(NOISE, pose[k])
        F, Q = np.eye(6), np.zeros((6, 6))
        for a in range(3):
            F[a, a + 3] = dt
            axes = np.ix_([a, a + 3], [a, a + 3])
            Q[axes] = DENSITY[a] * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        both = slice(6 * (k - 1), 6 * (k + 1))
        J = np.concatenate([-F, np.eye(6)], axis=1)
        information[both, both] += J.T @ np.linalg.solve(Q, J)
    covariance = np.linalg.inv(information)
    return (covariance @ right).reshape(count, 6), covariance


def drawn() -> Floats:
    poses: Floats = np.cumsum(np.random.default_rng(0).normal(0, [1e-4, 1e-4, 1e-2], (len(TAU), 3)), axis=0)
    return poses


def test_the_smoother_is_the_least_squares_fit_of_all_poses() -> None:
    pose = drawn()
    rows = rows_of(pose, smooth=True)
    states, covariance = jointly(pose)
    std = np.sqrt(np.diagonal(covariance)).reshape(-1, STATES)
    np.testing.assert_allclose(rows["state"] / std, states / std, atol=1e-4)
    for k in range(len(TAU)):
        own = slice(6 * k, 6 * k + 6)
        scale = np.outer(std[k], std[k])
        np.testing.assert_allclose(rows["covariance"][k] / scale, covariance[own, own] / scale, atol=1e-4)


def test_the_covariance_of_a_smoothed_displacement_is_that_of_the_difference_of_its_poses() -> None:
    rows, (_, covariance) = rows_of(drawn(), smooth=True), jointly(drawn())
    for k in range(1, len(TAU)):
        D = np.zeros((3, 6 * len(TAU)))
        D[:, 6 * k : 6 * k + 3], D[:, 6 * k - 6 : 6 * k - 3] = np.eye(3), -np.eye(3)
        expected = D @ covariance @ D.T
        np.testing.assert_allclose(rows["moved_covariance"][k], expected, atol=1e-4 * np.abs(expected).max())


def test_the_filter_is_the_fit_of_the_poses_so_far() -> None:
    pose = drawn()
    rows = rows_of(pose, smooth=False)
    for k in (1, 3, 5):
        states, _ = jointly(pose[: k + 1])
        np.testing.assert_allclose(rows["state"][k, :3], states[-1, :3], rtol=1e-4, atol=1e-9)
        np.testing.assert_allclose(rows["before"][k, :3], states[-2, :3], rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(rows["span_s"][1:], np.diff(TAU))
    assert rows["begins"].tolist() == [True] + [False] * 5


def test_a_pose_without_theta_measures_x_and_y() -> None:
    pose = drawn()
    pose[3, 2] = np.nan
    rows = rows_of(pose, smooth=False)
    assert np.isfinite(rows["state"]).all()
    assert rows["covariance"][3, 2, 2] > rows["covariance"][2, 2, 2]
    assert rows["covariance"][3, 0, 0] == pytest.approx(rows_of(drawn(), smooth=False)["covariance"][3, 0, 0])
