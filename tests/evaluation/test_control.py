from __future__ import annotations

import json
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np
import pytest

from rigged import refused
from taxelflow.cli import main
from taxelflow.control.baselines import Constant
from taxelflow.control.hold import Hold
from taxelflow.evaluation.control import ControlReport, Course, Outcome, Scans, TrialRow, held
from taxelflow.evaluation.control_summary import paired, summary, tables_of, wilson
from taxelflow.evaluation.control_table import share
from taxelflow.simulation.mujoco.trial import Trial

if TYPE_CHECKING:
    from pathlib import Path

Capture = pytest.CaptureFixture[str]
in_mujoco = pytest.mark.skipif(
    find_spec("mujoco") is None, reason="mujoco is not installed: pip install 'taxelflow[sim]'"
)


def row(seed: int, slid_mm: float, *, grasped: bool = True, held: bool = True) -> TrialRow:
    return TrialRow(seed, "ball", "pour", grasped, held, slid_mm, 1.0 + 0.1 * seed if held else None)


@pytest.mark.long
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
        "--latency-ms",
        "250",
        "--json",
    ]  # so late, a force that holds comes after a weak grip has slid
    assert main(words) == 0
    printed = json.loads(capsys.readouterr().out)
    assert list(printed) == ["controller", "trials", "held", "within_5_mm", "force_p50", "force_p90"]
    assert printed["controller"] == "constant"
    assert [trial["object"] for trial in printed["trials"]] == ["ball", "rod", "box"]
    assert [trial["event"] for trial in printed["trials"]] == ["weak", "none", "weak"]
    assert [trial["slid_mm"] < 5.0 for trial in printed["trials"]] == [False, True, True]
    for trial in printed["trials"]:
        assert list(trial) == ["seed", "object", "event", "grasped", "held", "slid_mm", "force_over_least"]
        assert trial["grasped"]
    assert (printed["held"], printed["within_5_mm"]) == pytest.approx((1.0, 2 / 3))
    assert 0.75 <= printed["force_p50"] / Constant().times <= 0.97
    words[words.index("--trials") + 1] = "1"
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)["trials"] == printed["trials"][:1]


@pytest.mark.long
@in_mujoco
def test_hold_catches_what_the_first_force_drops() -> None:
    trial = Trial.drawn(11, "ball", "weak")
    assert [held(Course(trial, one, "convolution")).held for one in (Constant(times=1.0), Hold())] == [False, True]


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
    printed = json.loads(out)
    assert printed["trials"][0]["grasped"] is printed["trials"][0]["held"] is False
    assert printed["held"] is printed["within_5_mm"] is printed["force_p50"] is None


@in_mujoco
@pytest.mark.parametrize("written", ["--plot", "--lerobot"])
def test_pictures_and_episodes_of_an_object_that_is_not_grasped_are_a_fault_too(
    tmp_path: Path, capsys: Capture, written: str
) -> None:
    if written == "--lerobot":
        pytest.importorskip("pyarrow", reason="pyarrow is not installed: pip install 'taxelflow[tables]'")
    words = ["control", "--controller", "constant", "--trials", "1", "--latency-ms", "900", "--events", "none"]
    assert main([*words, written, str(tmp_path / "made")]) == 1
    assert "trial 0 (ball) was not grasped before the lift" in capsys.readouterr().err
    assert any((tmp_path / "made").iterdir())


@in_mujoco
def test_a_directory_that_is_not_empty_is_refused_before_the_first_trial(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pyarrow", reason="pyarrow is not installed: pip install 'taxelflow[tables]'")
    monkeypatch.setattr(Course, "__iter__", lambda _: pytest.fail("a trial ran"))
    (tmp_path / "own.txt").write_text("a file of the user")
    for directory in (tmp_path, tmp_path / "own.txt"):
        said = refused(capsys, "control", "--controller", "constant", "--trials", "1", "--lerobot", directory)
        assert f"--lerobot must be a directory that is new or empty (got '{directory}')" in said


@pytest.mark.long
@in_mujoco
def test_a_hand_takes_the_grippers_place(capsys: Capture) -> None:
    words = ["control", "--hand", "barrett", "--trials", "1", "--seed", "5", "--events", "none", "--json"]
    assert main([*words, "--controller", "constant"]) == 0
    printed = json.loads(capsys.readouterr().out)
    (trial,) = printed["trials"]
    assert (trial["object"], trial["grasped"], trial["held"]) == ("jar", True, True)
    assert 1.15 <= trial["force_over_least"] / Constant().times <= 1.4


@in_mujoco
def test_the_table_compares_controllers_on_the_same_trials(tmp_path: Path, capsys: Capture) -> None:
    words = [
        "control",
        "--controller",
        "threshold",
        "--against",
        "constant",
        "--trials",
        "1",
        "--seed",
        "3",
        "--events",
        "weak",
    ]
    assert main([*words, "--csv", str(tmp_path / "control.csv")]) == 0
    out = capsys.readouterr().out
    assert "threshold against constant, felt, within 5 mm:" in out
    assert "a step of the estimator" in out
    assert len((tmp_path / "control.csv").read_text().splitlines()) == 3
    trials = (tmp_path / "control-trials.csv").read_text()
    assert len(trials.splitlines()) == 3
    assert trials.count("ball") == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--controller holt", "unknown controller 'holt'; did you mean 'hold'? known are hold, constant"),
        ("--controller hold --objects bal", "unknown object 'bal'; did you mean 'ball'?"),
        ("--controller hold --events pur", "unknown event 'pur'; did you mean 'pour'?"),
        ("--controller hold --trials 0", "trials must be at least 1 (got 0)"),
        ("--controller hold --seed -1", "seed must be 0 or more (got -1)"),
        ("--controller hold --method no", "unknown method 'no'"),
        ("--controller slide --by-mm 0", "--by-mm must be above 0 and below 25 (got 0.0)"),
        ("--controller pivot --by-deg 300", "--by-deg must be above 0 and below 180 (got 300.0)"),
        ("--controller hold --by-mm 5", "--by-mm must be left out for hold: it is an option of slide (got 5.0)"),
        ("--controller slide --by-deg 45", "--by-deg must be left out for slide: it is an option of pivot (got 45.0)"),
        (
            "--controller constant --by-deg 9 --tune 2",
            "--by-deg must be left out for constant: it is an option of pivot",
        ),
        ("--controller hold --by-mm 5 --sweep actuator", "--by-mm must be left out for hold: it is an option of slide"),
        ("--controller slide --events pour", "events must be none for slide (got 'pour')"),
        ("--controller hold --against constant --json", "against must be left out with --json"),
        ("--controller hold --film grip.mp4 --json", "film must be left out with --json (got 'grip.mp4')"),
        ("--controller hold --plot pictures --csv a.csv", "plot must be left out with --csv (got 'pictures')"),
        ("--controller hold --plot pictures --against constant", "plot must be left out with --against"),
        ("--controller hold --film grip.mp4 --sweep actuator", "film must be left out with --sweep (got 'grip.mp4')"),
        ("--controller hold --lerobot made --plot pictures", "lerobot must be left out with --plot (got 'made')"),
        ("--controller hold --tune 2 --sweep actuator", "tune must be left out with --sweep (got 2)"),
        ("--controller hold --against slide", "against must not be used with slide or pivot (got 'slide')"),
        ("--controller slide --hand barrett", "hand must be gripper for slide, pivot (got 'barrett with slide')"),
        (
            "--controller hold --hand barrett --objects ball",
            "objects must be one of jar, case, can for the BarrettHand (got 'ball')",
        ),
        ("--controller hold --against nosuch", "unknown controller 'nosuch'"),
        ("--controller hold --latency-ms -5", "--latency-ms must be from 0 to 1000 (got -5.0)"),
        ("--controller hold --plot pictures --film grip.avi", "--film must end in .gif or .mp4 (got 'grip.avi')"),
        ("--controller hold --bandwidth-hz 0", "actuator.bandwidth_hz must be a finite number above 0 (got 0.0)"),
    ],
)
def test_bad_input_is_reported_in_one_line(words: str, message: str, capsys: Capture) -> None:
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
    assert wilson([True] * 100) == pytest.approx((0.963, 1.0), abs=1e-3)
    assert wilson([True, False]) == pytest.approx((0.095, 0.905), abs=1e-3)
    assert wilson([]) is None
    assert share(0.5, 0.0945, 0.9055) == "50 (9-91)"
    assert share(None, None, None) == "-"
    ours = ControlReport.of("hold", [row(seed, 1.0) for seed in range(10)])
    other = ControlReport.of("constant", [row(seed, 9.0) for seed in range(10)])
    assert paired(ours, other) == (10, 10, 0, (1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
    none = ControlReport.of("hold", [row(0, 1.0, grasped=False)])
    assert paired(none, none) is None


def test_featureless_objects_have_rows_of_their_own() -> None:
    plate = TrialRow(1, "plate", "pour", True, True, 6.0, 3.0)
    scans = [Scans(np.array([False] * 4), np.full(4, 1e-3)), Scans(np.array([True] * 3 + [False]), np.full(4, 2e-3))]
    outcomes = [
        Outcome(ControlReport.of(name, [row(0, slid_mm), plate]), scans) for name, slid_mm in (("a", 1.0), ("b", 9.0))
    ]
    felt, other, featureless, _ = summary(outcomes)
    assert [(one.controller, one.objects, one.trials) for one in (felt, other)] == [("a", "felt", 1), ("b", "felt", 1)]
    assert (felt.blind, featureless.blind, featureless.objects) == (0.0, 0.75, "featureless")
    assert (felt.step_ms_p99, featureless.step_ms_p99) == pytest.approx((1.0, 2.0))
    assert (felt.wins, other.wins, other.losses, other.gain) == (None, 1, 0, 1.0)
    assert featureless.force_p50 == 3.0
    assert (felt.cost, other.cost, other.cost_more, other.cost_more_low) == (0.0, 1.0, 1.0, 1.0)
    rows, trials = tables_of(outcomes)
    assert (len(rows.rows), len(trials.rows)) == (4, 4)
    assert trials.rows[1][:4] == ("a", 1, "plate", "pour")
