from __future__ import annotations

import numpy as np
import pytest

from synthetic import dome, grid_sensor
from taxelflow.estimation.centroid.convolution_kernel import Memory, convolution_flow, noise_sums, weighted_sums
from taxelflow.estimation.centroid.records import Row, ScanBlock, pads_of
from taxelflow.messages import Floats
from taxelflow.numerics.records import Records, records, unknown

PITCH = (0.01, 0.006)
PALM = grid_sensor(4, 7, pitch_m=PITCH)
WIDE = grid_sensor(5, 17, pitch_m=PITCH)


def rows_of(
    values: Floats, *, noise: float | Floats = 1.0, gains: tuple[float, float] = (1.0, 1.0), usable: object = True
) -> Records:
    """Rows (scans,) that the kernel fills for scans (scans, taxels) of the palm, one second apart."""
    layout = PALM.layout
    flags = np.broadcast_to(np.asarray(usable), len(values)).reshape(-1, 1)
    deviations = np.array(np.broadcast_to(noise, values.shape[1]), dtype=np.float64)
    places, pads = np.stack([layout.x_m, layout.y_m]), pads_of(layout, np.array([gains]))
    rows = unknown(Row, len(values), 1)
    sums, memory = noise_sums(deviations, places, pads), records(Memory, 1)
    t_s, always = np.arange(float(len(values))), np.ones((len(values), 1), np.bool_)
    block = ScanBlock(t_s, values, deviations, always, np.array(flags))
    convolution_flow(block, places, pads, sums, memory, rows)
    return rows[:, 0]


def propagated(image: Floats, noise: Floats) -> Floats:
    """(2, 2) covariance of one scan's centroid, by dc/dp_i = (r_i - c) / sum(p); a reading of 0 has no noise."""
    places = np.stack([PALM.layout.x_m, PALM.layout.y_m])
    centroid = places @ image / image.sum()
    slope = (places - centroid[:, np.newaxis]) / image.sum()
    covariance: Floats = (slope * np.where(image != 0.0, noise, 0.0) ** 2) @ slope.T
    return covariance


def test_the_covariance_is_that_of_the_noise_to_first_order() -> None:
    random = np.random.default_rng(0)
    image, noise = dome(PALM, 0.004, 0.003) + random.uniform(100, 1000, 28), random.uniform(50, 500, 28)
    row = rows_of(np.array([image] * 3), noise=noise)[2]
    expected = propagated(image, noise)
    found = row["pose"]
    np.testing.assert_allclose([found["var_x"], found["var_y"], found["cov_xy"]], 0.5 * expected[[0, 1, 0], [0, 1, 1]])
    moved = row["displacement"]
    np.testing.assert_allclose([moved["var_x"], moved["var_y"], moved["cov_xy"]], 0.5 * expected[[0, 1, 0], [0, 1, 1]])


def test_a_taxel_that_reads_0_has_no_noise() -> None:
    image, noise = dome(PALM, 0.004, 0.003, radius_m=0.02), np.linspace(50, 500, 28)
    image[[0, 5, 11, 27]] = 0.0
    row = rows_of(np.array([image] * 2), noise=noise)[1]
    expected = propagated(image, noise)
    np.testing.assert_allclose(row["pose"]["var_x"], 0.5 * expected[0, 0])
    np.testing.assert_allclose(row["pose"]["cov_xy"], 0.5 * expected[0, 1])


def test_the_variance_is_at_least_that_of_one_taxel_half_a_pitch_aside() -> None:
    image, noise = np.zeros(28), np.linspace(50, 500, 28)
    image[10] = 1e4
    row = rows_of(np.array([image] * 2), noise=noise)[1]
    mean = np.mean(noise**2) / 1e8
    assert row["pose"]["var_x"] == pytest.approx(0.5 * mean * 0.005**2)
    assert row["pose"]["var_y"] == pytest.approx(0.5 * mean * 0.003**2)


def test_gains_scale_their_own_axis() -> None:
    values, noise = np.array([dome(PALM, x, 0.5 * x) for x in (0.0, 0.002, 0.005)]), np.linspace(50, 500, 28)
    plain, scaled = rows_of(values, noise=noise)[2], rows_of(values, noise=noise, gains=(2.0, 0.25))[2]
    for part in ("pose", "displacement"):
        for field, factor in (("x", 2.0), ("y", 0.25), ("var_x", 4.0), ("var_y", 0.0625), ("cov_xy", 0.5)):
            np.testing.assert_allclose(scaled[part][field], factor * plain[part][field], rtol=1e-12)


def test_after_a_scan_that_is_not_usable_index_and_slip_vector_wait_as_at_the_start() -> None:
    values = np.array([dome(PALM, 1e-3 * k) for k in range(9)])
    rows = rows_of(values, usable=[True] * 4 + [False] + [True] * 4)
    assert np.isfinite(rows["pose"]["x"]).tolist() == [False, True, True, True, False, False, True, True, True]
    assert np.isfinite(rows["displacement"]["x"]).tolist() == [False, False, True, True] + [False] * 3 + [True] * 2


def test_index_and_slip_vector_are_those_of_the_last_three_centroids() -> None:
    values = np.array([dome(PALM, 1e-3 * k * k) for k in range(6)])
    centroids = values @ PALM.layout.x_m / values.sum(axis=1)
    rows = rows_of(values)
    np.testing.assert_allclose(rows["pose"]["x"][1:], (centroids[1:] + centroids[:-1]) / 2, atol=1e-15)
    np.testing.assert_allclose(rows["displacement"]["x"][2:], (centroids[2:] - centroids[:-2]) / 2, atol=1e-15)
    assert rows["lag_s"][1:].tolist() == [0.5] * 5
    assert rows["span_s"][2:].tolist() == [1.0] * 4


def test_sums_row_by_row_are_those_of_the_whole_pad() -> None:
    layout = WIDE.layout
    values = np.random.default_rng(1).uniform(1.0, 2.0, 85)
    for scan in (values, np.where(np.arange(85) == 40, 0.0, values)):
        by_rows = weighted_sums(scan, layout.x_m, layout.y_m, 17)
        np.testing.assert_allclose(by_rows, weighted_sums(scan, layout.x_m, layout.y_m, 0), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(by_rows[:3], [scan.sum(), scan @ layout.x_m, scan @ layout.y_m], atol=1e-12)
        assert by_rows[3] == (scan == 0.0).any()
