"""The options that say how a recording is read, as typed."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from bagged import write_bag
from synthetic import dome, grid_sensor, recorded
from taxelflow.cli import main
from taxelflow.pipeline.api import convert, recording
from taxelflow.sensors.catalogue import load_sensor

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


def test_a_bag_is_estimated_with_its_notes_on_the_terminal_and_in_the_summary(
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
    code, out, err = run(capsys, "run", f"replay:{bag}", "--sensor", sensor)
    assert (code, out) == (2, "")
    assert err.endswith(f"choose one with ?topic=NAME: /left ({TOUCH}), /right ({TOUCH})\n")
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


def test_times_in_a_wrong_unit_are_reported(tmp_path: Path, sensor: Path, capsys: Capture) -> None:
    convert(recorded(VALUES, PALM, t_s=100.0 * np.arange(70)), tmp_path / "a.csv")
    code, out, err = run(capsys, "info", tmp_path / "a.csv", "--sensor", sensor, "--json")
    assert code == 0
    assert "a rate of 0.01 Hz is implausible for a tactile sensor: the times are likely in ms" in err
    assert json.loads(out)["notes"]


def test_columns_mean_nothing_for_a_bag(tmp_path: Path, sensor: Path, capsys: Capture) -> None:
    bag = write_bag(tmp_path / "a.bag", {"/touch": (TOUCH, [[row] for row in VALUES])})
    code, _, err = run(capsys, "info", bag, "--sensor", sensor, "--columns.skip", 1)
    assert code == 2
    assert "must be left out for .bag recordings" in err


@pytest.mark.parametrize(
    "words",
    [
        ("info",),
        ("info", "--json"),
        ("convert", "b.npz"),
        ("estimate", "--out", "out"),
        ("estimate", "--out=o", "--json"),
    ],
    ids=" ".join,
)
def test_what_was_lost_is_reported_though_the_reader_has_left(
    tmp_path: Path, sensor: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    convert(recorded(VALUES, PALM), tmp_path / "a.csv")
    (tmp_path / "a.csv").write_text((tmp_path / "a.csv").read_text()[:-100])
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "w") as closed, monkeypatch.context() as here:  # noqa: PTH123 - a descriptor
        here.setattr(sys, "stdout", closed)
        code = main([words[0], "a.csv", *words[1:], "--sensor", str(sensor)])
    assert code == 1
    assert "a.csv is truncated: 69 scans could be read" in capsys.readouterr().err


@pytest.mark.long
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


def test_an_unindexed_bag_is_one_line_that_names_the_command_to_run(
    tmp_path: Path, sensor: Path, capsys: Capture
) -> None:
    bag = write_bag(tmp_path / "a.bag", {"/touch": (TOUCH, [[row] for row in VALUES])})
    bag.write_bytes(bag.read_bytes()[:-100])
    code, out, err = run(capsys, "estimate", bag, "--sensor", sensor, "--out", tmp_path / "out")
    assert (code, out) == (2, "")
    assert "run `rosbag reindex a.bag`" in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("name", "content", "options", "says"),
    [
        ("a.mcap", "", [], "cannot read a.mcap: the file is empty; record or copy it again"),
        ("log", "t_s,p0\n", [], "no reader for log: it has no suffix; known are .npz, .csv, "),
        ("a.csv", "t_s;p0;p1\n0;1;2\n", [], "set --columns.delimiter ';'"),
        ("a.npz", "PK", ["--columns.time", "t"], "must be left out for .npz recordings: it has no meaning there (got "),
        ("a.npz", "PK", ["--columns.time", "t"], "(got {'time': 't'})"),
        ("/dev/null", None, [], "recording /dev/null is a device or pipe; give the path of a regular file"),
    ],
)
def test_what_cannot_be_a_recording_is_named(
    tmp_path: Path,
    sensor: Path,
    capsys: Capture,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    content: str | None,
    options: list[str],
    says: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    if content is None and not Path(name).exists():
        pytest.skip("this system has no such device")
    if content is not None:
        Path(name).write_text(content)
    code, out, err = run(capsys, "info", name, "--sensor", sensor, *options)
    assert (code, out) == (2, "")
    assert says in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("reading", [np.nan, 0.0])
def test_a_recording_of_constant_readings_is_reported(
    tmp_path: Path, sensor: Path, capsys: Capture, reading: float
) -> None:
    convert(recorded(np.full((60, 28), reading), PALM), tmp_path / "a.csv")
    code, out, err = run(capsys, "info", tmp_path / "a.csv", "--sensor", sensor, "--json")
    assert code == 0
    assert json.loads(out)["pads"][0]["noise"] is None
    assert "no contact: no pad was touched in this recording" in err


def test_the_threshold_of_contact_decides_which_taxels_were_loaded(
    tmp_path: Path, sensor: Path, capsys: Capture
) -> None:
    convert(recorded(VALUES, PALM), tmp_path / "a.csv")
    idle = []
    for threshold in (6.0, 400.0):
        code, out, _ = run(
            capsys, "info", tmp_path / "a.csv", "--sensor", sensor, "--condition.contact-on", threshold, "--json"
        )
        assert code == 0
        idle.append(len(json.loads(out)["pads"][0]["idle_taxels"]))
    assert idle[0] < idle[1]


@pytest.mark.parametrize(
    ("name", "joints", "says"),
    [
        ("grid:4x7@10mm", "spread=1", "sensor grid:4x7@10mm has no [hand]; leave --joints out"),
        ("schunk-sdh2", "sdh_thumb_9_joint=1", "the hand has no joint 'sdh_thumb_9_joint', only sdh_knuckle_joint, "),
    ],
)
def test_joints_that_no_hand_has_are_refused(
    tmp_path: Path, capsys: Capture, name: str, joints: str, says: str
) -> None:
    pytest.importorskip("mujoco")
    chosen = load_sensor(name)
    convert(recording(np.arange(20) / 10, np.zeros((20, chosen.layout.taxels)), chosen), tmp_path / "a.npz")
    code, out, err = run(capsys, "info", tmp_path / "a.npz", "--joints", joints)
    assert (code, out) == (2, "")
    assert says in err
