from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synthetic import grid_sensor
from taxelflow.condition.resting import far_from_loads, find_rest, near_taxels

SENSOR = grid_sensor(1, 5)
NEAR = near_taxels(SENSOR.layout)


def test_neighbours_are_those_on_the_same_pad() -> None:
    near = near_taxels(grid_sensor(2, 2, pads=2).layout)
    assert [sorted({*row.tolist()} - {taxel}) for taxel, row in enumerate(near)] == [
        [1, 2],
        [0, 3],
        [0, 3],
        [1, 2],
        [5, 6],
        [4, 7],
        [4, 7],
        [5, 6],
    ]


def test_a_reading_beside_a_load_is_not_far_from_it() -> None:
    readings = np.zeros((6, 5))
    readings[2, 1] = 1000.0
    readings[4, 4] = np.inf  # saturated: loaded
    far = far_from_loads(readings, NEAR)
    assert np.flatnonzero(np.isnan(far[2])).tolist() == [0, 1, 2]
    assert np.flatnonzero(np.isnan(far[4])).tolist() == [3, 4]
    assert np.isnan(far).sum() == 5


def test_noise_is_no_load_where_there_is_none() -> None:
    readings = np.random.default_rng(0).normal(0, 1, (40, 5))
    assert np.isnan(far_from_loads(readings, NEAR)).mean() < 0.02


def test_taxels_that_are_clipped_throughout_do_not_hide_the_noise_of_the_others() -> None:
    readings = np.zeros((40, 5))
    readings[:, 1] = np.random.default_rng(0).normal(0, 1, 40)
    assert np.isnan(far_from_loads(readings, NEAR)).mean() < 0.02


@pytest.mark.parametrize("level", [0.0, 300.0, 4000.0])
def test_the_likelihood_is_largest_at_the_noise_also_where_half_is_clipped(level: float) -> None:
    random = np.random.default_rng(1)
    readings = np.maximum(level + random.normal(0, 250, (30, 40)), 0)
    loaded = random.random(readings.shape) < 0.3
    readings[loaded] += np.exp(random.uniform(np.log(250), np.log(80e3), loaded.sum()))
    grid = 250 * 1.2 ** np.arange(-10, 11)
    found = [float(find_rest(readings, sigma, 0.0, 80e3).likelihood.sum()) for sigma in grid]
    assert abs(int(np.argmax(found)) - 10) <= 1
    rest = find_rest(readings, 250.0, 0.0, 80e3)
    assert float(np.median(rest.level)) == pytest.approx(level, abs=60)
    assert rest.unloaded[~loaded].mean() > 0.85
    assert rest.unloaded[readings > level + 5 * 250].max() < 0.05


@given(st.floats(-5e3, 5e3), st.floats(0.01, 100))
def test_level_and_likelihood_follow_the_readings(shift: float, factor: float) -> None:
    readings = np.random.default_rng(2).normal(0, 10, (20, 3))
    one = find_rest(readings, 10.0, -200.0, 1e3)
    moved = find_rest(factor * (readings + shift), factor * 10.0, factor * (shift - 200.0), factor * 1e3)
    np.testing.assert_allclose(moved.level, factor * (one.level + shift), rtol=1e-6, atol=1e-6 * factor)
    np.testing.assert_allclose(moved.unloaded, one.unloaded, atol=1e-6)


def test_a_taxel_without_readings_has_no_weight() -> None:
    rest = find_rest(np.full((5, 2), np.nan), 1.0, 0.0, 10.0)
    assert not rest.unloaded.any()
    np.testing.assert_allclose(rest.likelihood, 0.0)
