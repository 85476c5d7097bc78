from __future__ import annotations

import numpy as np
import pytest

from taxelflow.messages import Floats
from taxelflow.numerics.centroid import centroid_covariance, count_loaded, loaded_centroid, pressure_centre

PLACES = np.array([[0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 1.0, 1.0]])


def found(reading: list[float], variance: list[float] | None = None) -> Floats:
    out = np.full(4, np.nan)
    edge = np.array([True, False, False, True])
    loaded_centroid(np.array(reading), np.array(variance or [1.0] * 4), PLACES, edge, out)
    return out


def test_it_is_the_mean_place_of_the_load() -> None:
    np.testing.assert_allclose(found([0.0, 100.0, 300.0, 0.0]), [1.75, 0.75, 0.0, 400.0])


def test_the_share_at_the_border_is_that_of_the_load() -> None:
    np.testing.assert_allclose(found([100.0, 0.0, 0.0, 300.0])[2:], [1.0, 400.0])
    np.testing.assert_allclose(found([100.0, 0.0, 300.0, 0.0])[2:], [0.25, 400.0])


def test_readings_below_4_standard_deviations_or_5_percent_of_the_peak_do_not_count() -> None:
    np.testing.assert_allclose(found([3.9, 4.1, 0.0, 0.0])[[0, 3]], [1.0, 4.1])
    np.testing.assert_allclose(found([49.0, 51.0, 1000.0, 0.0])[3], 1051.0)


def test_masked_taxels_do_not_count_and_no_load_gives_zeros() -> None:
    np.testing.assert_allclose(found([100.0, 100.0, 0.0, 0.0], [0.0, 1.0, 1.0, 1.0])[[0, 3]], [1.0, 100.0])
    assert not found([-50.0, 1.0, 0.0, 3.0]).any()


def test_the_loaded_taxels_are_those_that_the_centroid_counts() -> None:
    rng = np.random.default_rng(0)
    readings = rng.normal(0.0, 1.0, (50, 4)) * rng.choice([1.0, 30.0, 500.0], (50, 4))
    variance = rng.choice([0.0, 1.0, 100.0], (50, 4))
    for reading, own in zip(readings, variance, strict=True):
        ones = [found(np.where(np.arange(4) == taxel, reading, 0.0).tolist(), own.tolist())[3] for taxel in range(4)]
        peak = reading.max(initial=0.0, where=own > 0.0)
        assert count_loaded(reading, own) == np.sum((np.array(ones) > 0.0) & (reading > 0.05 * peak))


def test_the_centre_of_pressure_counts_what_lies_next_to_the_contact_and_nothing_further() -> None:
    reading = np.array([30.0, 1000.0, 40.0, 35.0])
    out, none = np.empty(5), np.zeros(4, np.bool_)
    pressure_centre(reading, np.full(4, 100.0), in_line(4), none, out)
    np.testing.assert_allclose(out[[0, 1, 3, 4]], [(1000.0 + 80.0) / 1070.0, 0.0, 1070.0, 1.1**2])


@pytest.mark.parametrize("beside", [-1000.0, -1200.0], ids=["as much", "more"])
def test_readings_below_0_that_outweigh_the_load_leave_the_centre_where_the_load_is(beside: float) -> None:
    out, edge = np.empty(5), np.array([False, True, False, False])
    pressure_centre(np.array([0.0, 1000.0, beside, 0.0]), np.full(4, 100.0), in_line(4), edge, out)
    np.testing.assert_allclose(out, [1.0, 0.0, 1.0, 1000.0, 1.1**2])


def test_the_centre_of_pressure_of_a_dome_follows_it_where_few_taxels_are_surely_loaded() -> None:
    axis = np.arange(7.0)
    places = np.stack([part.ravel() for part in np.meshgrid(axis, axis)])
    none = np.zeros(places.shape[1], np.bool_)
    errors = []
    for x in np.linspace(2.5, 3.5, 11):
        reading = 1000.0 * np.exp(-0.8 * ((places[0] - x) ** 2 + (places[1] - 3.1) ** 2))
        loaded, around = np.empty(4), np.empty(5)
        loaded_centroid(reading, np.ones(49), places, none, loaded)
        pressure_centre(reading, np.ones(49), places, none, around)
        errors.append([loaded[0] - x, around[0] - x])
    scatter = np.std(errors, axis=0)
    assert scatter[1] < 0.3 * scatter[0]


def test_noise_around_a_contact_gives_its_centre_no_negative_variance() -> None:
    reading = np.array([-8.0, 100.0, -8.0, 0.0])
    out = covariance(in_line(4), reading, np.full(4, 16.0), 0.0)
    assert out[0] > 0.0 and out[2] > 0.0


def covariance(places: Floats, reading: Floats, variance: Floats, error: float, tilt: float = 0.0) -> Floats:
    middle, out = np.empty(5), np.empty(9)
    pressure_centre(reading, variance, places, np.zeros(len(reading), np.bool_), middle)
    centroid_covariance(reading, variance, np.full(len(reading), 1000.0), places, middle, error, tilt, out)
    return out


def in_line(count: int) -> Floats:
    return np.stack([np.arange(count, dtype=float), np.zeros(count)])


@pytest.mark.parametrize("count", [1, 2, 5])
def test_taxels_in_line_show_the_centroid_to_within_a_cell_over_their_number(count: int) -> None:
    out = covariance(in_line(count), np.full(count, 100.0), np.full(count, 1e-12), 0.0)
    np.testing.assert_allclose(out[:3], [1 / 12 / count**2, 0.0, 1 / 12], atol=1e-12)


def test_noise_and_errors_of_readings_scatter_the_centroid_by_its_covariance() -> None:
    random = np.random.default_rng(0)
    places = np.stack([axis.ravel() for axis in np.meshgrid(np.arange(4.0), np.arange(3.0))])
    reading = 100.0 * np.exp(-0.3 * ((places[0] - 1.2) ** 2 + (places[1] - 0.8) ** 2))
    out = covariance(places, reading, np.full(12, 0.25), 0.02)
    flat = covariance(places, reading, np.full(12, 0.25), 0.0)
    draws = reading * (1 + 0.02 * random.normal(size=(40_000, 12))) + 0.5 * random.normal(size=(40_000, 12))
    scatter = np.cov((draws @ places.T / draws.sum(axis=1, keepdims=True)).T)
    predicted = out[:3] - flat[:3] + out[3:6]
    np.testing.assert_allclose(predicted, scatter[[0, 0, 1], [0, 1, 1]], rtol=0.05, atol=2e-7)


def test_a_tilt_of_the_load_scatters_the_centroid_by_its_covariance() -> None:
    """The load acts beside the middle by twice the error, as a share of the radius of gyration, in any direction."""
    random = np.random.default_rng(1)
    places = np.stack([axis.ravel() for axis in np.meshgrid(np.arange(6.0), np.arange(4.0))])
    reading = 100.0 * np.exp(-0.2 * ((places[0] - 2.2) ** 2 + 2.0 * (places[1] - 1.6) ** 2))
    found = covariance(places, reading, np.full(24, 1e-12), 0.0, 0.05) - covariance(
        places, reading, np.full(24, 1e-12), 0.0
    )
    share = reading / reading.sum()
    off = places - (places @ share)[:, np.newaxis]
    moment = off * share @ off.T
    eccentric = 0.1 * np.sqrt(np.trace(moment) / 2) * random.normal(size=(40_000, 2))
    draws = reading * (1.0 + eccentric @ np.linalg.inv(moment) @ off)
    scatter = np.cov((draws @ places.T / draws.sum(axis=1, keepdims=True)).T)
    np.testing.assert_allclose(found[:3], scatter[[0, 0, 1], [0, 1, 1]], rtol=0.05, atol=3e-4)


def test_a_masked_taxel_within_the_contact_may_have_read_anything() -> None:
    places, reading = in_line(5), np.full(5, 100.0)
    whole = covariance(places, reading, np.full(5, 1e-12), 0.0)
    reading[3] = 0.0
    masked = covariance(places, reading, np.array([1e-12, 1e-12, 1e-12, 0.0, 1e-12]), 0.0)
    assert masked[0] > 10 * whole[0]


def test_no_load_has_no_covariance() -> None:
    np.testing.assert_array_equal(covariance(in_line(3), np.zeros(3), np.ones(3), 0.3), 0.0)


def test_saturated_taxels_may_be_wrong_by_what_they_read_all_together() -> None:
    out = covariance(in_line(5), np.full(5, 1000.0), np.full(5, 1e-12), 0.0)
    assert np.sqrt(out[0]) == pytest.approx(np.hypot(6 / 5, 1 / 5 / np.sqrt(12)))
    reading = np.array([100.0, 100.0, 1000.0, 100.0, 100.0])  # at the centre it does not matter
    assert covariance(in_line(5), reading, np.full(5, 1e-12), 0.0)[0] < 0.05


def test_a_reading_that_is_missing_hardly_moves_the_centre_of_pressure() -> None:
    axis = np.arange(7.0)
    places = np.stack([part.ravel() for part in np.meshgrid(axis, axis)])
    reading = 1000.0 * np.exp(-0.3 * ((places[0] - 3.2) ** 2 + (places[1] - 3.1) ** 2))
    whole, lacking, none = np.empty(5), np.empty(5), np.zeros(49, np.bool_)
    pressure_centre(reading, np.ones(49), places, none, whole)
    for taxel in np.flatnonzero(reading > 300.0).tolist():
        variance = np.ones(49)
        variance[taxel] = 0.0
        pressure_centre(np.where(variance > 0.0, reading, 0.0), variance, places, none, lacking)
        assert np.hypot(*(lacking - whole)[:2]) < 0.04  # without those next to it, up to 0.2
