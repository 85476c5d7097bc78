"""The promise: false alarms of white noise come as often as was asked for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import poisson

from taxelflow.compiling import kernel
from taxelflow.evaluation.slip_scoring import still_slips
from taxelflow.messages import Floats
from taxelflow.slip.onset import MOST_RAMPS, RAMP, REACH, SLIP, T_0, WEIGHT, thinned, threshold, weigh
from taxelflow.slip.parameters import SlipMonitor
from taxelflow.slip.rest_filter import ENERGY, FREEDOM, STEP, STILL, innovate, settle

STD = np.array([2e-5, 2e-5, 1e-3])


@kernel
def leaps(trials: int, components: int, levels: Floats, shares: Floats) -> None:
    """Add to shares (levels,) each level over the sum that first exceeds it, when a slip as the test expects it begins.

    The change of measure that makes the sum a martingale gives the rate of false alarms at threshold h as the mean of
    1 / sum over slips drawn from the test's own prior: rare events are counted where they are common.
    """
    np.random.seed(1)  # numba's own generator  # noqa: NPY002
    prior, step, slip = np.array([1.0, 0.02]), np.empty(STEP), np.empty(SLIP)
    m, ramps = np.zeros(STILL), np.zeros((MOST_RAMPS, RAMP))
    y, noise, v = np.empty(3), np.empty(6), np.empty(3)
    still = 60
    for _ in range(trials):
        m[:] = 0.0
        m[FREEDOM] = m[ENERGY] = 2900.0
        for axis in range(3):
            v[axis] = REACH * np.random.standard_normal()  # noqa: NPY002
            y[axis] = np.random.standard_normal()  # noqa: NPY002
        settle(y, 1.0, 0.0, prior, m)
        count = passed = 0
        for scan in range(1, still + 200):
            for axis in range(3):
                y[axis] = np.random.standard_normal() + v[axis] * max(0, scan - still)  # noqa: NPY002
            noise[:3], noise[3:] = 1.0, 0.0
            noise[components:3] = np.nan
            innovate(1.0, y, noise, 0.0, prior, m, step)
            whole = weigh(float(scan), scan - 1.0, step, m, count, ramps, slip)
            count = thinned(float(scan), count + 1, ramps)
            while scan > still and passed < len(levels) and whole > levels[passed]:
                shares[passed] += levels[passed] / whole
                passed += 1
            if passed == len(levels):
                break


@pytest.mark.parametrize("components", [1, 2, 3])
def test_the_threshold_is_the_one_that_a_simulation_of_the_test_gives(components: int) -> None:
    asked = 10.0 ** np.arange(2.5, 7.1, 0.5)  # scans between false alarms
    levels = np.array([threshold(scans, 1.0, float(components)) for scans in asked])
    shares, trials = np.zeros(len(levels)), 4000
    leaps(trials, components, levels, shares)
    rate = shares / trials / levels
    np.testing.assert_allclose(asked * rate, 1, atol=0.3)


def test_ramps_reach_back_a_bounded_time_and_weigh_no_more() -> None:
    ramps, count, oldest = np.zeros((MOST_RAMPS, RAMP)), 0, []
    for scan in range(1, 2000):
        ramps[count, [T_0, WEIGHT]] = scan - 1.0, 1.0
        count = thinned(float(scan), count + 1, ramps)
        age = scan - ramps[:count, T_0]
        assert ramps[:count, WEIGHT].sum() < 100
        oldest.append(age[0])
    assert 40 < min(oldest[100:]) < max(oldest) < 70


def alarms(pose: Floats, rate_hz: float, monitor: SlipMonitor, std: Floats = STD) -> int:
    t_s = np.arange(len(pose)) / rate_hz
    _, events = monitor.begin(("pad",)).step(still_slips(t_s, STD * pose, std, np.full(3, np.nan)))
    return sum(event.event == "slip_start" for event in events)


@pytest.mark.parametrize(("rate_hz", "scale"), [(100.0, 1.0), (100.0, 1.6), (30.0, 1.0), (400.0, 1.0)])
def test_white_noise_alarms_as_often_as_was_asked_for(rate_hz: float, scale: float) -> None:
    hours = 200_000 / rate_hz / 3600
    monitor = SlipMonitor(alarms_per_hour=60 / hours)
    found = alarms(scale * np.random.default_rng(5).standard_normal((200_000, 3)), rate_hz, monitor)
    low, high = poisson.ppf([0.001, 0.999], 60)
    assert 0.5 * low <= found <= 1.2 * high


@pytest.mark.parametrize("across", [0, 1])
@pytest.mark.parametrize("scale", [1.0, 1.6])
def test_a_line_of_taxels_alarms_as_often_as_was_asked_for(across: int, scale: float) -> None:
    pose = scale * np.random.default_rng(5).standard_normal((200_000, 3))
    pose[:, across], pose[:, 2] = 0.0, np.nan
    std = STD.copy()
    std[across], std[2] = 0.05, np.nan
    low, high = poisson.ppf([0.001, 0.999], 60)
    assert 0.5 * low <= alarms(pose, 100.0, SlipMonitor(alarms_per_hour=108), std) <= 1.2 * high


def test_noise_smaller_than_its_covariance_does_not_alarm_more_often() -> None:
    pose = np.random.default_rng(5).standard_normal((200_000, 3))
    monitor = SlipMonitor(alarms_per_hour=108)
    found = [alarms(scale * pose, 100.0, monitor) for scale in (0.95, 0.9, 0.7)]
    assert found == sorted(found, reverse=True)
    assert found[0] <= 1.2 * poisson.ppf(0.999, 60)


@pytest.mark.parametrize("correlation", [0.3, 0.6])
def test_noise_that_hangs_together_does_not_alarm_more_often(correlation: float) -> None:
    white = np.random.default_rng(6).standard_normal((200_000, 3))
    drawn_out = lfilter([np.sqrt(1 - correlation**2)], [1, -correlation], white, axis=0)
    assert alarms(drawn_out, 100.0, SlipMonitor(alarms_per_hour=108)) <= poisson.ppf(0.999, 60)


def test_irregular_times_keep_the_rate() -> None:
    random = np.random.default_rng(7)
    t_s = np.cumsum(random.uniform(0.003, 0.03, 200_000))
    monitor = SlipMonitor(alarms_per_hour=60 / (t_s[-1] / 3600))
    pose = STD * random.standard_normal((200_000, 3))
    _, events = monitor.begin(("pad",)).step(still_slips(t_s, pose, STD, np.full(3, np.nan)))
    found = sum(event.event == "slip_start" for event in events)
    assert 10 <= found <= 1.5 * poisson.ppf(0.999, 60)
