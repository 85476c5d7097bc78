from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from synthetic import assert_same, conditioned, dome, grid_sensor, recorded
from taxelflow.condition.filters import Filters
from taxelflow.errors import ParameterInvalid
from taxelflow.pipeline.api import estimate

if TYPE_CHECKING:
    from taxelflow.messages import Floats

PALM = grid_sensor(4, 7, full_scale=140e3)
WIDE = grid_sensor(9, 21, full_scale=140e3)
QUIET = np.zeros(28)
both_modes = pytest.mark.parametrize("mode", ["batch", "stream"])


def no_gap(values: Floats) -> Floats:
    return np.zeros(len(values), dtype=np.bool_)  # type: ignore[return-value]


def noisy(scans: int, taxels: int = 28) -> Floats:
    drawn: Floats = np.random.default_rng(0).normal(0, 100, (scans, taxels))
    return drawn


def test_off_changes_nothing() -> None:
    filters = Filters(28, 0.0, 1, 0.01)
    values = noisy(50)
    np.testing.assert_array_equal(filters.step(values, no_gap(values), QUIET), values)
    assert (filters.lag_s, filters.noise_gain) == (0.0, pytest.approx(1.0, abs=0.01))


@pytest.mark.parametrize("cutoff_hz", [2.0, 10.0, 40.0])
def test_the_low_pass_is_scipys(cutoff_hz: float) -> None:
    values = noisy(300)
    values[0] = 0.0  # from rest, where both begin alike
    seen = Filters(28, cutoff_hz, 1, 0.01).step(values, no_gap(values), QUIET)
    np.testing.assert_allclose(seen, sosfilt(butter(2, cutoff_hz, fs=100.0, output="sos"), values, axis=0), atol=1e-9)


@pytest.mark.parametrize("scans", [3, 5, 9])
def test_the_median_is_of_the_last_scans(scans: int) -> None:
    values = noisy(100)
    seen = Filters(28, 0.0, scans, 0.01).step(values, no_gap(values), QUIET)
    for k in (0, 1, scans, 99):
        np.testing.assert_allclose(seen[k], np.median(values[max(0, k - scans + 1) : k + 1], axis=0))


@pytest.mark.parametrize(("cutoff_hz", "median"), [(10.0, 1), (0.0, 5), (8.0, 3)])
def test_noise_gain_and_lag_are_those_stated(cutoff_hz: float, median: int) -> None:
    filters = Filters(4, cutoff_hz, median, 0.01)
    values = np.random.default_rng(7).normal(0, 3.0, (30_000, 4))
    calm = filters.step(values, no_gap(values), np.zeros(4))
    assert calm[500:].std() / 3.0 == pytest.approx(filters.noise_gain, rel=0.02)
    assert filters.noise_gain < 0.7
    ramp = np.arange(2000.0)[:, np.newaxis] * np.ones(4)
    late = Filters(4, cutoff_hz, median, 0.01).step(ramp, no_gap(ramp), np.zeros(4))
    assert float(ramp[-1, 0] - late[-1, 0]) * 0.01 == pytest.approx(filters.lag_s, rel=1e-3)


def test_it_begins_in_the_state_it_would_be_in() -> None:
    values = np.full((20, 28), 5000.0)
    np.testing.assert_allclose(Filters(28, 3.0, 3, 0.01).step(values, no_gap(values), QUIET), values)


def test_a_gap_begins_anew() -> None:
    values = np.concatenate([np.full((50, 28), 100.0), np.full((50, 28), 9000.0)])
    gap = np.arange(100) == 50
    np.testing.assert_allclose(Filters(28, 3.0, 5, 0.01).step(values, gap, QUIET), values)


def test_a_missing_reading_stays_missing_and_is_not_remembered() -> None:
    values = np.full((60, 28), 700.0)
    values[30:33, 4] = np.nan
    seen = Filters(28, 3.0, 3, 0.01).step(values, no_gap(values), QUIET)
    assert np.flatnonzero(np.isnan(seen[:, 4])).tolist() == [30, 31, 32]
    np.testing.assert_allclose(seen[33:, 4], 700.0)


def test_a_clipped_taxel_falls_back_to_exactly_0() -> None:
    values = np.concatenate([np.full((50, 28), 900.0), np.zeros((200, 28))])
    seen = Filters(28, 5.0, 1, 0.01).step(values, no_gap(values), np.full(28, 5.0))
    assert (seen[-50:] == 0.0).all()


def grasp(scans: int = 300) -> Floats:
    return noisy(scans) + np.where(np.arange(scans) < 60, 0.0, 1.0)[:, np.newaxis] * dome(PALM)


@both_modes
def test_the_noise_of_scans_is_that_of_filtered_readings(mode: str) -> None:
    t_s = np.arange(300) / 100
    plain, _ = conditioned(grasp(), PALM, mode=mode, t_s=t_s)
    calm, session = conditioned(grasp(), PALM, mode=mode, t_s=t_s, lowpass_hz=5.0)
    assert np.median(plain.noise / calm.noise) == pytest.approx(1 / Filters(1, 5.0, 1, 0.01).noise_gain, rel=1e-6)
    steady = calm.pressure[150:].std(axis=0)
    assert np.median(steady / calm.noise) == pytest.approx(1.0, abs=0.35)
    assert session.lag_s == pytest.approx(Filters(1, 5.0, 1, 0.01).lag_s, rel=1e-6)


def test_a_stream_does_not_depend_on_how_it_is_cut() -> None:
    parameters = {"lowpass_hz": 1.0, "median_scans": 3, "mode": "stream"}
    one, _ = conditioned(grasp(), PALM, **parameters)  # type: ignore[arg-type]
    other, _ = conditioned(grasp(), PALM, cuts=range(300), **parameters)  # type: ignore[arg-type]
    assert_same(one, other)


@pytest.mark.long
@pytest.mark.parametrize("filtered", [{"lowpass_hz": 4.0}, {"median_scans": 5}])
def test_the_lag_of_slips_dates_a_position(filtered: dict[str, float]) -> None:
    from taxelflow.condition.parameters import Conditioner

    x = np.linspace(-0.05, 0.05, 200)
    values = np.array([dome(WIDE, place) for place in x]) + noisy(200, 189)
    t_s = np.arange(200) / 50
    result = estimate(recorded(values, WIDE, t_s), condition=Conditioner(**filtered))  # type: ignore[arg-type]
    middle = slice(80, 140)
    true = np.interp(t_s[middle] - result.slips.lag_s[middle, 0], t_s, x)
    offsets = result.slips.pose[middle, 0, 0] - true
    assert np.abs(offsets).max() < 0.0006
    assert result.slips.lag_s[100, 0] > 0.035
    assert any("filtered over time: every lag_s is" in note for note in result.summary.notes)


def test_a_cut_off_above_half_the_rate_is_refused_with_the_rate() -> None:
    with pytest.raises(ParameterInvalid, match=r"lowpass_hz must be below half the scan rate, here 5 Hz \(got 5\.0\)"):
        conditioned(grasp(), PALM, lowpass_hz=5.0)


def test_a_single_scan_cannot_be_filtered_and_is_not() -> None:
    scans, session = conditioned(grasp()[:1], PALM, lowpass_hz=3.0)
    assert (len(scans), session.lag_s) == (1, 0.0)
