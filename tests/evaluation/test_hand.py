from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from rigged import rigged
from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation import hand
from taxelflow.evaluation.field import SCENES
from taxelflow.evaluation.hand import Hand, hand_bound
from taxelflow.simulation.scenario import SCENARIOS

if TYPE_CHECKING:
    from taxelflow.simulation.scenario import Scenario


SHORT = {SCENES[0]: rigged(SCENES[0], motion={"strokes": 1}, sensing={"rate_hz": 10.0})}


@pytest.mark.parametrize("scenarios", [SHORT, pytest.param(SCENARIOS, marks=pytest.mark.long)], ids=["short", "all"])
def test_convolution_is_far_above_the_bound_and_its_covariance_allows_for_it(
    scenarios: dict[str, Scenario], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    scenes = tuple(name for name in SCENES if name in scenarios)
    monkeypatch.setattr(hand, "SCENES", scenes)
    monkeypatch.setattr(hand, "SCENARIOS", scenarios)
    report = Hand(seeds=1, methods=("convolution",)).run()
    assert [row.scenario for row in report.rows] == list(scenes)
    for row in report.rows:
        assert row.translation_ratio > 3
        assert row.turn_ratio > 3
        assert row.nees < 5
    report.show()
    assert "NEES" in capsys.readouterr().out


@pytest.mark.long
def test_the_bound_falls_with_the_noise() -> None:
    scenario = SCENARIOS[SCENES[0]]
    t_s = np.array([2.0, 2.5])
    quiet = replace(scenario, sensing=replace(scenario.sensing, noise_pa=scenario.sensing.noise_pa / 2, bits=16))
    loud = replace(scenario, sensing=replace(scenario.sensing, bits=16))
    np.testing.assert_allclose(hand_bound(loud, t_s), 2 * hand_bound(quiet, t_s), rtol=1e-3)


def test_without_recordings_there_is_no_score() -> None:
    with pytest.raises(ParameterInvalid, match="seeds"):
        Hand(seeds=0)


@pytest.mark.parametrize("exponent", [0.7, 1.6])
def test_the_skin_of_a_grasp_has_a_law_that_the_rig_can_solve(exponent: float) -> None:
    with pytest.raises(ParameterInvalid, match="exponent"):
        Hand(exponent=exponent)
