"""What a stream reports when its map is learned again: the point of the object, and what a step adds to covariances."""

import numpy as np
import pytest

from taxelflow.estimation.template.online.output import _add_step
from taxelflow.estimation.template.online.track_state import Track
from taxelflow.estimation.template.online.witness import put_on_average, reported_place
from taxelflow.numerics.records import record, records


def track() -> Track:
    m = record(Track, records(Track, 1), 0)
    m.state[:] = [1.0, 2.0, 0.5, 1.0, 0.0]
    m.theta_0, m.arm_load = 0.2, 1.0
    return m


def test_the_point_turns_with_the_object() -> None:
    m, arm = track(), np.array([0.3, -0.1])
    put_on_average(m, arm)
    cos, sin = np.cos(0.5), np.sin(0.5)
    np.testing.assert_allclose(reported_place(m, m.state), [1 + 0.3 * cos + 0.1 * sin, 2 + 0.3 * sin - 0.1 * cos])


def test_an_object_that_was_known_before_keeps_its_point() -> None:
    m = track()
    m.arm_load = np.inf
    before = m.arm.copy()
    put_on_average(m, np.array([0.3, -0.1]))
    np.testing.assert_array_equal(m.arm, before)


def test_an_object_on_a_line_of_taxels_keeps_its_point() -> None:
    m = track()
    m.across[:] = 3.0, 0.0
    put_on_average(m, np.array([0.3, -0.1]))
    np.testing.assert_array_equal(m.arm, 0.0)


@pytest.mark.parametrize(("share", "left"), [(0.0, 1.0), (0.5, 0.25), (1.0, 0.0)])
def test_a_step_of_the_map_counts_as_far_as_the_map_does(share: float, left: float) -> None:
    cov = np.diag([1.0, 2.0, 3.0])
    _add_step(0.1, share * np.eye(2), cov)
    np.testing.assert_allclose(cov, np.diag([1.0 + 0.1 * left, 2.0 + 0.1 * left, 3.0]))
