from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from taxelflow.condition import noise
from taxelflow.condition.noise import noise_floor
from taxelflow.condition.sample import WINDOW_SCANS

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats

LIVE = np.zeros(20, dtype=np.bool_)


def estimate_noise(windows: Floats, masked: Bools, **known: float) -> Floats:
    """Of a pad that is a line of taxels."""
    taxels = np.arange(len(masked))
    near = np.stack([np.maximum(taxels - 1, 0), np.minimum(taxels + 1, len(masked) - 1)], axis=1)
    return noise.estimate_noise(windows, masked, np.zeros_like(taxels), near, **known)


def normal(windows: int, sigma: float | Floats = 100.0, taxels: int = 20, seed: int = 0) -> Floats:
    """(windows, scans, taxels) around a load of 20 kPa."""
    drawn: Floats = 20e3 + np.random.default_rng(seed).normal(0, sigma, (windows, WINDOW_SCANS, taxels))
    return drawn


@pytest.mark.parametrize("sigma", [20.0, 100.0, 1500.0])
@pytest.mark.parametrize("windows", [1, 3, 5])
def test_normal_noise_is_recovered_from_a_few_windows_by_pooling_taxels(windows: int, sigma: float) -> None:
    found = estimate_noise(normal(windows, sigma), LIVE)
    assert np.median(found) == pytest.approx(sigma, rel=0.15)


def test_normal_noise_is_recovered_for_each_taxel_from_many_windows() -> None:
    sigma = np.linspace(50, 500, 20)
    np.testing.assert_allclose(estimate_noise(normal(300, sigma), LIVE), sigma, rtol=0.15)


def test_a_load_that_rises_steadily_is_no_noise() -> None:
    ramp = np.linspace(0, 50e3, 100 * WINDOW_SCANS).reshape(100, WINDOW_SCANS, 1)
    assert np.median(estimate_noise(normal(100) + ramp, LIVE)) == pytest.approx(100, rel=0.15)


def test_an_object_that_moves_most_of_the_time_does_not_inflate_the_noise() -> None:
    windows = normal(200)
    moving = 10e3 * np.sin(np.arange(WINDOW_SCANS) * 1.3)[:, np.newaxis]
    windows[:140] += moving
    found = estimate_noise(windows, LIVE)
    assert 100 * 0.85 < np.median(found) < 100 * 1.6


def test_taxels_clipped_to_zero_have_a_floor_and_no_zero_noise() -> None:
    windows = np.zeros((50, WINDOW_SCANS, 20))
    windows[:, :, 0] = np.round(np.random.default_rng(0).uniform(0, 3000, (50, WINDOW_SCANS)))
    found = estimate_noise(windows, LIVE)
    assert (found >= 1 / 12**0.5).all()


def test_noise_half_hidden_by_clipping_is_learned_under_load() -> None:
    random = np.random.default_rng(0)
    load = np.where(np.arange(200) < 120, 0.0, 2000.0)[:, np.newaxis, np.newaxis]
    windows = np.maximum(np.round(load + random.normal(0, 5, (200, WINDOW_SCANS, 20))), 0)
    np.testing.assert_allclose(estimate_noise(windows, LIVE), 5, rtol=0.3)


@pytest.mark.parametrize("step", [1.0, 13.0, 0.25])
def test_readings_coarser_than_the_noise_have_the_quantisation_as_floor(step: float) -> None:
    ramp = np.arange(50 * WINDOW_SCANS).reshape(50, WINDOW_SCANS, 1) * step * 0.3
    windows = step * np.round((ramp + np.zeros(20)) / step)
    assert (estimate_noise(windows, LIVE) >= step / 12**0.5 - 1e-12).all()


def test_constant_readings_still_have_a_noise() -> None:
    assert (estimate_noise(np.full((10, WINDOW_SCANS, 20), 300.0), LIVE) > 0).all()
    assert (estimate_noise(np.zeros((10, WINDOW_SCANS, 20)), LIVE) > 0).all()


def test_masked_taxels_have_none() -> None:
    masked = np.arange(20) % 3 == 0
    found = estimate_noise(normal(50), masked)
    assert (found[masked] == 0).all()
    assert (found[~masked] > 0).all()


def test_what_a_masked_taxel_reads_does_not_matter() -> None:
    masked = np.arange(20) == 4
    windows = normal(50)
    wild = windows.copy()
    wild[:, :, 4] = 1e7
    np.testing.assert_array_equal(estimate_noise(windows, masked), estimate_noise(wild, masked))


def test_no_windows_and_no_live_taxels_give_an_answer() -> None:
    assert estimate_noise(np.zeros((0, WINDOW_SCANS, 20)), LIVE).shape == (20,)
    assert not estimate_noise(normal(3), ~LIVE).any()


@pytest.mark.parametrize("missing", [np.nan, np.inf, -np.inf])
def test_missing_readings_are_left_out(missing: float) -> None:
    windows = normal(100)
    windows[::5, 3, :] = missing
    assert np.median(estimate_noise(windows, LIVE)) == pytest.approx(100, rel=0.15)


@pytest.mark.parametrize("factor", [0.25, 6894.757, 1e-3])
def test_another_unit_gives_the_same_noise_in_that_unit(factor: float) -> None:
    windows = np.round(normal(50))
    np.testing.assert_allclose(
        estimate_noise(factor * windows, LIVE), factor * estimate_noise(windows, LIVE), rtol=1e-9
    )


def test_the_floor_is_the_step_of_a_converter_over_root_twelve() -> None:
    readings = np.random.default_rng(0).integers(0, 4096, (10, 12, 30)) * 0.8
    assert noise_floor(readings) == pytest.approx(max(0.8 / 12**0.5, 1e-4 * readings.max()), rel=0.01)


def test_the_floor_of_few_distinct_values_takes_none_of_them_for_a_step() -> None:
    assert noise_floor(np.array([0.0, 1000.0, 3000.0])) < 10
