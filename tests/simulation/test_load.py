from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from taxelflow.simulation.load import state_at
from taxelflow.simulation.parameters import Load, Motion
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import simulate

STILL = Motion(travel_m=0.0, strokes=1, turn_s=4.0, rest_s=1.0)
T_S = np.linspace(0.0, STILL.duration_s, 601)


def test_a_ramp_runs_between_the_rests() -> None:
    force = state_at(Load("ramp", (1.0, 5.0)), STILL, T_S, T_S).force
    np.testing.assert_allclose(np.interp([0.5, 1.0, 3.0, 5.0, 5.9], T_S, force), [1.0, 1.0, 3.0, 5.0, 5.0])


def test_cycles_swing_between_their_multiples_and_end_where_they_began() -> None:
    force = state_at(Load("cycles", (1.0, 5.0), cycles=3), STILL, T_S, T_S).force
    assert (force[0], force[-1]) == pytest.approx((1.0, 1.0))
    assert (force.min(), force.max()) == pytest.approx((1.0, 5.0), abs=0.01)
    assert np.sum((force[1:-1] > force[:-2]) & (force[1:-1] >= force[2:])) == 3


def test_a_lifted_object_presses_nothing() -> None:
    state = state_at(Load(lift_s=0.5), STILL, T_S, T_S)
    np.testing.assert_array_equal(state.force > 0, (T_S >= 0.5) & (STILL.duration_s - 0.5 >= T_S))


@pytest.mark.parametrize("name", ["press", "roll", "tilt"])
def test_what_is_no_slip_leaves_the_truth_where_it_was_but_not_the_scans(name: str) -> None:
    scenario = SCENARIOS[name]
    quiet = replace(scenario, sensing=replace(scenario.sensing, noise_pa=0.0))
    recording = simulate(quiet)
    truth, values = recording.truth, recording.load().values
    assert truth is not None
    assert truth.slipping is not None
    assert not truth.slipping.any()
    assert not np.ptp(truth.pose, axis=0).any()
    before, after = (int(s * scenario.sensing.rate_hz) for s in (1.5, 2 + scenario.motion.moving_s / 2))
    assert np.abs(values[after] - values[before]).max() > 5.0
