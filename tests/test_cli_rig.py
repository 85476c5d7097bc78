from __future__ import annotations

import json
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from costly import mostly_long
from rigged import estimated, refused, rigged, strokes_by_both
from synthetic import assert_same, grid_sensor, recorded
from taxelflow.cli import main
from taxelflow.evaluation.bench import bench
from taxelflow.evaluation.bench_effort import Effort
from taxelflow.evaluation.bench_peers import PeerBench, PeerLatency
from taxelflow.pipeline.api import read
from taxelflow.simulation.scenario import DESCRIPTIONS, SCENARIOS
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.simulation.scenario import Scenario

Capture = pytest.CaptureFixture[str]
nan = float("nan")


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return strokes_by_both(tmp_path_factory.mktemp("stroke"))


def parameters(path: Path) -> dict[str, Any]:
    with np.load(path) as file:
        told: dict[str, Any] = json.loads(str(file["parameters"]))
    return told


def ended(arguments: list[str]) -> object:
    try:
        return main(arguments)
    except SystemExit as end:
        return end.code


# simulate


@pytest.mark.parametrize("name", mostly_long(SCENARIOS, "stroke", "two-contacts", "hold-at-edge"))
def test_each_scenario_may_be_asked_for_by_its_name(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    asked: list[tuple[Scenario, Path]] = []
    made = recorded(np.zeros((3, 28)), grid_sensor(4, 7))
    monkeypatch.setattr("taxelflow.simulation.simulate.save", lambda *words: (asked.append(words), made)[1])
    path = tmp_path / "a.npz"
    assert main(["simulate", name, "--out", str(path), "--sensing.rate-hz", "5"]) == 0
    assert asked == [(rigged(name, sensing={"rate_hz": 5.0}), path)]
    assert capsys.readouterr().out == f"3 scans of {made.sensor.name} in {path}\n"


def test_what_is_simulated_is_written(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "a.npz"
    assert main(["simulate", "slide-and-turn", "--out", str(path), "--sensing.rate-hz", "5"]) == 0
    made = simulate(rigged("slide-and-turn", sensing={"rate_hz": 5.0}))
    assert_same(read(path).load(), made.load())
    assert capsys.readouterr().out == f"{made.scans} scans of {made.sensor.name} in {path}\n"
    assert list(tmp_path.iterdir()) == [path]


def test_every_parameter_may_be_overridden(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    options = {
        "--seed": "5",
        "--pad": "finger1_mid",
        "--contact.shape": "hertz",
        "--contact.peak-pa": "5e4",
        "--motion.speed-m-s": "0.04",
        "--motion.strokes": "1",
        "--sensing.rate-hz": "20",
    }
    arguments = [word for pair in options.items() for word in pair]
    pairs = ["--motion.middle-m", "0.001", "0.002", "--sensing.baseline-pa", "0", "100", "--sensing.dead", "3", "8"]
    assert main(["simulate", "stroke", "--out", str(path), *arguments, *pairs]) == 0
    told = parameters(path)
    assert (told["seed"], told["pad"], told["sensor"]) == (5, "finger1_mid", "barretthand-162")
    assert (told["contact"]["shape"], told["contact"]["peak_pa"]) == ("hertz", 5e4)
    assert (told["motion"]["speed_m_s"], told["motion"]["strokes"]) == (0.04, 1)
    assert told["motion"]["middle_m"] == [0.001, 0.002]
    assert told["sensing"]["rate_hz"] == 20.0
    assert (told["sensing"]["baseline_pa"], told["sensing"]["dead"]) == ([0.0, 100.0], [3, 8])
    assert told["contact"]["radius_m"] == SCENARIOS["stroke"].contact.radius_m


def test_the_speed_of_the_command_line_is_the_truths(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    assert main(["simulate", "stroke", "--out", str(path), "--motion.speed-m-s", "0.04"]) == 0
    truth = read(path).truth
    assert truth is not None
    speed = np.abs(np.diff(truth.pose[:, 0]) / np.diff(truth.t_s))
    assert speed.max() == pytest.approx(0.04)
    assert np.median(speed[speed > 1e-9]) == pytest.approx(0.04)


def test_a_simulation_of_the_command_line_is_estimated_and_looked_at_without_more_words(
    tmp_path: Path, capsys: Capture
) -> None:
    path = tmp_path / "a.npz"
    assert main(["simulate", "slide-and-turn", "--out", str(path)]) == 0
    assert main(["info", str(path)]) == 0
    assert "schunk-sdh2" in capsys.readouterr().out
    summary = json.loads((estimated(path, tmp_path / "out") / "summary.json").read_text())
    assert summary["pads"]["finger2_proximal"]["contact_scans"] > 100


def test_a_second_simulation_replaces_the_first(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    for seed in ("1", "2"):
        assert main(["simulate", "turn", "--out", str(path), "--seed", seed]) == 0
        assert parameters(path)["seed"] == int(seed)


@pytest.mark.parametrize("name", ["a.csv", "a", "a.npz.txt", ".npz"])
def test_an_output_that_is_no_npz(tmp_path: Path, capsys: Capture, name: str) -> None:
    line = refused(capsys, "simulate", "stroke", "--out", tmp_path / name)
    assert name in line
    assert ".npz" in line
    assert list(tmp_path.iterdir()) == []


def test_the_directory_of_the_output_is_made(tmp_path: Path, capsys: Capture) -> None:
    assert main(["simulate", "turn", "--out", str(tmp_path / "deep" / "a.npz")]) == 0
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["a.npz"]
    capsys.readouterr()
    assert "a.npz" in refused(capsys, "simulate", "turn", "--out", tmp_path / "deep" / "a.npz" / "b.npz")


def test_an_output_that_is_a_directory_is_left_alone(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "a.npz").mkdir()
    assert "a.npz" in refused(capsys, "simulate", "turn", "--out", tmp_path / "a.npz")
    assert list((tmp_path / "a.npz").iterdir()) == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--pad", "plam"], ["unknown pad 'plam'", "finger1_tip", "palm"]),
        (["--sensor", "barret"], ["unknown sensor 'barret'", "barretthand-162", "schunk-sdh2"]),
        (["--motion.speed-m-s", "0"], ["motion.speed-m-s must", "(got 0.0)"]),
        (["--motion.strokes", "0"], ["motion.strokes must", "(got 0)"]),
        (["--motion.rest-s", "-1"], ["motion.rest-s", "-1.0"]),
        (["--motion.rest-s", "nan"], ["motion.rest-s", "nan"]),
        (["--motion.travel-m", "inf"], ["motion.travel-m", "inf"]),
        (["--contact.radius-m", "-0.01"], ["contact.radius-m must", "(got -0.01)"]),
        (["--sensing.bits", "64"], ["sensing.bits must", "(got 64)", "between 1 and 32"]),
        (["--sensing.noise-pa", "-5"], ["sensing.noise-pa", "-5.0"]),
        (["--sensing.active-share", "1.5"], ["sensing.active-share must", "(got 1.5)"]),
        (["--sensing.baseline-pa", "4e3", "1e3"], ["sensing.baseline-pa", "4000.0"]),
        (["--sensing.dead", "162"], ["sensing.dead must", "(got 162)", "between 0 and 161"]),
        (["--seed", "-1"], ["seed", "-1"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_a_bad_parameter_is_one_line(tmp_path: Path, capsys: Capture, options: list[str], words: list[str]) -> None:
    line = refused(capsys, "simulate", "stroke", "--out", tmp_path / "a.npz", *options)
    for word in words:
        assert word in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "arguments",
    [
        ["simulate"],
        ["simulate", "stroke"],
        ["simulate", "dance", "--out", "a.npz"],
        ["simulate", "stroke", "--out", "a.npz", "--motion.speed", "1"],
        ["simulate", "stroke", "--out", "a.npz", "--contact.shape", "square"],
        ["simulate", "stroke", "--out", "a.npz", "--seed", "one"],
        ["plot", "a", "--format", "gif"],
        ["bench", "--rounds", "3"],
    ],
    ids=" ".join,
)
def test_a_command_that_is_not_understood_ends_with_2(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    assert ended(arguments) == 2
    said = capsys.readouterr()
    assert said.err or said.out
    assert list(tmp_path.iterdir()) == []


def test_help_lists_the_scenarios_with_what_they_do(capsys: Capture) -> None:
    assert ended(["simulate", "--help"]) == 0
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for name, description in DESCRIPTIONS.items():
        assert name in said
        assert description.split(":")[0].split(",")[0][:25] in said


def test_help_of_a_scenario_has_units_and_defaults(capsys: Capture) -> None:
    assert ended(["simulate", "fast-stroke", "--help"]) == 0
    said = capsys.readouterr().out
    for word in ("--motion.speed-m-s", "m/s", "0.05", "--sensing.noise-pa", "750", "--contact.shape", "hertz"):
        assert word in said


# plot


@pytest.mark.long
def test_plot_names_the_pictures_it_has_drawn(results: list[Path], tmp_path: Path, capsys: Capture) -> None:
    form = "png"  # every form is drawn in evaluation/test_plot
    arguments = ["plot", *map(str, results), "--out", str(tmp_path), "--format", form]
    assert main(arguments) == 0
    named = capsys.readouterr().out.splitlines()
    assert named == [
        str(tmp_path / f"{name}.{form}") for name in ("position-palm", "path-lnorm", "path-convolution", "views")
    ]
    assert sorted(named) == sorted(map(str, tmp_path.iterdir()))


@pytest.mark.long
def test_plot_draws_into_the_first_result_by_default(results: list[Path], capsys: Capture) -> None:
    before = set(results[1].iterdir())
    assert main(["plot", str(results[1])]) == 0
    named = capsys.readouterr().out.splitlines()
    assert sorted(path.name for path in set(results[1].iterdir()) - before) == [
        "path-convolution.svg",
        "position-palm.svg",
        "views.svg",
    ]
    assert len(named) == 3


def test_plot_of_nothing(capsys: Capture) -> None:
    assert "at least one directory" in refused(capsys, "plot")


def test_plot_of_what_is_no_result(results: list[Path], tmp_path: Path, capsys: Capture) -> None:
    assert "holds no summary.json" in refused(capsys, "plot", tmp_path)
    assert "holds no summary.json" in refused(capsys, "plot", results[0], tmp_path / "none")
    assert list(tmp_path.iterdir()) == []


def test_plot_of_two_recordings(results: list[Path], tmp_path: Path, capsys: Capture) -> None:
    main(["simulate", "turn", "--out", str(tmp_path / "turn.npz")])
    other = estimated(tmp_path / "turn.npz", tmp_path / "turn")
    assert "same recording" in refused(capsys, "plot", results[0], other, "--out", tmp_path / "out")


def test_plot_into_a_file(results: list[Path], tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "out").write_text("mine")
    assert "out" in refused(capsys, "plot", results[0], "--out", tmp_path / "out")
    assert (tmp_path / "out").read_text() == "mine"


# bench


def hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few rounds on no sensor; processes are not started."""
    monkeypatch.setattr("taxelflow.evaluation.bench._sensors", list)
    quick = Effort(batch_bytes=200_000, batch_rounds=2, large=((4, 6, 30),), large_rounds=1, peer_rounds=5, peer_warm=2)
    monkeypatch.setattr("taxelflow.evaluation.bench.bench", partial(bench, effort=quick))
    monkeypatch.setattr("taxelflow.evaluation.bench.subprocess.run", lambda *_arguments, **_more: None)


def test_bench_prints_its_tables(results: list[Path], monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    hurry(monkeypatch)
    monkeypatch.setattr("taxelflow.evaluation.bench.bench_peers", lambda *_: PeerBench([], "not asked for"))
    recording = json.loads((results[0] / "summary.json").read_text())["input"]
    assert main(["bench", "--recording", recording]) == 0
    said = capsys.readouterr().out
    for word in ("140 scans of", "parsing", "conditioning", "estimating", "writing", "%", "4x6", "taxelflow --help"):
        assert word in said


@pytest.mark.long
def test_bench_times_opencv_or_states_why_not(
    results: list[Path], monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    hurry(monkeypatch)
    monkeypatch.setattr("taxelflow.evaluation.bench.reading_rates", lambda *_arguments: [])
    recording = json.loads((results[0] / "summary.json").read_text())["input"]
    skipped = PeerBench([], "cv2 is not installed")
    timed = PeerBench([PeerLatency("cv2.phaseCorrelate, 7 pads", 30.0, 40.0, 1.0, 1.0)])
    for made, words in ((skipped, "not timed: cv2 is not installed"), (timed, "30.0    40.0   1.00")):
        monkeypatch.setattr("taxelflow.evaluation.bench.bench_peers", lambda *_, made=made: made)
        assert main(["bench", "--recording", recording]) == 0
        assert words in capsys.readouterr().out


@pytest.mark.long
def test_bench_gives_json(
    results: list[Path], monkeypatch: pytest.MonkeyPatch, capsysbinary: pytest.CaptureFixture[bytes]
) -> None:
    hurry(monkeypatch)
    recording = json.loads((results[0] / "summary.json").read_text())["input"]
    assert main(["bench", "--recording", recording, "--json"]) == 0
    whole = json.loads(capsysbinary.readouterr().out)
    assert (whole["recording"], whole["scans"], whole["latencies"]) == ("stroke.npz", 140, [])
    assert sum(share["share"] for share in whole["shares"]) == pytest.approx(1)


def test_bench_of_a_missing_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    hurry(monkeypatch)
    assert "does not exist" in refused(capsys, "bench", "--recording", tmp_path / "none.npz")
