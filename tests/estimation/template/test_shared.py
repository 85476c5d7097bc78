"""Of the covariance of a batch's poses, consecutive scans share what the sensor's unseen error adds."""

from __future__ import annotations

import numpy as np

from synthetic import dome, grid_sensor, recorded
from taxelflow.pipeline import api


def test_a_steps_noise_holds_no_unseen_error_that_its_poses_hold() -> None:
    sensor = grid_sensor(10, 10, pitch_m=(0.003, 0.003), unseen_error=0.05)
    x_m = np.concatenate([np.zeros(40), np.linspace(0, 0.006, 60), np.full(40, 0.006)])
    touched = [dome(sensor, x, radius_m=0.004) + 0.6 * dome(sensor, x + 0.006, 0.004, radius_m=0.002) for x in x_m]
    values = np.concatenate([np.zeros((30, 100)), np.array(touched)])
    values += np.random.default_rng(0).normal(0, 100, values.shape)
    slips = api.estimate(recorded(values, sensor, np.arange(len(values)) / 50.0), "template").slips
    known = slips.contact[:, 0] & np.isfinite(slips.displacement[:, 0, 0])
    pose, step = slips.covariance[known, 0, 0, 0], slips.displacement_covariance[known, 0, 0, 0] / 2
    scatter = np.var(slips.displacement[known, 0, 0][:35]) / 2
    assert (step < pose).all()
    assert np.median(step) < np.median(pose) / 4
    assert np.median(step) > scatter
