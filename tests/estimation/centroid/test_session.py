from __future__ import annotations

import numpy as np
import pytest

from synthetic import dome, grid_sensor, scans_of
from taxelflow.estimation.centroid.session import pad_gains
from taxelflow.runtime import registry

PALM = grid_sensor(4, 7)
METHODS = ("lnorm", "convolution", "sum", "principal_axis")


@pytest.mark.parametrize("method", METHODS)
def test_covariances_are_symmetric_and_sessions_keep_nothing_back(method: str) -> None:
    session = registry.find("estimator", method)().start(PALM.layout, "stream")
    slips = session.step(scans_of(PALM, [dome(PALM, x, 0.5 * x) for x in (0.0, 0.004, 0.009)], noise=100.0))
    for matrix in (slips.covariance, slips.displacement_covariance):
        np.testing.assert_array_equal(matrix, matrix.swapaxes(2, 3))
    assert len(slips) == 3
    assert len(session.finish()) == 0


def test_noise_that_changes_changes_the_covariance() -> None:
    session = registry.find("estimator", "convolution")().start(PALM.layout, "stream")
    quiet, loud = (
        session.step(scans_of(PALM, [dome(PALM) + 1.0] * 3, noise=noise)).covariance[2, 0, 0, 0]
        for noise in (1.0, 10.0)
    )
    assert loud == pytest.approx(100.0 * quiet)


def test_gains_are_one_factor_times_those_of_a_calibration() -> None:
    layout = grid_sensor(4, 7, pads=2).layout
    assert pad_gains(layout, 2.0, None).tolist() == [[2.0, 2.0], [2.0, 2.0]]
    assert pad_gains(layout, 2.0, np.array([[1.0, 0.5], [3.0, 1.0]])).tolist() == [[2.0, 1.0], [6.0, 2.0]]
