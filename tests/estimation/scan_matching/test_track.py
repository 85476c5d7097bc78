from __future__ import annotations

import numpy as np
import pytest

from compiled import compiled
from taxelflow.estimation.scan_matching.track import (
    Last,
    Track,
)
from taxelflow.estimation.scan_matching.track import (
    forget_unobservable as _forget_unobservable,
)
from taxelflow.estimation.scan_matching.track import (
    propagate as _propagate,
)
from taxelflow.estimation.scan_matching.track import (
    write_pose as _write_pose,
)
from taxelflow.estimation.scan_matching.track import (
    write_step as _write_step,
)
from taxelflow.numerics.records import records

write_pose = compiled(_write_pose)
propagate = compiled(_propagate)
write_step = compiled(_write_step)
forget_unobservable = compiled(_forget_unobservable)

UNITS = np.array([0.002, 0.002, 1.0])


def test_noise_that_a_scan_brings_into_two_steps_cancels_in_the_pose() -> None:
    random = np.random.default_rng(0)
    g, variance = random.normal(0, 1, (3, 10)), random.uniform(1, 2, 10)
    reading = np.ones(10)
    reading[4] = 0.0  # no noise
    known = variance.copy()
    known[4] = 0.0
    last = Last(reading, variance, g, np.zeros((4, 4)))
    own = (g * known) @ g.T
    earlier, track, step = random.normal(0, 1, (3, 10)), records(Track, 1)[0], np.empty((3, 3))
    propagate(own, earlier, last, track, step)
    np.testing.assert_allclose(step, own + (earlier * known) @ earlier.T)
    mixed = (g * known) @ earlier.T
    np.testing.assert_allclose(track["covariance"], 2 * own + (earlier * known) @ earlier.T - mixed - mixed.T)


def test_noise_that_cancels_to_rounding_leaves_no_variance_below_0() -> None:
    g = 1e9 * np.array([[1.0, 0.7], [0.3, -0.2], [0.1, 0.9]])
    last = Last(np.ones(2), np.array([1.0, 1.5]), g, np.zeros((4, 4)))
    track, step = records(Track, 1)[0], np.empty((3, 3))
    for _ in range(50):
        propagate(1e-6 * np.eye(3), g * (1.0 + 1e-15), last, track, step)
    assert (np.diag(track["covariance"]) >= 1e-6).all()
    assert np.array_equal(track["covariance"], track["covariance"].T)


def test_the_pose_has_an_error_of_3_percent_of_its_path() -> None:
    tracks = records(Track, 1)
    tracks["pose"][0], tracks["path"][0] = [5.0, 6.0, 0.5], [10.0, 0.0, 0.5]
    tracks["covariance"][0] = np.diag([0.01, 0.02, 0.03])
    pose, matrix = np.empty(3), np.empty((3, 3))
    write_pose(tracks[0], True, UNITS, pose, matrix, np.empty((3, 3)))
    np.testing.assert_allclose(pose, [0.01, 0.012, 0.5])
    path = np.array([10.0, 0.0, 0.5]) * UNITS
    np.testing.assert_allclose(matrix, np.diag([0.01, 0.02, 0.03] * UNITS**2) + 0.03**2 * np.outer(path, path))
    write_pose(tracks[0], False, UNITS, pose, matrix, np.empty((3, 3)))
    assert np.isnan(pose[2])
    assert np.isnan(matrix[2]).all()
    assert np.isfinite(matrix[:2, :2]).all()


def test_what_errors_of_taxels_hide_grows_with_the_path_and_returns_with_it() -> None:
    track = records(Track, 1)
    matrix = np.empty((3, 3))
    for step, variance in ((2.0, 4.0), (-2.0, 0.0)):
        track["hidden"][0, 0] += step
        write_pose(track[0], True, UNITS, np.empty(3), np.empty((3, 3)), matrix)
        assert matrix[0, 0] == pytest.approx(variance * UNITS[0] ** 2)
    track["drift"][0] = np.eye(3)
    write_pose(track[0], True, UNITS, np.empty(3), np.empty((3, 3)), matrix)
    np.testing.assert_allclose(np.diag(matrix), UNITS**2)


def test_a_step_is_brought_to_metres_and_has_no_turn_if_that_is_not_observable() -> None:
    displacement, matrix = np.empty(3), np.ones((3, 3))
    write_step(np.array([1.0, 2.0, 0.1, 1.0, 0.0]), True, UNITS, displacement, matrix)
    np.testing.assert_allclose(displacement, [0.002, 0.004, 0.1])
    np.testing.assert_allclose(matrix, np.outer(UNITS, UNITS))
    write_step(np.array([1.0, 2.0, 0.1, 1.0, 0.0]), False, UNITS, displacement, matrix)
    assert np.isnan(displacement[2])
    assert np.isnan(matrix[:, 2]).all()


def test_across_a_line_of_taxels_the_object_may_be_anywhere_on_the_pad() -> None:
    own, pose, step = np.ones((3, 3)), np.ones((3, 3)), np.ones((3, 3))
    forget_unobservable(np.array([0.0, 12.0]), False, UNITS, own, pose, step)
    assert (own[0, 0], own[1, 1]) == (1.0, 144.0)
    np.testing.assert_allclose([pose[1, 1], step[1, 1]], [0.024**2, 2 * 0.024**2])
    forget_unobservable(np.array([0.0, 12.0]), True, UNITS, own, pose, step)
    assert np.isnan(step[1, 1])
