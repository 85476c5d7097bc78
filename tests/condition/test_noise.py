from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from synthetic import dome, grid_sensor
from taxelflow.condition import noise
from taxelflow.condition.resting import near_taxels
from taxelflow.condition.sample import WINDOWS

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
    drawn: Floats = 20e3 + np.random.default_rng(seed).normal(0, sigma, (windows, WINDOWS.scans, taxels))
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
    ramp = np.linspace(0, 50e3, 100 * WINDOWS.scans).reshape(100, WINDOWS.scans, 1)
    assert np.median(estimate_noise(normal(100) + ramp, LIVE)) == pytest.approx(100, rel=0.15)


def test_an_object_that_moves_most_of_the_time_does_not_inflate_the_noise() -> None:
    windows = normal(200)
    moving = 10e3 * np.sin(np.arange(WINDOWS.scans) * 1.3)[:, np.newaxis]
    windows[:140] += moving
    found = estimate_noise(windows, LIVE)
    assert 100 * 0.85 < np.median(found) < 100 * 1.6


def test_taxels_clipped_to_zero_have_a_floor_and_no_zero_noise() -> None:
    windows = np.zeros((50, WINDOWS.scans, 20))
    windows[:, :, 0] = np.round(np.random.default_rng(0).uniform(0, 3000, (50, WINDOWS.scans)))
    found = estimate_noise(windows, LIVE)
    assert (found >= 1 / 12**0.5).all()


def test_noise_half_hidden_by_clipping_is_learned_under_load() -> None:
    random = np.random.default_rng(0)
    load = np.where(np.arange(200) < 120, 0.0, 2000.0)[:, np.newaxis, np.newaxis]
    windows = np.maximum(np.round(load + random.normal(0, 5, (200, WINDOWS.scans, 20))), 0)
    np.testing.assert_allclose(estimate_noise(windows, LIVE), 5, rtol=0.3)


def test_a_level_that_wanders_is_no_noise() -> None:
    """Of the variance of what an idle taxel reads a third is independent from scan to scan."""
    scans, random = np.arange(10 * WINDOWS.scans), np.random.default_rng(2)
    wander = 10.0 * np.sin(2 * np.pi * (scans[:, np.newaxis] / 60 + random.random(20)))
    idle = np.round(1000.0 + wander + random.normal(0, 5.0, wander.shape))
    found = estimate_noise(idle.reshape(10, WINDOWS.scans, 20), LIVE)
    assert np.median(found) == pytest.approx(5.0, rel=0.15)


def test_noise_may_last_a_scan_or_two() -> None:
    """More than half of the variance is independent: it is noise, of which second differences alone show half."""
    random = np.random.default_rng(0)
    drawn = random.normal(0, 5.0, (10 * WINDOWS.scans, 20))
    for scan in range(1, len(drawn)):
        drawn[scan] = 0.42 * drawn[scan - 1] + np.sqrt(1 - 0.42**2) * drawn[scan]
    idle = np.round(1000.0 + drawn).reshape(10, WINDOWS.scans, 20)
    assert np.median(estimate_noise(idle, LIVE)) == pytest.approx(5.0, rel=0.2)


@pytest.mark.parametrize("step", [1.0, 13.0, 0.25])
def test_readings_coarser_than_the_noise_have_the_quantisation_as_floor(step: float) -> None:
    ramp = np.arange(50 * WINDOWS.scans).reshape(50, WINDOWS.scans, 1) * step * 0.3
    windows = step * np.round((ramp + np.zeros(20)) / step)
    assert (estimate_noise(windows, LIVE) >= step / 12**0.5 - 1e-12).all()


def test_constant_readings_still_have_a_noise() -> None:
    assert (estimate_noise(np.full((10, WINDOWS.scans, 20), 300.0), LIVE) > 0).all()
    assert (estimate_noise(np.zeros((10, WINDOWS.scans, 20)), LIVE) > 0).all()


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
    assert estimate_noise(np.zeros((0, WINDOWS.scans, 20)), LIVE).shape == (20,)
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


# Recordings without idle scans

GRID = grid_sensor(6, 6)
PADS = np.zeros(36, dtype=np.int64)
UNMASKED = np.zeros(36, dtype=np.bool_)


def of_grid(readings: Floats, windows: int = 2) -> Floats:
    shaped = readings[: windows * WINDOWS.scans].reshape(windows, WINDOWS.scans, 36)
    return noise.estimate_noise(shaped, UNMASKED, PADS, near_taxels(GRID.layout))


def passing(scans: int, per_scan_m: float) -> Floats:
    """(scans, 36) of a contact that moves all the time, back and forth."""
    x = 0.02 * np.sin(np.arange(scans) * per_scan_m / 0.02)
    return np.array([dome(GRID, place, radius_m=0.007) for place in x])


@pytest.mark.parametrize("offset", [0.0, 2000.0])
@pytest.mark.parametrize("per_scan_m", [0.0036, 0.0072])
@pytest.mark.parametrize("sigma", [250.0, 750.0, 2000.0])
def test_an_object_that_moves_in_all_of_24_scans_is_no_noise(sigma: float, per_scan_m: float, offset: float) -> None:
    drawn = np.random.default_rng(0).normal(0, sigma, (24, 36))
    readings = 137.0 * np.round(np.maximum(passing(24, per_scan_m) + offset + drawn, 0) / 137.0)
    assert np.median(of_grid(readings)) == pytest.approx(sigma, rel=0.25)


def test_light_loads_that_come_and_go_on_a_clipped_sensor_are_no_noise() -> None:
    """It reads exactly 0 while idle, and a load of a few hundred shows a noise of 4."""
    random = np.random.default_rng(0)
    held = np.repeat(random.uniform(0, 400, (8, 36)) * (random.random((8, 36)) < 0.3), 24, axis=0)
    readings = np.where(held > 0, np.round(np.maximum(held + random.normal(0, 4, held.shape), 0)), 0.0)
    assert np.median(of_grid(readings, 16)) == pytest.approx(4.0, rel=0.3)


def test_scans_that_a_logger_repeats_do_not_make_the_noise_small() -> None:
    drawn = np.round(20e3 + np.random.default_rng(0).normal(0, 30, (40, 36)))
    assert np.median(of_grid(np.repeat(drawn, 3, axis=0), 10)) == pytest.approx(30.0, rel=0.2)


def test_a_taxel_that_shows_nothing_has_the_noise_of_its_pad() -> None:
    readings = 20e3 + np.random.default_rng(0).normal(0, 100, (240, 36))
    readings[:, 7] = np.where(np.arange(240) < 237, np.nan, 20e3)
    found = of_grid(readings, 20)
    assert found[7] == pytest.approx(np.median(found), rel=0.1)


def test_a_noisy_taxel_keeps_its_own() -> None:
    drawn = np.random.default_rng(0).normal(0, 100, (240, 36))
    drawn[:, 7] *= 10
    found = of_grid(20e3 + drawn, 20)
    assert found[7] == pytest.approx(1000, rel=0.25)
    assert np.delete(found, 7) == pytest.approx(np.full(35, 100.0), rel=0.25)


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1.0, 1e3])
def test_the_noise_of_one_idle_window_has_no_unit(unit: float) -> None:
    """A stream learns it from 12 scans, of volts as of pascals."""
    readings = np.random.default_rng(0).normal(0, 0.1, (WINDOWS.scans, 36))
    assert np.median(of_grid(unit * readings, 1)) == pytest.approx(0.1 * unit, rel=0.15)


@pytest.mark.parametrize("step", [1e-3, 0.1, 7.0])
@pytest.mark.parametrize("level", [0.0, 50.0])
def test_the_step_of_a_converter_is_known_from_idle_readings_of_few_levels(step: float, level: float) -> None:
    drawn = np.random.default_rng(0).normal(0, 1.0, (WINDOWS.scans, 36))
    found = of_grid(step * np.round(level + drawn), 1)
    assert np.median(found) == pytest.approx(step, rel=0.2)


def test_an_image_of_few_values_has_no_step() -> None:
    readings = np.zeros((2 * WINDOWS.scans, 36))
    for scan, row in enumerate(readings):
        row[scan : scan + 6] = 1000.0
    assert np.median(of_grid(readings, 2)) < 10


def test_the_noise_of_a_taxel_does_not_depend_on_the_order_of_taxels() -> None:
    """There are too many to search all: which of them are chosen must not depend on their numbers."""
    taxels, random = 400, np.random.default_rng(3)
    sigma = np.exp(random.normal(np.log(50.0), 0.25, taxels))
    windows = 1000.0 + sigma * random.standard_normal((8, WINDOWS.scans, taxels))
    masked = np.zeros(taxels, dtype=np.bool_)
    found, mirrored = estimate_noise(windows, masked), estimate_noise(windows[..., ::-1], masked)[::-1]
    np.testing.assert_allclose(mirrored, found, rtol=1e-3)
