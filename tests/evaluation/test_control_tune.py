from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from taxelflow.cli import main
from taxelflow.control.baselines import Constant
from taxelflow.control.hold import Hold
from taxelflow.errors import GraphicsMissing
from taxelflow.evaluation.control import TrialRow, cost_of
from taxelflow.evaluation.control_tune import SPACES, changed, drawn, table_of_draws, tune
from taxelflow.runtime import registry
from taxelflow.simulation.mujoco.trial import Trial, drawn_in_turn

if TYPE_CHECKING:
    from pathlib import Path

Capture = pytest.CaptureFixture[str]


@pytest.mark.parametrize("name", SPACES)
def test_every_point_of_a_space_is_a_controller(name: str) -> None:
    kind = registry.find("controller", name)
    points = drawn(SPACES[name], 8)
    assert drawn(SPACES[name], 3) == points[:3]
    for point in points:
        changed(kind(), point).start(5.0, 40.0)
        for parameter, value in point.items():
            low, high = SPACES[name][parameter]
            assert 0.99 * low <= value <= 1.01 * high


def test_a_dot_leads_into_a_parameter() -> None:
    controller = changed(Hold(), {"margin": 1.3, "agreement.slip_m_s": 0.01})
    assert (controller.margin, controller.agreement.slip_m_s) == (1.3, 0.01)
    assert controller.agreement.sigmas == Hold().agreement.sigmas


def test_a_loss_costs_as_much_as_five_times_the_least_force() -> None:
    rows = [
        TrialRow(0, "ball", "pour", True, True, 1.0, 1.0),
        TrialRow(1, "ball", "pour", True, True, 1.0, 5.0),
        TrialRow(2, "ball", "pour", True, False, 30.0, None),
        TrialRow(3, "ball", "pour", False, False, 30.0, None),
    ]
    assert [cost_of([row]) for row in rows] == [0.0, 1.0, 1.0, float("inf")]
    assert cost_of(rows) == pytest.approx(2 / 3)


def test_all_draws_are_tried_on_some_trials_and_the_cheapest_on_all() -> None:
    """A force that costs as much as it differs from 3 times the first one: the search finds the nearest draw."""
    seen: list[tuple[int, float]] = []

    def run(trial: Trial, controller: Constant) -> TrialRow:
        seen.append((trial.seed, controller.times))
        return TrialRow(trial.seed, "ball", "pour", True, True, 1.0, 1.0 + abs(controller.times - 3.0))

    trials = list(drawn_in_turn(0, 8, ("ball",), ("pour",), Trial.drawn))
    report = tune("constant", Constant(times=1.0), trials, 7, run, iter)
    counts = [one.trials for one in report.tried]
    assert counts == [8] * 5 + [2] * 3
    assert {} in [one.parameters for one in report.tried[:5]]
    draws = [one["times"] for one in drawn(SPACES["constant"], 7)]
    assert report.tried[0].parameters == {"times": min(draws, key=lambda times: abs(times - 3.0))}
    assert [one.cost for one in report.tried[:5]] == sorted(one.cost for one in report.tried[:5])
    table = table_of_draws(report)
    assert len(table.rows) == 8
    assert (
        dict(zip(table.columns, table.rows[0], strict=True))["parameters"]
        == f"times={report.tried[0].parameters['times']:g}"
    )
    assert len(set(seen)) == len(seen) == 8 * 2 + 5 * 6


@pytest.mark.long
def test_a_search_prints_the_cheapest_first(capsys: Capture) -> None:
    pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'taxelflow[sim]'")
    words = ["control", "--controller", "constant", "--trials", "1", "--seed", "7", "--events", "weak", "--json"]
    assert main([*words, "--tune", "2"]) == 0
    tried = json.loads(capsys.readouterr().out)["tried"]
    assert len(tried) == 3
    assert {} in [one["parameters"] for one in tried]
    assert tried == sorted(tried, key=lambda one: one["cost"])
    assert main([*words, "--tune", "-1"]) == 2


@pytest.mark.long
def test_without_graphics_a_film_is_left_out_with_a_message(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'taxelflow[sim]'")
    pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed: pip install 'taxelflow[video]'")

    def fail(*_: object) -> None:
        raise GraphicsMissing("egl: none")

    monkeypatch.setattr("taxelflow.evaluation.control_film.Camera", fail)
    words = ["control", "--controller", "constant", "--trials", "1", "--seed", "7", "--events", "weak"]
    assert main([*words, "--film", str(tmp_path / "a.mp4"), "--plot", str(tmp_path)]) == 0
    told = capsys.readouterr()
    assert "no film: cannot render pictures: egl: none; install EGL" in told.err
    assert (tmp_path / "constant-weak.svg").exists()
