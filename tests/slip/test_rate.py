"""The promise: false alarms of white noise come as often as was asked for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import poisson

from compiled import compiled
from costly import mostly_long
from taxelflow.evaluation.slip_scoring import still_slips
from taxelflow.messages import Floats
from taxelflow.numerics.records import records
from taxelflow.runtime.compiling import kernel
from taxelflow.slip.detector import PadState
from taxelflow.slip.measurement import Measurement, Parameters
from taxelflow.slip.onset import RAMPS, alarm_threshold
from taxelflow.slip.onset import prune as _prune
from taxelflow.slip.onset import shiryaev_roberts as _shiryaev_roberts
from taxelflow.slip.parameters import SlipMonitor
from taxelflow.slip.rest_filter import start_rest as _start_rest
from taxelflow.slip.rest_filter import update_rest as _update_rest

shiryaev_roberts = compiled(_shiryaev_roberts)
prune = compiled(_prune)
start_rest = compiled(_start_rest)
update_rest = compiled(_update_rest)

STD = np.array([2e-5, 2e-5, 1e-3])


@kernel
def overshoots(
    trials: int, levels: Floats, shares: Floats, measurement: Measurement, parameters: Parameters, state: PadState
) -> None:
    """Add to shares (levels,) each level over the sum that first exceeds it, when a slip as the test expects it begins.

    The change of measure that makes the sum a martingale gives the rate of false alarms at threshold h as the mean of
    1 / sum over slips drawn from the test's own prior: rare events are counted where they are common.
    measurement: its covariance is that of every pose, NaN where a coordinate is unknown.
    """
    np.random.seed(1)  # numba's own generator  # noqa: NPY002
    y, v, rest, onset = measurement.position, np.empty(3), state.rest, state.onset
    yaw_variance = measurement.covariance.variance[2]
    still = 60
    for _ in range(trials):
        rest.product_sum = rest.mean_log_load = rest.load_variance = 0.0
        rest.components = rest.square_sum = 2900.0
        for axis in range(3):
            v[axis] = RAMPS.reach * np.random.standard_normal()  # noqa: NPY002
            y[axis] = np.random.standard_normal()  # noqa: NPY002
        start_rest(y, 1.0, 0.0, parameters, rest)
        onset.count = passed = 0
        for scan in range(1, still + 200):
            for axis in range(3):
                y[axis] = np.random.standard_normal() + v[axis] * max(0, scan - still)  # noqa: NPY002
            measurement.covariance.variance[2] = yaw_variance
            measurement.previous_s, measurement.t_s = scan - 1.0, float(scan)
            update_rest(measurement, parameters, rest)
            statistic = shiryaev_roberts(measurement, rest, onset)
            prune(float(scan), onset)
            while scan > still and passed < len(levels) and statistic > levels[passed]:
                shares[passed] += levels[passed] / statistic
                passed += 1
            if passed == len(levels):
                break


@pytest.mark.long
@pytest.mark.parametrize("components", [1, 2, 3])
def test_the_threshold_is_the_one_that_a_simulation_of_the_test_gives(components: int) -> None:
    asked = 10.0 ** np.arange(2.5, 7.1, 0.5)  # scans between false alarms
    levels = np.array([alarm_threshold(scans, 1.0, components) for scans in asked])
    shares, trials = np.zeros(len(levels)), 4000
    measurement, parameters, state = (records(fields, 1)[0] for fields in (Measurement, Parameters, PadState))
    measurement["covariance"]["variance"] = np.where(np.arange(3) < components, 1.0, np.nan)
    parameters["load_m"], parameters["creep_m_s"] = 1.0, 0.02
    overshoots(trials, levels, shares, measurement, parameters, state)
    rate = shares / trials / levels
    np.testing.assert_allclose(asked * rate, 1, atol=0.3)


def alarms(pose: Floats, rate_hz: float, monitor: SlipMonitor, std: Floats = STD) -> int:
    t_s = np.arange(len(pose)) / rate_hz
    events = monitor.begin(("pad",)).step(still_slips(t_s, STD * pose, std, np.full(3, np.nan))).events
    return sum(event.event == "slip_start" for event in events)


@pytest.mark.parametrize(("rate_hz", "scale"), [(100.0, 1.6), *mostly_long([(100.0, 1.0), (30.0, 1.0), (400.0, 1.0)])])
def test_white_noise_alarms_as_often_as_was_asked_for(rate_hz: float, scale: float) -> None:
    hours = 200_000 / rate_hz / 3600
    monitor = SlipMonitor(alarms_per_hour=60 / hours)
    found = alarms(scale * np.random.default_rng(5).standard_normal((200_000, 3)), rate_hz, monitor)
    low, high = poisson.ppf([0.001, 0.999], 60)
    assert 0.5 * low <= found <= 1.2 * high


@pytest.mark.parametrize("across", mostly_long([0, 1], 1))
@pytest.mark.parametrize("scale", mostly_long([1.0, 1.6], 1.0))
def test_a_line_of_taxels_alarms_as_often_as_was_asked_for(across: int, scale: float) -> None:
    pose = scale * np.random.default_rng(5).standard_normal((200_000, 3))
    pose[:, across], pose[:, 2] = 0.0, np.nan
    std = STD.copy()
    std[across], std[2] = 0.05, np.nan
    low, high = poisson.ppf([0.001, 0.999], 60)
    assert 0.5 * low <= alarms(pose, 100.0, SlipMonitor(alarms_per_hour=108), std) <= 1.2 * high


@pytest.mark.parametrize("unknown", [(1, 2), (2,), ()], ids=str)
def test_alarms_are_at_least_half_as_frequent_as_asked_for_with_any_coordinates(unknown: tuple[int, ...]) -> None:
    pose, std = 1.6 * np.random.default_rng(5).standard_normal((40_000, 3)), STD.copy()
    for axis in unknown:
        pose[:, axis], std[axis] = (np.nan, np.nan) if axis == 2 else (0.0, 0.05)
    assert 30 <= alarms(pose, 100.0, SlipMonitor(alarms_per_hour=540), std) <= poisson.ppf(0.99, 60)


@pytest.mark.long
def test_noise_smaller_than_its_covariance_does_not_alarm_more_often() -> None:
    pose = np.random.default_rng(5).standard_normal((200_000, 3))
    monitor = SlipMonitor(alarms_per_hour=108)
    found = [alarms(scale * pose, 100.0, monitor) for scale in (0.95, 0.9, 0.7)]
    assert found == sorted(found, reverse=True)
    assert found[0] <= 1.2 * poisson.ppf(0.999, 60)


@pytest.mark.parametrize("correlation", mostly_long([0.3, 0.6], 0.6))
def test_noise_that_hangs_together_does_not_alarm_more_often(correlation: float) -> None:
    white = np.random.default_rng(6).standard_normal((200_000, 3))
    drawn_out = lfilter([np.sqrt(1 - correlation**2)], [1, -correlation], white, axis=0)
    assert alarms(drawn_out, 100.0, SlipMonitor(alarms_per_hour=108)) <= poisson.ppf(0.999, 60)


def test_irregular_times_keep_the_rate() -> None:
    random = np.random.default_rng(7)
    t_s = np.cumsum(random.uniform(0.003, 0.03, 200_000))
    monitor = SlipMonitor(alarms_per_hour=60 / (t_s[-1] / 3600))
    pose = STD * random.standard_normal((200_000, 3))
    events = monitor.begin(("pad",)).step(still_slips(t_s, pose, STD, np.full(3, np.nan))).events
    found = sum(event.event == "slip_start" for event in events)
    assert 10 <= found <= 1.5 * poisson.ppf(0.999, 60)
