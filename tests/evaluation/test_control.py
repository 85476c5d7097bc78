from __future__ import annotations

import json
from importlib.util import find_spec

import pytest

from taxelflow.cli import main
from taxelflow.evaluation.control import ControlReport, TrialRow
from taxelflow.evaluation.control_table import interval, paired

Capture = pytest.CaptureFixture[str]
in_mujoco = pytest.mark.skipif(
    find_spec("mujoco") is None, reason="mujoco is not installed: pip install 'taxelflow[sim]'"
)


def row(seed: int, slid_mm: float, *, grasped: bool = True, held: bool = True) -> TrialRow:
    return TrialRow(seed, "ball", "pour", grasped, held, slid_mm, 1.0 + 0.1 * seed if held else None)


@in_mujoco
def test_json_is_the_contract_and_nothing_else(capsys: Capture) -> None:
    words = [
        "control",
        "--controller",
        "constant",
        "--trials",
        "3",
        "--seed",
        "7",
        "--events",
        "weak",
        "none",
        "--json",
    ]
    assert main(words) == 0
    told = json.loads(capsys.readouterr().out)
    assert list(told) == ["controller", "trials", "held", "within_5_mm", "force_p50", "force_p90"]
    assert told["controller"] == "constant"
    assert [trial["object"] for trial in told["trials"]] == ["ball", "rod", "box"]
    assert [trial["event"] for trial in told["trials"]] == ["weak", "none", "weak"]
    assert [trial["held"] for trial in told["trials"]] == [False, True, False]
    for trial in told["trials"]:
        assert list(trial) == ["seed", "object", "event", "grasped", "held", "slid_mm", "force_over_least"]
        assert trial["grasped"]
    assert told["held"] == told["within_5_mm"] == pytest.approx(1 / 3)
    assert 1.15 <= told["force_p50"] <= 1.4
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out) == told


@in_mujoco
def test_hold_catches_what_a_constant_force_drops(capsys: Capture) -> None:
    words = ["--trials", "1", "--seed", "11", "--objects", "ball", "--events", "weak"]
    held = []
    for name in ("constant", "hold"):
        assert main(["control", "--controller", name, "--method", "convolution", *words, "--json"]) == 0
        held.append(json.loads(capsys.readouterr().out)["trials"][0]["held"])
    assert held == [False, True]


@in_mujoco
def test_an_object_that_is_not_grasped_is_a_fault_of_the_bench(capsys: Capture) -> None:
    words = [
        "control",
        "--controller",
        "constant",
        "--trials",
        "1",
        "--latency-ms",
        "900",
        "--events",
        "none",
        "--json",
    ]
    assert main(words) == 1
    out, err = capsys.readouterr()
    assert "trial 0 (ball) was not grasped before the lift" in err
    told = json.loads(out)
    assert told["trials"][0]["grasped"] is told["trials"][0]["held"] is False
    assert told["held"] is told["within_5_mm"] is told["force_p50"] is None


@in_mujoco
def test_the_table_compares_controllers_on_the_same_trials(capsys: Capture) -> None:
    words = [
        "control",
        "--controller",
        "threshold",
        "--against",
        "constant",
        "--trials",
        "2",
        "--seed",
        "3",
        "--events",
        "weak",
        "none",
    ]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert "threshold against constant, within 5 mm:" in out
    assert main(["control", "--controller", "constant", "--trials", "1", "--events", "none"]) == 0
    assert "ball" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--controller holt", "unknown controller 'holt'; did you mean 'hold'? known are hold, constant"),
        ("--controller hold --objects bal", "unknown object 'bal'; did you mean 'ball'?"),
        ("--controller hold --events pur", "unknown event 'pur'; did you mean 'pour'?"),
        ("--controller hold --trials 0", "trials must be at least 1 (got 0)"),
        ("--controller hold --seed -1", "seed must be 0 or more (got -1)"),
        ("--controller hold --method no", "unknown method 'no'"),
        ("--controller slide --by-mm 0", "by_mm must be above 0 and below 25 (got 0.0)"),
        ("--controller pivot --by-deg 300", "by_deg must be above 0 and below 180 (got 300.0)"),
        ("--controller slide --events pour", "events must be none for slide (got 'pour')"),
        ("--controller hold --against constant --json", "against must be left out with --json"),
        ("--controller hold --against slide", "against must not be used with slide or pivot (got 'slide')"),
        ("--controller hold --bandwidth-hz 0", "actuator.bandwidth_hz must be a finite number above 0 (got 0.0)"),
    ],
)
def test_bad_input_is_told_in_one_line(words: str, message: str, capsys: Capture) -> None:
    assert main(["control", *words.split()]) == 2
    out, err = capsys.readouterr()
    assert not out
    assert err.startswith("taxelflow: ")
    assert err.count("\n") == 1
    assert message in err


def test_shares_are_of_the_grasped_trials() -> None:
    rows = [row(0, 1.0), row(1, 6.0), row(2, 31.0, held=False), row(3, 0.0, grasped=False, held=False)]
    report = ControlReport.of("hold", rows)
    assert report.held == pytest.approx(2 / 3)
    assert report.within_5_mm == pytest.approx(1 / 3)
    assert report.force_p50 == pytest.approx(1.05)


def test_intervals_are_wilsons_and_pairs_count_wins() -> None:
    assert interval([True] * 100) == "96%-100%"
    assert interval([True, False]) == "9%-91%"
    assert interval([]) == "-"
    ours = ControlReport.of("hold", [row(seed, 1.0) for seed in range(10)])
    other = ControlReport.of("constant", [row(seed, 9.0) for seed in range(10)])
    assert (
        paired(ours, other)
        == "hold against constant, within 5 mm: 10 wins, 0 losses of 10; difference +100% [+100% +100%]"
    )
