from __future__ import annotations

import numpy as np

from synthetic import dome, grid_sensor, scans_of
from taxelflow.estimation.scan_matching.parameters import Registration

TWO = grid_sensor(7, 7, pads=2)


def test_pads_are_followed_independently_and_nothing_is_held_back() -> None:
    session = Registration().start(TWO.layout, "stream")
    values = np.array([dome(TWO, x, radius_m=0.015) + dome(TWO, pad=1, radius_m=0.015) for x in (0.0, 0.002, 0.005)])
    estimates = session.step(scans_of(TWO, values, noise=50.0))
    np.testing.assert_allclose(estimates.displacement[1:, :, 0], [[0.002, 0.0], [0.003, 0.0]], atol=2e-4)
    assert (estimates.lag_s == 0.0).all()
    assert len(session.finish()) == 0


def test_noise_that_changes_within_a_contact_does_not_interrupt_it() -> None:
    session = Registration().start(TWO.layout, "stream")
    first, second = (
        session.step(scans_of(TWO, [dome(TWO, x, radius_m=0.015)], noise=noise, contact=[[True, False]], t_s=[x]))
        for x, noise in ((0.0, 50.0), (0.002, 60.0))
    )
    assert np.isfinite(first.pose[0, 0, 0])
    np.testing.assert_allclose(second.displacement[0, 0, 0], 0.002, atol=2e-4)
    assert np.isnan(second.pose[0, 1]).all()


def test_only_a_sensor_that_declares_an_unseen_error_has_one_beside_the_noise() -> None:
    """Zeros would be added to the covariances of every scan."""
    for error, stated in ((0.0, False), (0.05, True)):
        sensor = grid_sensor(7, 7, unseen_error=error)
        estimates = (
            Registration()
            .start(sensor.layout, "stream")
            .step(scans_of(sensor, [dome(sensor, radius_m=0.015)], noise=50.0))
        )
        assert (estimates.unseen is not None) is stated
