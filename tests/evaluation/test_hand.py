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
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import pressures

if TYPE_CHECKING:
    from taxelflow.messages import Floats
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


def test_the_bound_is_that_of_the_readings_slopes_by_place_and_turn() -> None:
    """Against differences of other scenarios, 0.02 mm and 0.1 mrad apart, and one least-squares problem per scan."""
    scenario, t_s = SCENARIOS["turn-over-hand"], np.array([1.6, 1.75, 1.95])
    layout = load_sensor(scenario.sensor).layout
    pads = list(range(layout.pad_count))

    def read(x_m: float = 0.0, y_m: float = 0.0, theta_rad: float = 0.0) -> Floats:
        at = replace(
            scenario.motion,
            middle_m=(x_m, y_m),
            centre_m=(x_m, y_m),
            angle_rad=scenario.motion.angle_rad + theta_rad,
        )
        return pressures(replace(scenario, motion=at), layout, pads, t_s)

    steps = np.diag([2e-5, 2e-5, 1e-4])
    slopes = [(read(*step) - read(*-step)) / (2 * step.max()) for step in steps]
    sensing = scenario.sensing
    noise_pa = np.hypot(sensing.noise_pa, sensing.full_scale_pa / (2**sensing.bits - 1) / np.sqrt(12))
    taxels = np.arange(layout.taxels)
    on_pad = [np.isin(taxels, taxels[layout.of_pad(pad)]) for pad in pads]
    bound = hand_bound(scenario, t_s)
    for scan, pressure in enumerate(read()):
        free = [column for own in on_pad for column in (own * 1.0, own * pressure / 1e5) if column.any()]
        problem = np.column_stack([*(slope[scan] for slope in slopes), *free])
        deviation = noise_pa * np.sqrt(np.diag(np.linalg.pinv(problem) @ np.linalg.pinv(problem).T))[:3]
        np.testing.assert_allclose(bound[scan], deviation, rtol=2e-3)


def test_without_recordings_there_is_no_score() -> None:
    with pytest.raises(ParameterInvalid, match="seeds"):
        Hand(seeds=0)


@pytest.mark.parametrize("exponent", [0.7, 1.6])
def test_the_skin_of_a_grasp_has_a_law_that_the_rig_can_solve(exponent: float) -> None:
    with pytest.raises(ParameterInvalid, match="exponent"):
        Hand(exponent=exponent)
