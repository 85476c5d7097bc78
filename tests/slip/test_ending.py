from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compiled import compiled
from taxelflow.messages import Floats
from taxelflow.numerics.records import records
from taxelflow.slip.ending import SlideState
from taxelflow.slip.ending import start_slide as _start_slide
from taxelflow.slip.ending import start_stopped as _start_stopped
from taxelflow.slip.ending import stop_odds as _stop_odds
from taxelflow.slip.measurement import Measurement
from taxelflow.slip.onset import SlipEstimate

start_slide = compiled(_start_slide)
start_stopped = compiled(_start_stopped)
stop_odds = compiled(_stop_odds)

STD, RATE_HZ = np.array([2e-5, 2e-5, 1e-3]), 100.0


def measured(scan: int, position: Any, yaw: bool = True) -> Any:
    measurement = records(Measurement, 1)[0]
    measurement["t_s"], measurement["previous_s"] = scan / RATE_HZ, (scan - 1) / RATE_HZ
    measurement["position"] = position
    measurement["covariance"]["variance"] = STD**2 * [1, 1, 1 if yaw else np.nan]
    return measurement


def sliding(velocity: Any) -> Any:
    """A slip from scan 0 that is found at scan 3."""
    slip, slide = records(SlipEstimate, 1)[0], records(SlideState, 1)[0]
    slip["velocity"], slip["position"] = velocity, np.array(velocity) * 3 / RATE_HZ
    slip["velocity_variance"], slip["cross_covariance"] = 1e-8, 1e-10
    start_slide(measured(3, slip["position"]), slip, STD[0] ** 2, slide)
    return slide


def odds_of(path: Floats, slide: Any, yaw: bool = True, creep_m_s: float = 1e-4) -> list[float]:
    return [stop_odds(measured(4 + k, place, yaw), creep_m_s, slide) for k, place in enumerate(path)]


def path_of(velocity: Any, stop: int, scans: int, seed: int | None = None) -> Floats:
    """Positions from scan 4 on, of a slip that begins at scan 0."""
    noise = 0.0 if seed is None else STD * np.random.default_rng(seed).standard_normal((scans, 3))
    moved: Floats = np.minimum(np.arange(4, 4 + scans), stop)[:, np.newaxis] / RATE_HZ * np.array(velocity) + noise
    return moved


def test_a_slip_starts_where_it_was_before_it_was_found() -> None:
    slide = sliding([0.01, -0.02, 0.5])
    np.testing.assert_allclose(slide["origin"], 0.0, atol=1e-15)
    assert slide["start_s"] == 0.0
    assert slide["q_pp"] == pytest.approx(STD[0] ** 2 + 0.01 * 1e-10)
    # it began somewhere between two scans of three
    assert slide["q_vv"] == pytest.approx(1e-8 + (0.01**2 + 0.02**2) / 36)


@given(angle=st.floats(-3, 3), seed=st.integers(0, 9))
@settings(max_examples=20, deadline=None)
def test_the_odds_are_low_while_it_slips_and_high_two_scans_after_it_stops(angle: float, seed: int) -> None:
    velocity = [0.02 * np.cos(angle), 0.02 * np.sin(angle), 0.3]
    slide, path = sliding(velocity), path_of(velocity, 30, 40, seed)
    assert max(odds_of(path[:26], slide)[3:]) < 0.5
    later = next(k for k in range(26, 40) if stop_odds(measured(4 + k, path[k]), 1e-4, slide) > 30.0)
    assert later <= 29
    assert slide["stop"]["since_s"] == pytest.approx(0.3, abs=0.012)
    np.testing.assert_allclose(slide["stop"]["position"], np.array(velocity) * 0.3, atol=4 * STD[2], rtol=0)
    np.testing.assert_allclose(slide["stop"]["position"][:2], np.array(velocity[:2]) * 0.3, atol=4 * STD[0], rtol=0)


def test_velocity_and_position_follow_a_slip_that_changes() -> None:
    slide = sliding([0.02, 0.0, 0.0])
    path = np.zeros((40, 3))
    path[:, 0] = 0.0006 + np.cumsum(np.linspace(0.02, 0.03, 40)) / RATE_HZ
    assert max(odds_of(path, slide)) < 1.0
    assert 0.026 < slide["velocity"][0] < 0.03
    assert slide["position"][0] == pytest.approx(path[-1, 0], abs=4e-5)


def test_a_slow_slip_that_lasts_does_not_end_by_prior_alone() -> None:
    # At 1 mm/s poses that scatter by 0.3 mm exclude no stop of the last half second: at three a second the odds were 2.
    rng, velocity = np.random.default_rng(3), np.array([1e-3, 0.0, 0.0])
    slide, odds = sliding(velocity), []
    for k in range(600):
        one = measured(4 + k, (4 + k) / RATE_HZ * velocity + 3e-4 * rng.standard_normal(3) * [1, 1, 0], yaw=False)
        one["covariance"]["variance"][:2] = 3e-4**2
        odds.append(stop_odds(one, 1e-4, slide))
    assert np.median(odds[300:]) < 0.5


def test_a_slip_as_slow_as_creep_is_over() -> None:
    velocity = [2e-3, 0.0, 0.0]
    assert max(odds_of(path_of(velocity, 99, 10), sliding(velocity))) < 1.0
    assert odds_of(path_of(velocity, 99, 10), sliding(velocity), creep_m_s=1e-3)[-1] == np.inf


def test_a_turn_in_place_counts_where_theta_is_known() -> None:
    turning = [0.0, 0.0, 0.5]
    assert max(odds_of(path_of(turning, 99, 10), sliding(turning))) < 1.0
    assert odds_of(path_of(turning, 99, 10), sliding(turning), yaw=False)[-1] > 1.0


def test_stops_that_are_tested_stay_few() -> None:
    slide = sliding([0.02, 0.0, 0.0])
    odds_of(path_of([0.02, 0.0, 0.0], 99, 60), slide)
    assert slide["count"] == 12
    starts, weights = slide["stops"]["start_s"], slide["stops"]["weight"]
    assert (np.diff(starts) > 0).all()
    assert starts[0] == pytest.approx(0.03)
    assert weights.sum() == pytest.approx(60 / RATE_HZ)  # none is forgotten
    assert starts[-6:] == pytest.approx(np.arange(57, 63) / RATE_HZ)


def test_a_stop_that_stands_for_others_keeps_its_own_time() -> None:
    # A slow slip is over long before it is known to be, when stops that are near each other have become one.
    errors, velocity = [], [8e-4, 0.0, 0.0]
    for seed in range(20):
        slide, path = sliding(velocity), path_of(velocity, 100, 260, seed)
        odds_of(path[:96], slide, yaw=False)
        next(k for k in range(96, 260) if stop_odds(measured(4 + k, path[k], yaw=False), 1e-4, slide) > 3.0)
        errors.append(slide["stop"]["since_s"] - 1.0)
    assert np.sqrt(np.mean(np.square(errors))) < 0.04


def test_a_jump_is_over_when_it_is_found() -> None:
    slide, measurement = records(SlideState, 1)[0], measured(50, [0.012, 0.0, 0.4])
    start_stopped(measurement, (0.01, -0.005), 0.40, 0.42, 0.01, slide)
    np.testing.assert_allclose(slide["velocity"], [0.5, -0.25, 0.0])
    np.testing.assert_allclose(slide["origin"], [0.002, 0.005, 0.4])
    assert slide["yaw_lost"]
    assert stop_odds(measured(51, [0.012, 0.0, 0.4], yaw=False), 1e-4, slide) > 30.0
    assert slide["stop"]["since_s"] == pytest.approx(0.42)
    np.testing.assert_allclose(slide["stop"]["position"], [0.012, 0.0, 0.4])
