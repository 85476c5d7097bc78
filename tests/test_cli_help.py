"""What the command line says to people who are new to it, or mistype."""

from __future__ import annotations

import io
import subprocess
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest

import taxelflow
from rigged import refused
from synthetic import dome, grid_sensor
from taxelflow.cli import main
from taxelflow.pipeline.api import convert, recording
from taxelflow.publish import terminal
from taxelflow.runtime import registry

if TYPE_CHECKING:
    from pathlib import Path

Capture = pytest.CaptureFixture[str]
PALM = grid_sensor(4, 7)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    values = np.random.default_rng(0).normal(0, 100, (60, 28))
    values[20:] += np.array([dome(PALM, 0.0005 * scan) for scan in range(-20, 20)])
    convert(recording(np.arange(60) / 10, values, PALM), tmp_path / "a.npz")
    return tmp_path / "a.npz"


def helped(capsys: Capture, *arguments: str) -> str:
    with pytest.raises(SystemExit) as done:
        main(list(arguments))
    assert not done.value.code
    return capsys.readouterr().out


def test_the_help_of_a_run_lists_every_sink(capsys: Capture) -> None:
    said = helped(capsys, "run", "--help")
    assert [name for name in registry.PARTS["sink"] if f"{name}:" not in said] == []


def test_the_version(capsys: Capture) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"taxelflow {taxelflow.__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["estimat", "a.npz"], "unknown command 'estimat'; did you mean 'estimate'? known are estimate, "),
        (["Estimate", "a.npz"], "did you mean 'estimate'?"),
        (["simulate", "strok"], "unknown scenario 'strok'; did you mean 'stroke'? known are "),
        (["sensors", "shunk-sdh2"], "unknown sensor 'shunk-sdh2'; did you mean 'schunk-sdh2'? known are "),
        (["score", "tabel1"], "unknown score 'tabel1'; did you mean 'table1'? known are "),
        (["quux"], "unknown command 'quux'; known are "),
    ],
    ids=lambda one: "-".join(one) if isinstance(one, list) else "",
)
def test_a_mistyped_name_comes_with_the_nearest(capsys: Capture, arguments: list[str], says: str) -> None:
    assert says in refused(capsys, *arguments)


def test_a_mistyped_method_and_sensor_of_a_recording(capsys: Capture, tmp_path: Path, file: Path) -> None:
    out = tmp_path / "out"
    line = refused(capsys, "estimate", file, "--out", out, "--method", "tempalte")
    assert "unknown method 'tempalte'; did you mean 'template'?" in line
    assert "did you mean 'grid-16x16'?" in refused(capsys, "estimate", file, "--out", out, "--sensor", "grid-16x6")
    assert not out.exists()


@pytest.mark.parametrize("option", [["--method", "template"], ["--method=template"]], ids=" ".join)
def test_help_of_a_method_shows_its_own_options(capsys: Capture, option: list[str]) -> None:
    said = helped(capsys, "estimate", *option, "--help")
    assert "--window-scans" in said
    assert "--monitor.alarms-per-hour" in said
    assert "--window-scans" not in helped(capsys, "estimate", "--help")


def test_help_texts_flow(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    """The lines of a docstring in the source are no lines of the help."""
    monkeypatch.setenv("COLUMNS", "2000")
    said = helped(capsys, "estimate", "--help")
    assert "of two scans, with rotation), the baselines sum" in said
    assert "a ROS 2 bag (directory or .db3), or a directory" in said
    assert "estimate [-h] [ESTIMATE OPTIONS] RECORDING" in said


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["score", "table1", "--strokes", "1"], "taxelflow: --strokes must be at least 2 (got 1)"),
        (["score", "table1", "--strokes=1"], "taxelflow: --strokes must be at least 2 (got 1)"),
        (["info", "{file}", "--condition.contact-on", "-1"], "taxelflow: --condition.contact-on must "),
        (["simulate", "stroke", "--sensing.rate-hz", "0", "--out", "{file}"], "taxelflow: --sensing.rate-hz must "),
    ],
    ids=lambda one: " ".join(one[:3]) if isinstance(one, list) else "",
)
def test_a_wrong_value_is_named_by_its_option(capsys: Capture, file: Path, arguments: list[str], says: str) -> None:
    assert refused(capsys, *(word.format(file=file) for word in arguments)).startswith(says)


def test_help_of_an_unknown_method(capsys: Capture) -> None:
    assert "did you mean 'lnorm'" in refused(capsys, "estimate", "--method", "lnrom", "--help")


def test_several_recordings_or_a_folder_are_refused_with_what_takes_them(
    capsys: Capture, tmp_path: Path, file: Path
) -> None:
    second = file.with_name("b.npz")
    second.write_bytes(file.read_bytes())
    for words in (
        [file, second, "--out", tmp_path / "out"],
        [file, "--out", tmp_path / "out", "--gain", "1.1", second],
    ):
        line = refused(capsys, "estimate", *words)
        assert "takes one recording" in line
        assert "taxelflow batch" in line
    assert "taxelflow batch" in refused(capsys, "estimate", tmp_path, "--out", tmp_path / "out")


def test_json_is_all_that_is_printed(capsysbinary: pytest.CaptureFixture[bytes], tmp_path: Path, file: Path) -> None:
    assert main(["estimate", str(file), "--out", str(tmp_path / "out"), "--json"]) == 0
    said = capsysbinary.readouterr()
    assert said.out == (tmp_path / "out" / "summary.json").read_bytes()


@pytest.mark.long
@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_a_completion_is_printed_for(shell: str) -> None:
    program = "from taxelflow.cli import main; main()"
    command = [sys.executable, "-c", program, "--tyro-print-completion", shell]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert "estimate" in done.stdout
    assert "--method" in done.stdout


# Progress


class Terminal(io.StringIO):
    """A terminal that keeps what is written to it."""

    def isatty(self) -> bool:
        return True


def watched(monkeypatch: pytest.MonkeyPatch, stream: io.StringIO, patience_s: float) -> str:
    """What is written to stderr while three items pass."""
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(terminal, "_PATIENCE_S", patience_s)
    assert list(terminal.counted(["a", "b", "c"], "seeds")) == ["a", "b", "c"]
    blocks = [np.zeros(40), np.zeros(20)]
    assert len(list(terminal.progress(blocks, 60, "estimating"))) == 2
    return stream.getvalue()


def test_a_long_run_shows_what_is_done_and_the_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    said = watched(monkeypatch, Terminal(), 0.0)
    assert "3 of 3 seeds" in said
    assert "estimating" in said
    assert "60 of 60 scans" in said
    assert "left" in said


def test_a_short_run_shows_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    assert "of 3 seeds" not in watched(monkeypatch, Terminal(), 60.0)


def test_nothing_is_shown_where_nobody_watches(monkeypatch: pytest.MonkeyPatch) -> None:
    assert watched(monkeypatch, io.StringIO(), 0.0) == ""
