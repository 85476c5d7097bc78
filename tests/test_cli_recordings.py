"""The options that say how a recording is read, as typed."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bagged import write_bag
from synthetic import dome, grid_sensor, recorded
from taxelflow.api import convert
from taxelflow.cli import main

if TYPE_CHECKING:
    from pathlib import Path

    Capture = pytest.CaptureFixture[str]

SENSOR = """name = "plain"
unit = "Pa"
[[pads]]
name = "pad"
rows = 4
cols = 7
pitch_m = [0.01, 0.01]
"""
PALM = grid_sensor(4, 7)
VALUES = np.concatenate(
    [np.zeros((20, 28)), [dome(PALM, x) for x in np.linspace(-0.02, 0.02, 30)], np.zeros((20, 28))]
) + np.random.default_rng(0).normal(0, 100, (70, 28))
TOUCH = "std_msgs/msg/Float64MultiArray"


@pytest.fixture
def sensor(tmp_path: Path) -> Path:
    path = tmp_path / "plain.toml"
    path.write_text(SENSOR)
    return path


def run(capsys: Capture, *arguments: object) -> tuple[int, str, str]:
    code = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return code, out, err


def test_a_bag_is_estimated_and_what_is_odd_is_said_on_the_terminal_and_in_the_summary(
    tmp_path: Path, sensor: Path, capsys: Capture
) -> None:
    bag = write_bag(tmp_path / "a.bag", {"/touch": (TOUCH, [[row] for row in VALUES])}, period_s=0.1)
    code, out, err = run(capsys, "estimate", bag, "--sensor", sensor, "--out", tmp_path / "out")
    note = "messages have no stamp: times are those of receipt"
    assert code == 0
    assert "70 scans of plain" in out
    assert f"taxelflow: {note}\n" in err
    assert note in json.loads((tmp_path / "out" / "summary.json").read_text())["notes"]


def test_two_topics_are_one_line_with_their_names_until_one_is_chosen(
    tmp_path: Path, sensor: Path, capsys: Capture
) -> None:
    scans = [[row] for row in VALUES]
    bag = write_bag(tmp_path / "a.bag", {"/left": (TOUCH, scans), "/right": (TOUCH, scans[:30])})
    code, out, err = run(capsys, "info", bag, "--sensor", sensor)
    assert (code, out) == (2, "")
    assert err.endswith(f"choose one with --topic: /left ({TOUCH}), /right ({TOUCH})\n")
    assert err.count("\n") == 1
    code, out, _ = run(capsys, "info", bag, "--sensor", sensor, "--topic", "/right", "--json")
    assert code == 0
    assert json.loads(out)["scans"] == 30


def test_a_log_is_mapped_on_the_command_line_or_by_a_file(tmp_path: Path, sensor: Path, capsys: Capture) -> None:
    log = tmp_path / "log.txt"
    rows = [f"{100 * number} x " + " ".join(map(str, row)) for number, row in enumerate(VALUES.tolist())]
    log.write_text("# my logger\nms side " + " ".join(f"p{k}" for k in range(28)) + "\n" + "\n".join(rows) + "\n")
    options = ["--columns.skip", 1, "--columns.time", "ms", "--columns.time-unit", "ms", "--columns.taxels", "p*"]
    code, out, err = run(capsys, "info", log, "--sensor", sensor, *options, "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["rate_hz"] == pytest.approx(10)
    mapping = tmp_path / "log.toml"
    mapping.write_text('skip = 1\ntime = "ms"\ntime_unit = "ms"\ntaxels = ["p*"]\n')
    code, same, _ = run(capsys, "info", log, "--sensor", sensor, "--columns.file", mapping, "--json")
    assert (code, same) == (0, out)


def test_times_in_a_wrong_unit_are_told(tmp_path: Path, sensor: Path, capsys: Capture) -> None:
    convert(recorded(VALUES, PALM, t_s=100.0 * np.arange(70)), tmp_path / "a.csv")
    code, out, err = run(capsys, "info", tmp_path / "a.csv", "--sensor", sensor, "--json")
    assert code == 0
    assert "a rate of 0.01 Hz is implausible for a tactile sensor: they are likely in ms" in err
    assert json.loads(out)["notes"]


def test_columns_mean_nothing_for_a_bag(tmp_path: Path, sensor: Path, capsys: Capture) -> None:
    bag = write_bag(tmp_path / "a.bag", {"/touch": (TOUCH, [[row] for row in VALUES])})
    code, _, err = run(capsys, "info", bag, "--sensor", sensor, "--columns.skip", 1)
    assert code == 2
    assert "must be left out for .bag recordings" in err


def test_a_truncated_mcap_is_estimated_as_far_as_it_goes(tmp_path: Path, capsys: Capture) -> None:
    noise = np.random.default_rng(1).normal(0, 100, (14000, 28))
    convert(recorded(np.tile(VALUES, (200, 1)) + noise, PALM), tmp_path / "a.mcap")
    content = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "a.mcap").write_bytes(content[: len(content) // 2])
    code, out, err = run(capsys, "estimate", tmp_path / "a.mcap", "--out", tmp_path / "out")
    assert code == 1
    assert "is truncated" in err
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert 2000 < summary["scans"] < 14000
    assert f"{summary['scans']} scans of grid" in out


def test_an_unindexed_bag_is_one_line_that_says_what_to_run(tmp_path: Path, sensor: Path, capsys: Capture) -> None:
    bag = write_bag(tmp_path / "a.bag", {"/touch": (TOUCH, [[row] for row in VALUES])})
    bag.write_bytes(bag.read_bytes()[:-100])
    code, out, err = run(capsys, "estimate", bag, "--sensor", sensor, "--out", tmp_path / "out")
    assert (code, out) == (2, "")
    assert "run `rosbag reindex a.bag`" in err
    assert err.count("\n") == 1
