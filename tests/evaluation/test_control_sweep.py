from __future__ import annotations

import json

import numpy as np
import pytest

from taxelflow.cli import main
from taxelflow.evaluation.control_sweep import doubled_bound_m
from taxelflow.numerics.gravity import G_M_S2
from taxelflow.simulation.mujoco.plant import Actuator
from taxelflow.simulation.mujoco.plants import TRIAL
from taxelflow.simulation.mujoco.trial import Trial

Capture = pytest.CaptureFixture[str]
AT_ONCE = Actuator(bandwidth_hz=1e4)


def test_the_bound_is_the_way_of_a_body_that_is_let_go_and_stopped() -> None:
    trial = Trial.drawn(3, "ball", "double")
    least_n = trial.least_n(TRIAL.event_s)
    assert least_n == pytest.approx(2.0 * trial.least_n(TRIAL.event_s - 0.01))
    down, up = (G_M_S2 * (1.0 - force_n / least_n) for force_n in (trial.first_n, 1.5 * least_n))
    speed = down * 0.01
    way_m = speed * 0.01 / 2 + speed**2 / (2 * -up)
    assert doubled_bound_m(trial, AT_ONCE, 1.5 * least_n) == pytest.approx(way_m, rel=0.03)


def test_the_bound_grows_with_latency_and_falls_with_bandwidth_and_force() -> None:
    trial = Trial.drawn(3, "ball", "double")
    least_n = trial.least_n(TRIAL.event_s)
    late = [doubled_bound_m(trial, Actuator(10.0, latency_s), 1.3 * least_n) for latency_s in (0.0, 0.01, 0.02, 0.05)]
    fast = [doubled_bound_m(trial, Actuator(bandwidth_hz), 1.3 * least_n) for bandwidth_hz in (5.0, 10.0, 30.0)]
    assert late == sorted(late)
    assert fast == sorted(fast, reverse=True)
    assert doubled_bound_m(trial, Actuator(), 40.0) < doubled_bound_m(trial, Actuator(), 1.3 * least_n)
    assert np.isinf(doubled_bound_m(trial, Actuator(), 0.9 * least_n))


@pytest.mark.long
def test_a_sweep_has_a_row_for_each_actuator(capsys: Capture) -> None:
    pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'taxelflow[sim]'")
    assert main(["control", "--controller", "threshold", "--sweep", "actuator", "--trials", "1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    rows = told["rows"]
    assert [(row["latency_ms"], row["bandwidth_hz"]) for row in rows[:4]] == [(0, 5), (0, 10), (0, 30), (10, 5)]
    assert len(rows) == 12
    assert all(row["slid_p50_mm"] > row["bound_full_mm"] for row in rows)
    assert all(row["bound_gentle_mm"] > row["bound_full_mm"] > 0.0 for row in rows)


@pytest.mark.parametrize("words", ["--controller slide", "--controller hold --events pour"])
def test_a_sweep_has_an_event_of_its_own(words: str, capsys: Capture) -> None:
    assert main(["control", *words.split(), "--sweep", "actuator"]) == 2
    assert "taxelflow: --sweep must be used with one controller that holds" in capsys.readouterr().err
