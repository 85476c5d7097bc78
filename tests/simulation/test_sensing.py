from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taxelflow.messages import Floats
from taxelflow.simulation.parameters import Sensing
from taxelflow.simulation.sensing import delays, reported, sense

T_S = np.arange(200) / 7.0
FLAT = np.full((200, 24), 50e3)


def readings(pressure: Floats = FLAT, seed: int = 0, **fields: Any) -> Floats:
    quiet = {"noise_pa": 0.0, "baseline_pa": (0.0, 0.0), "bits": 24, "full_scale_pa": 1e6, **fields}
    return sense(Sensing(**quiet), pressure, T_S, np.random.default_rng(seed), seed)


@given(st.floats(0.0, 1.0), st.integers(0, 1000))
def test_jittered_times_still_increase(jitter_s: float, seed: int) -> None:
    times = reported(Sensing(jitter_s=jitter_s), T_S, seed)
    assert (np.diff(times) > 0).all()
    assert np.abs(times - T_S).max() <= 0.45 / 7 + 1e-12


def test_jitter_has_the_spread_it_is_given() -> None:
    assert np.std(reported(Sensing(jitter_s=0.005), T_S, 0) - T_S) == pytest.approx(0.005, rel=0.15)
    assert reported(Sensing(), T_S, 0) is T_S


def test_taxels_are_read_one_after_the_other_within_their_share_of_the_scan() -> None:
    late = delays(Sensing(rate_hz=10.0, scan_share=0.5), 25)
    np.testing.assert_allclose(late, np.arange(25) * 0.002)
    assert not delays(Sensing(), 25).any()


def test_offsets_drift_at_rates_of_their_own() -> None:
    drift = readings(drift_pa_s=100.0) - readings()
    rates = drift[-1] / T_S[-1]
    np.testing.assert_allclose(drift, rates * T_S[:, np.newaxis], atol=0.2)
    assert rates.mean() == pytest.approx(100.0, rel=0.2)
    assert 15.0 < rates.std() < 45.0


def test_a_wobbling_gain_is_common_to_all_taxels() -> None:
    values = readings(gain_wobble=0.02)
    np.testing.assert_allclose(values, np.broadcast_to(values[:, :1], values.shape), atol=0.2)
    assert np.std(values[:, 0] / 50e3) == pytest.approx(0.02, rel=0.2)
    assert np.std(readings(np.zeros_like(FLAT), gain_wobble=0.02)) == 0


def test_a_fault_switched_on_changes_no_other_random_number() -> None:
    usual: dict[str, Any] = {"noise_pa": 500.0, "gain_spread": 0.02, "baseline_pa": (1e3, 4e3)}
    np.testing.assert_allclose(readings(**usual, drift_pa_s=1e-9), readings(**usual), atol=0.2)
    np.testing.assert_allclose(readings(**usual, gain_wobble=1e-12), readings(**usual), atol=0.2)
