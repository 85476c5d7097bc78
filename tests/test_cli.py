from __future__ import annotations

import bz2
import csv
import json
import os
import re
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest

import taxelflow
from costly import mostly_long
from rigged import refused
from synthetic import DsaMatrix, dome, dsa_words, dsa_xml, grid_sensor, raw_scans, write_dsa
from taxelflow.acquire.base import Recording
from taxelflow.cli import main
from taxelflow.publish.results import read_result
from taxelflow.runtime import registry
from taxelflow.sensors import catalogue

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from taxelflow.messages import Floats, RawScans
    from taxelflow.sensors.sensor import Sensor

PALM = grid_sensor(4, 7)
CONTRACT = [
    "t_s",
    "pad",
    "contact",
    "dx_m",
    "dy_m",
    "dtheta_rad",
    "x_m",
    "y_m",
    "theta_rad",
    "vx_m_s",
    "vy_m_s",
    "omega_rad_s",
    "std_x_m",
    "std_y_m",
    "std_theta_rad",
    "slipping",
]
TOML = 'name = "hand"\nunit = "Pa"\n[[pads]]\nname = "palm"\nrows = 4\ncols = 7\npitch_m = [0.01, 0.01]\n'
Capture = pytest.CaptureFixture[str]
both_modes = pytest.mark.parametrize("mode", ["batch", "stream"])


def grasp(scans: int = 60) -> Floats:
    values: Floats = np.random.default_rng(0).normal(0, 100, (scans, 28))
    for scan in range(20, scans):
        values[scan] += dome(PALM, 0.0005 * (scan - 40))
    return values


def save_npz(path: Path, values: Floats | None = None, t_s: Any = None, sensor: Sensor | None = PALM) -> Path:
    values = grasp() if values is None else values
    members: dict[str, Any] = {"t": np.arange(len(values)) / 10 if t_s is None else t_s, "pressure": values}
    if sensor is not None:
        members["sensor"] = msgspec.json.encode(sensor).decode()
    np.savez(path, **members)
    return path


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def refused_estimate(capsys: Capture, tmp_path: Path, recording: Path, *more: object) -> str:
    return refused(capsys, "estimate", recording, "--out", tmp_path / "out", *more)


# What estimate writes


@both_modes
@pytest.mark.parametrize("method", ["lnorm", "convolution"])
def test_estimate_writes_its_files_and_nothing_else(tmp_path: Path, capsys: Capture, method: str, mode: str) -> None:
    out = tmp_path / "deep" / "out"
    file = save_npz(tmp_path / "a.npz")
    assert main(["estimate", str(file), "--out", str(out), "--method", method, "--mode", mode]) == 0
    assert sorted(path.name for path in out.iterdir()) == [
        "contacts.csv",
        "events.csv",
        "object.csv",
        "slips.csv",
        "summary.json",
    ]
    said = capsys.readouterr()
    assert str(out) in said.out.replace("\n", "")
    assert "Traceback" not in said.err


def test_the_columns_of_slips_are_the_contracts_and_then_more(tmp_path: Path) -> None:
    main(["estimate", str(save_npz(tmp_path / "a.npz")), "--out", str(tmp_path)])
    rows = rows_of(tmp_path / "slips.csv")
    assert list(rows[0])[: len(CONTRACT)] == CONTRACT
    assert len(rows) == 60


def test_values_are_numbers_flags_or_empty(tmp_path: Path) -> None:
    main(["estimate", str(save_npz(tmp_path / "a.npz")), "--out", str(tmp_path)])
    for row in rows_of(tmp_path / "slips.csv"):
        assert row["contact"] in ("0", "1")
        assert row["slipping"] in ("0", "1")
        assert row["dtheta_rad"] == row["theta_rad"] == row["omega_rad_s"] == row["std_theta_rad"] == ""
        for name in ("dx_m", "x_m", "vx_m_s", "std_x_m"):
            assert row[name] == "" or np.isfinite(float(row[name]))
        assert (row["dx_m"] == "") == (row["vx_m_s"] == "")
        assert (row["x_m"] == "") == (row["std_x_m"] == "")


def test_a_row_per_scan_and_pad_in_time_order(tmp_path: Path) -> None:
    sensor = grid_sensor(2, 3, pads=3)
    save_npz(tmp_path / "a.npz", np.zeros((20, 18)), sensor=sensor)
    main(["estimate", str(tmp_path / "a.npz"), "--out", str(tmp_path)])
    rows = rows_of(tmp_path / "slips.csv")
    assert [row["pad"] for row in rows] == ["pad0", "pad1", "pad2"] * 20
    t_s = [float(row["t_s"]) for row in rows]
    assert t_s == sorted(t_s)


def test_times_keep_scans_distinct(tmp_path: Path) -> None:
    t_s = 1.7e9 + np.arange(60) * 1e-4
    main(["estimate", str(save_npz(tmp_path / "a.npz", t_s=t_s)), "--out", str(tmp_path)])
    written = [float(row["t_s"]) for row in rows_of(tmp_path / "slips.csv")]
    assert (np.diff(written) > 0).all()


def test_events_are_those_of_the_contract_in_time_order(tmp_path: Path) -> None:
    main(["estimate", str(save_npz(tmp_path / "a.npz")), "--out", str(tmp_path)])
    rows = rows_of(tmp_path / "events.csv")
    assert list(rows[0])[:4] == ["t_s", "pad", "event", "onset_s"]
    assert rows[0]["event"] == "contact"
    assert {row["event"] for row in rows} <= {"contact", "release", "slip_start", "slip_stop", "slip_suspected"}
    t_s = [float(row["t_s"]) for row in rows]
    assert t_s == sorted(t_s)


def test_the_summary_names_recording_method_and_parameters(tmp_path: Path) -> None:
    file = save_npz(tmp_path / "a.npz")
    main(["estimate", str(file), "--out", str(tmp_path), "--method", "lnorm", "--gain", "1.04", "--mode", "stream"])
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["taxelflow"] == taxelflow.__version__
    assert (summary["input"], summary["format"], summary["sensor"]) == (str(file), "npz", "grid")
    assert (summary["method"], summary["mode"]) == ("lnorm", "stream")
    assert summary["parameters"]["method"] == {"gain": 1.04}
    assert summary["scans"] == 60
    assert summary["contact"] is True


def test_parameters_of_the_stages_are_options(tmp_path: Path) -> None:
    arguments = ["--condition.tare", "none", "--condition.contact-on", "9", "--monitor.settle-s", "0.2"]
    arguments += ["--fusion.edge-doubt", "0.5"]
    assert main(["estimate", str(save_npz(tmp_path / "a.npz")), "--out", str(tmp_path), *arguments]) == 0
    parameters = json.loads((tmp_path / "summary.json").read_text())["parameters"]
    assert (parameters["condition"]["tare"], parameters["condition"]["contact_on"]) == ("none", 9.0)
    assert parameters["monitor"]["settle_s"] == 0.2
    assert parameters["fusion"] == {"edge_doubt": 0.5}


@pytest.mark.parametrize("option", [["--gain", "1.04"], ["--gain=1.04"]], ids=" ".join)
@pytest.mark.parametrize("place", [2, 4])
def test_a_methods_own_option_may_stand_anywhere_after_the_recording(
    tmp_path: Path, option: list[str], place: int
) -> None:
    arguments = ["estimate", str(save_npz(tmp_path / "a.npz")), "--out", str(tmp_path)]
    assert main([*arguments[:place], *option, *arguments[place:]]) == 0
    assert json.loads((tmp_path / "summary.json").read_text())["parameters"]["method"] == {"gain": 1.04}


@pytest.mark.long
@both_modes
def test_contacts_have_rows_of_their_own_that_are_read_back_and_drawn(tmp_path: Path, mode: str) -> None:
    wide = grid_sensor(8, 16)
    values: Floats = np.random.default_rng(0).normal(0, 100, (60, 128))
    for scan in range(20, 60):
        way = 0.0005 * (scan - 40)
        values[scan] += dome(wide, -0.05 + way, radius_m=0.006) + dome(wide, 0.05, way, radius_m=0.006, peak=30e3)
    recording, out = save_npz(tmp_path / "a.npz", values, sensor=wide), tmp_path / "out"
    asked = ("--out", str(out), "--mode", mode, "--contacts", "pad0=2")
    assert main(["estimate", str(recording), *asked]) == 0
    rows = rows_of(out / "slips.csv")
    assert [row["pad"] for row in rows[:3]] == ["pad0", "pad0#1", "pad0#2"]
    assert len(rows) == 3 * 60
    summary, tracks = read_result(out)
    assert list(summary.pads) == [track.pad for track in tracks] == ["pad0", "pad0#1", "pad0#2"]
    assert summary.layout.pads[0].contacts == 2
    moved = [np.ptp(track.position_m[track.flags["contact"]][2:-2], axis=0) for track in tracks[1:]]
    assert moved[0][0] > 5 * moved[0][1]
    assert moved[1][1] > 5 * moved[1][0]
    assert {row["pad"] for row in rows_of(out / "contacts.csv")} == {"pad0", "pad0#1", "pad0#2"}
    assert {row["pad"] for row in rows_of(out / "events.csv")} >= {"pad0#1", "pad0#2"}
    if mode == "batch":
        assert main(["plot", str(out), "--out", str(tmp_path / "pictures")]) == 0
        assert (tmp_path / "pictures" / "position-pad0_1.svg").is_file()


@pytest.mark.long
def test_a_result_is_drawn_with_its_recording_from_any_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    save_npz(tmp_path / "a.npz")
    assert main(["estimate", "a.npz", "--out", "out"]) == 0
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path / "other")
    capsys.readouterr()
    assert main(["plot", "../out"]) == 0
    assert (tmp_path / "out" / "views.svg").is_file()
    assert capsys.readouterr().err == ""
    (tmp_path / "a.npz").unlink()
    assert main(["plot", "../out", "--out", "later"]) == 0
    assert not (tmp_path / "other" / "later" / "views.svg").exists()
    line = f"taxelflow: recording {tmp_path / 'a.npz'} not found: truth and pictures of scans are left out\n"
    assert capsys.readouterr().err == line


def test_contacts_of_a_pad_that_the_sensor_lacks(tmp_path: Path, capsys: Capture) -> None:
    line = refused_estimate(capsys, tmp_path, save_npz(tmp_path / "a.npz"), "--contacts", "palm=2")
    assert line == "taxelflow: unknown pad 'palm'; known are pad0\n"


@both_modes
def test_a_recording_without_contact_gives_a_result_that_reports_it(tmp_path: Path, capsys: Capture, mode: str) -> None:
    values = np.random.default_rng(0).normal(0, 100, (50, 28))
    file = save_npz(tmp_path / "a.npz", values)
    assert main(["estimate", str(file), "--out", str(tmp_path / "out"), "--mode", mode]) == 0
    assert "no contact" in capsys.readouterr().err
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["contact"] is False
    assert any("no contact" in note for note in summary["notes"])
    assert len(rows_of(tmp_path / "out" / "slips.csv")) == 50
    assert rows_of(tmp_path / "out" / "events.csv") == []


def test_repeated_stamps_are_dropped_and_counted(tmp_path: Path) -> None:
    t_s = np.arange(60) / 10
    t_s[[31, 32]] = t_s[30]
    assert main(["estimate", str(save_npz(tmp_path / "a.npz", t_s=t_s)), "--out", str(tmp_path)]) == 0
    assert json.loads((tmp_path / "summary.json").read_text())["repeated_scans_dropped"] == 2
    assert len(rows_of(tmp_path / "slips.csv")) == 58


def test_a_csv_needs_a_sensor_and_takes_a_file(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "a.csv"
    lines = ["t_s," + ",".join(f"taxel{k}" for k in range(28))]
    lines += [f"{scan / 10}," + ",".join(f"{value:.3f}" for value in row) for scan, row in enumerate(grasp())]
    path.write_text("\n".join(lines) + "\n")
    assert "--sensor" in refused_estimate(capsys, tmp_path, path)
    (tmp_path / "hand.toml").write_text(TOML)
    assert main(["estimate", str(path), "--sensor", str(tmp_path / "hand.toml"), "--out", str(tmp_path / "out")]) == 0
    assert len(rows_of(tmp_path / "out" / "slips.csv")) == 60


def test_a_second_run_replaces_the_first(tmp_path: Path) -> None:
    out = str(tmp_path / "out")
    main(["estimate", str(save_npz(tmp_path / "a.npz")), "--out", out])
    main(["estimate", str(save_npz(tmp_path / "b.npz", grasp(40))), "--out", out])
    assert len(rows_of(tmp_path / "out" / "slips.csv")) == 40
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["scans"] == 40


# What is refused


def test_a_missing_recording(tmp_path: Path, capsys: Capture) -> None:
    assert "does not exist" in refused_estimate(capsys, tmp_path, tmp_path / "none.npz")
    assert not (tmp_path / "out").exists()


def test_a_directory_for_a_recording(tmp_path: Path, capsys: Capture) -> None:
    assert "is a directory" in refused_estimate(capsys, tmp_path, tmp_path)


@pytest.mark.parametrize("name", ["a.xyz", "a", "a.pkl", "a.dsa.gz"])
def test_an_unknown_suffix_with_the_known_ones(tmp_path: Path, capsys: Capture, name: str) -> None:
    (tmp_path / name).write_bytes(b"x")
    assert ".npz, .csv, .dsa" in refused_estimate(capsys, tmp_path, tmp_path / name)


CORRUPT = {
    "empty.npz": b"",
    "text.npz": b"hello",
    "cut.npz": b"PK\x03\x04" + bytes(40),
    "empty.csv": b"",
    "binary.csv": bytes(range(256)),
    "header.csv": b"time,a\n0,1\n",
    "alone.csv": b"t_s," + b",".join(b"%d" % k for k in range(28)) + b"\n",
    "empty.dsa": b"",
    "text.dsa": b"hello",
    "other.dsa": bz2.compress(b"<root/>"),
    "layout.dsa": bz2.compress(dsa_xml([DsaMatrix(4, 7)], [], promised=0).encode()),
    "cells.dsa": bz2.compress(dsa_xml([DsaMatrix(4, 7)], [(0, dsa_words([1] * 27))], promised=1).encode()),
}


@both_modes
@pytest.mark.parametrize("name", CORRUPT)
def test_a_corrupt_recording(tmp_path: Path, capsys: Capture, name: str, mode: str) -> None:
    (tmp_path / name).write_bytes(CORRUPT[name])
    (tmp_path / "hand.toml").write_text(TOML)
    line = refused_estimate(capsys, tmp_path, tmp_path / name, "--sensor", tmp_path / "hand.toml", "--mode", mode)
    assert name in line


@pytest.mark.parametrize("name", CORRUPT)
def test_info_on_a_corrupt_recording(tmp_path: Path, capsys: Capture, name: str) -> None:
    (tmp_path / name).write_bytes(CORRUPT[name])
    (tmp_path / "hand.toml").write_text(TOML)
    assert name in refused(capsys, "info", tmp_path / name, "--sensor", tmp_path / "hand.toml")


@pytest.mark.parametrize("share", [0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97])
@pytest.mark.parametrize("packed", [False, True], ids=["plain", "compressed"])
def test_an_npz_with_some_bytes_overwritten_is_refused_or_read_but_never_crashes(
    tmp_path: Path, capsys: Capture, share: float, packed: bool
) -> None:
    path = tmp_path / "a.npz"
    save = np.savez_compressed if packed else np.savez
    save(path, t=np.arange(300) / 10, pressure=grasp(300), sensor=msgspec.json.encode(PALM).decode())
    content = bytearray(path.read_bytes())
    place = int(len(content) * share)
    content[place : place + 8] = b"\xff" * 8
    path.write_bytes(content)
    assert main(["estimate", str(path), "--out", str(tmp_path / "out")]) in (0, 1, 2)
    assert "Traceback" not in capsys.readouterr().err


def test_a_wrong_taxel_count(tmp_path: Path, capsys: Capture) -> None:
    line = refused_estimate(capsys, tmp_path, save_npz(tmp_path / "a.npz"), "--sensor", "barretthand-162")
    assert "28 taxels" in line
    assert "162" in line


def refused_sensor(capsys: Capture, folder: Path, command: str, sensor: str) -> str:
    file = save_npz(folder / "a.npz")
    arguments: dict[str, list[object]] = {
        "estimate": ["estimate", file, "--out", folder / "out", "--sensor", sensor],
        "info": ["info", file, "--sensor", sensor],
        "sensors": ["sensors", sensor],
    }
    return refused(capsys, *arguments[command])


@pytest.mark.parametrize("command", ["estimate", "info", "sensors"])
def test_an_unknown_sensor_with_the_list(tmp_path: Path, capsys: Capture, command: str) -> None:
    line = refused_sensor(capsys, tmp_path, command, "barret")
    assert "'barret'" in line
    assert "barretthand-162, barretthand-bh280-96, grid-16x16, hexagon-61, icub-" in line


@pytest.mark.parametrize("command", ["estimate", "info", "sensors"])
def test_a_sensor_file_that_is_not_there(tmp_path: Path, capsys: Capture, command: str) -> None:
    line = refused_sensor(capsys, tmp_path, command, "nothere.toml")
    assert "sensor file nothere.toml: path: there is no such file" in line


def test_an_unknown_method_with_the_list(tmp_path: Path, capsys: Capture) -> None:
    line = refused_estimate(capsys, tmp_path, save_npz(tmp_path / "a.npz"), "--method", "magic")
    assert "'magic'" in line
    assert "lnorm, convolution" in line


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("rows = 4\n", ""), ["[[pads]] number 1", "rows"]),
        (("rows = 4", "rows = 0"), ["[[pads]] number 1", "field rows"]),
        (("pitch_m = [0.01, 0.01]", ""), ["[[pads]] number 1", "pitch_m"]),
        (("pitch_m = [0.01, 0.01]", "pitch_m = 0.01"), ["[[pads]] number 1", "field pitch_m"]),
        (('unit = "Pa"', 'unit = "bar"'), ["top level", "field unit", "bar"]),
        (("cols = 7", "cols = 7\nmissing = [[9, 9]]"), ["[[pads]] number 1", "field missing", "[9, 9]"]),
        (("rows = 4", "rows = "), ["syntax"]),
        (('name = "hand"\n', ""), ["top level", "name"]),
    ],
    ids=lambda value: value[1] or f"no {value[0].strip()}" if isinstance(value, tuple) else "",
)
@pytest.mark.parametrize("command", ["estimate", "sensors"])
def test_a_broken_sensor_file_with_its_table_and_field(
    tmp_path: Path, capsys: Capture, change: tuple[str, str], words: list[str], command: str
) -> None:
    toml = tmp_path / "hand.toml"
    toml.write_text(TOML.replace(*change))
    if command == "estimate":
        line = refused_estimate(capsys, tmp_path, save_npz(tmp_path / "a.npz"), "--sensor", toml)
    else:
        line = refused(capsys, "sensors", toml)
    for word in (str(toml), *words):
        assert word in line


@both_modes
def test_times_that_run_backwards_leave_the_rows_before_in_part_files(
    tmp_path: Path, capsys: Capture, mode: str
) -> None:
    t_s = np.arange(60) / 10
    t_s[45] = 1.0
    line = refused_estimate(capsys, tmp_path, save_npz(tmp_path / "a.npz", t_s=t_s), "--mode", mode)
    assert "scan 45" in line
    out = tmp_path / "out"
    assert not (out / "slips.csv").exists()
    assert len(rows_of(out / "slips.csv.part")) == 45


@both_modes
def test_a_csv_that_breaks_leaves_the_rows_before_in_part_files(tmp_path: Path, capsys: Capture, mode: str) -> None:
    (tmp_path / "hand.toml").write_text(TOML)
    rows = [f"{scan / 10}," + ",".join(["1.5"] * 28) for scan in range(40)]
    rows[30] = rows[30].replace("1.5", "high", 1)
    (tmp_path / "a.csv").write_text("\n".join(["t_s" + ",a" * 28, *rows]) + "\n")
    arguments = ["--sensor", tmp_path / "hand.toml", "--mode", mode]
    assert "scan 30" in refused_estimate(capsys, tmp_path, tmp_path / "a.csv", *arguments)
    assert len(rows_of(tmp_path / "out" / "slips.csv.part")) == 30


def test_a_time_that_is_no_number(tmp_path: Path, capsys: Capture) -> None:
    for bad in (np.nan, np.inf):
        t_s = np.arange(60) / 10
        t_s[45] = bad
        assert "times" in refused_estimate(capsys, tmp_path, save_npz(tmp_path / "a.npz", t_s=t_s))


@pytest.mark.parametrize(
    "option",
    [
        ["--gain", "-1"],
        ["--gain", "nan"],
        ["--condition.contact-off", "50"],
        ["--condition.mask", "3,28"],
        ["--condition.mask", "all"],
        ["--condition.lowpass-hz", "5"],
        ["--condition.median-scans", "2"],
        ["--features.threshold", "nan"],
        ["--monitor.alarms-per-hour", "0"],
        ["--contacts", "0"],
        ["--contacts", "palm=many"],
    ],
    ids=" ".join,
)
def test_a_parameter_out_of_range_is_named(tmp_path: Path, capsys: Capture, option: list[str]) -> None:
    line = refused_estimate(capsys, tmp_path, save_npz(tmp_path / "a.npz"), *option)
    assert option[0].split(".")[-1].strip("-").replace("-", "_").split("_")[-1] in line


@pytest.mark.parametrize("words", [("--out", ""), ("--out=",)], ids=" ".join)
@pytest.mark.parametrize("command", ["estimate", "batch"])
def test_an_output_without_a_name(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch, command: str, words: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    line = refused(capsys, command, save_npz(tmp_path / "a.npz"), *words)
    assert line == "taxelflow: --out must name a directory or file (got '')\n"
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_an_output_that_is_a_file(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "out").write_text("mine")
    assert "out" in refused_estimate(capsys, tmp_path, save_npz(tmp_path / "a.npz"))
    assert (tmp_path / "out").read_text() == "mine"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_recording_without_the_right_to_read_it(tmp_path: Path, capsys: Capture) -> None:
    file = save_npz(tmp_path / "a.npz")
    file.chmod(0)
    assert "a.npz" in refused_estimate(capsys, tmp_path, file)


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["guess"],
        ["estimate"],
        ["estimate", "a.npz"],
        ["estimate", "a.npz", "--out", "out", "--mode", "live"],
        ["info"],
        ["info", "a.npz", "--deep"],
        ["sensors", "--all"],
    ],
    ids=" ".join,
)
def test_a_command_that_is_not_understood_ends_with_2(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        code: object = main(arguments)
    except SystemExit as ended:
        code = ended.code
    assert code == 2
    assert capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_an_option_that_the_method_lacks_ends_with_2_and_names_it(tmp_path: Path, capsys: Capture) -> None:
    file = save_npz(tmp_path / "a.npz")
    try:
        code: object = main(["estimate", str(file), "--out", str(tmp_path / "out"), "--gian", "1.04"])
    except SystemExit as ended:
        code = ended.code
    assert code == 2
    assert "--gian" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# What is lost or interrupted


@pytest.mark.parametrize("mode", mostly_long(["batch", "stream"], "batch"))
def test_a_truncated_dsa_is_estimated_as_far_as_it_goes(tmp_path: Path, capsys: Capture, mode: str) -> None:
    values = np.maximum(np.round(np.tile(grasp(100) / 20, (8, 1))), 0)
    path = write_dsa(tmp_path / "a.dsa", values, [DsaMatrix(4, 7)])
    content = path.read_bytes()
    path.write_bytes(content[: int(0.8 * len(content))])
    out = tmp_path / "out"
    assert main(["estimate", str(path), "--out", str(out), "--mode", mode]) == 1
    said = capsys.readouterr().err
    summary = json.loads((out / "summary.json").read_text())
    rows = rows_of(out / "slips.csv")
    assert 0 < len(rows) == summary["scans"] < 800
    assert f"{len(rows)} of 800 scans" in summary["loss"]
    assert summary["loss"] in said
    assert not list(out.glob("*.part"))


def test_a_csv_cut_within_its_last_row_is_a_loss(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "hand.toml").write_text(TOML)
    rows = [f"{scan / 10}," + ",".join(["1.5"] * 28) for scan in range(40)]
    (tmp_path / "a.csv").write_text("\n".join(["t_s" + ",a" * 28, *rows])[:-30])
    arguments = ["--sensor", str(tmp_path / "hand.toml"), "--out", str(tmp_path / "out")]
    assert main(["estimate", str(tmp_path / "a.csv"), *arguments]) == 1
    assert "39 scans could be read" in capsys.readouterr().err
    assert main(["info", str(tmp_path / "a.csv"), *arguments[:2]]) == 1
    assert "39 scans could be read" in capsys.readouterr().err


passes = 0


def open_interrupted(path: Path, sensor: Sensor | None) -> Recording:
    """A reader during whose pass number `path` somebody presses Ctrl-C, after 30 scans."""

    def read() -> Iterator[RawScans]:
        global passes  # noqa: PLW0603
        passes += 1
        raw = raw_scans(grasp())
        for start in range(0, 60, 10):
            if passes == int(path.stem) and start == 30:
                raise KeyboardInterrupt
            yield type(raw)(raw.t_s[start : start + 10], raw.values[start : start + 10])

    return Recording(path, "interrupted", PALM, read)


@pytest.mark.parametrize(("mode", "interrupted_pass"), [("batch", 2), ("stream", 1)])
def test_an_interrupted_run_keeps_its_rows_in_part_files(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch, mode: str, interrupted_pass: int
) -> None:
    monkeypatch.setattr(sys.modules[__name__], "passes", 0)
    monkeypatch.setitem(registry.PARTS["reader"], ".interrupted", f"{__name__}:{open_interrupted.__name__}")
    file = tmp_path / f"{interrupted_pass}.interrupted"
    file.write_text("rows of a recording")
    out = tmp_path / "out"
    code = main(["estimate", str(file), "--out", str(out), "--mode", mode])
    said = capsys.readouterr().err
    assert code not in (0, 1, 2)
    assert "interrupted" in said
    assert "Traceback" not in said
    assert len(rows_of(out / "slips.csv.part")) == 30
    assert len(rows_of(out / "object.csv.part")) == 30
    assert rows_of(out / "events.csv.part")[0]["event"] == "contact"
    assert not (out / "slips.csv").exists()
    assert not (out / "summary.json").exists()


def test_a_failed_run_leaves_no_older_result_that_could_be_taken_for_its_own(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["estimate", str(save_npz(tmp_path / "a.npz")), "--out", str(out)]) == 0
    backwards = save_npz(tmp_path / "b.npz", t_s=-np.arange(60.0))
    assert main(["estimate", str(backwards), "--out", str(out)]) == 2
    assert not (out / "slips.csv").exists()
    assert not (out / "summary.json").exists()


# info and sensors


def test_info_describes_a_recording(tmp_path: Path, capsys: Capture) -> None:
    assert main(["info", str(save_npz(tmp_path / "a.npz"))]) == 0
    said = capsys.readouterr().out
    for word in ("grid", "pad0", "60", "10.00 Hz", "no gaps", "4x7"):
        assert word in said


def test_info_gives_json(tmp_path: Path, capsysbinary: pytest.CaptureFixture[bytes]) -> None:
    assert main(["info", str(save_npz(tmp_path / "a.npz")), "--json"]) == 0
    whole = json.loads(capsysbinary.readouterr().out)
    assert (whole["scans"], whole["sensor"], whole["unit"]) == (60, "grid", "Pa")
    assert whole["pads"][0]["contact_scans"] == 40


def test_info_draws_the_pads_and_names_what_is_not_well(tmp_path: Path, capsys: Capture) -> None:
    values = np.repeat(grasp(240), 2, axis=0)
    values[:, 5] = 30e3
    file = save_npz(tmp_path / "a.npz", values, np.arange(480) / 60)
    assert main(["info", str(file)]) == 0
    said = capsys.readouterr().out
    assert "scans are the one before again, bit for bit: 30.00 Hz are new" in said.replace("\n", " ")
    assert "faulty: taxel 5 (pad0, row 0, col 5) stuck at 3e+04 Pa" in said
    assert "! faulty" in said
    assert any(re.fullmatch(r"[0-9.] ([0-9.!] ){6}", line.rstrip() + " ") for line in said.splitlines())
    assert main(["info", str(file), "--json"]) == 0
    pad = json.loads(capsys.readouterr().out)["pads"][0]
    assert pad["findings"][0]["fault"] == "stuck"
    assert len(pad["marks"]) == 4


def test_options_of_the_conditioner(tmp_path: Path, capsys: Capture) -> None:
    values = grasp(240)
    values[:, 5] = 30e3
    file = save_npz(tmp_path / "a.npz", values)
    arguments = ["--condition.mask", "auto", "--condition.lowpass-hz", "2", "--condition.median-scans", "3"]
    arguments += ["--condition.drift", "follow", "--condition.repeats", "keep", "--features.threshold", "6"]
    assert main(["estimate", str(file), "--out", str(tmp_path), *arguments]) == 0
    said = capsys.readouterr().err
    assert "masked: taxel 5 (pad0, row 0, col 5) stuck at 3e+04 Pa" in said
    assert "every lag_s is" in said
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["masked_taxels"] == [5]
    assert summary["parameters"]["condition"]["lowpass_hz"] == 2.0
    assert summary["parameters"]["features"] == {"threshold": 6.0}
    assert len(rows_of(tmp_path / "contacts.csv")) > 100


def test_info_refuses_what_estimate_refuses(tmp_path: Path, capsys: Capture) -> None:
    assert "does not exist" in refused(capsys, "info", tmp_path / "none.npz")
    assert "--sensor" in refused(capsys, "info", save_npz(tmp_path / "a.npz", sensor=None))
    assert "do not increase" in refused(capsys, "info", save_npz(tmp_path / "b.npz", t_s=-np.arange(60.0)))


def test_sensors_lists_the_built_in_ones(capsys: Capture) -> None:
    assert main(["sensors"]) == 0
    said = capsys.readouterr().out
    for word in ("barretthand-162", "162", "grid-16x16", "256", "schunk-sdh2", "456"):
        assert word in said


def test_sensors_draws_one(capsys: Capture) -> None:
    assert main(["sensors", "barretthand-162"]) == 0
    said = capsys.readouterr().out
    assert "  143  144  145  146  147  148  149" in said
    assert "    ·  138  139  140  141  142    ·" in said
    assert "assumption" in said
    assert "10x10 mm" in said


def test_sensors_draws_a_file(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "hand.toml").write_text(TOML)
    assert main(["sensors", str(tmp_path / "hand.toml")]) == 0
    assert "   21   22   23   24   25   26   27" in capsys.readouterr().out


def test_sensors_lists_what_must_be_asked_with_its_pitch(capsys: Capture) -> None:
    assert main(["sensors"]) == 0
    said = capsys.readouterr().out
    assert "inspire-rh56dftp@PITCHmm" in said
    assert "grid:16x16@4mm" in said


def test_sensors_draws_a_picture(tmp_path: Path, capsys: Capture) -> None:
    pytest.importorskip("matplotlib")
    assert main(["sensors", "grid:3x4@5mm", "--plot", str(tmp_path / "grid.png")]) == 0
    assert (tmp_path / "grid.png").read_bytes().startswith(b"\x89PNG")
    assert main(["sensors", "xela-4x4@4.7mm", "--plot", str(tmp_path / "pictures")]) == 0
    assert "<svg" in (tmp_path / "pictures" / "xela-4x4@4.7mm.svg").read_text()
    assert "xela-4x4@4.7mm.svg" in capsys.readouterr().out


@pytest.mark.long
def test_sensors_draws_all_built_in_ones(tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    # grids, a table, a pitch in the name; that each sensor can be drawn is shown in test_sensor_figure
    one_of_a_kind = ("barretthand-162", "hexagon-61", "xela-4x4@PITCHmm")
    few = [pair for pair in catalogue.catalogue() if pair[0] in one_of_a_kind]
    monkeypatch.setattr(catalogue, "catalogue", lambda: few)
    assert main(["sensors", "--plot", str(tmp_path)]) == 0
    drawn = {f.name for f in tmp_path.iterdir()}
    assert drawn == {"barretthand-162.svg", "hexagon-61.svg", "xela-4x4@1mm.svg"}
    line = refused(capsys, "sensors", "--plot", tmp_path / "all.png")
    assert "plot must be a directory for all sensors; for a file, name one sensor" in line
    line = refused(capsys, "sensors", "hexagon-61", "--plot", tmp_path / "one.bmp")
    assert "plot must be a directory, or a file that ends in .svg or .png or .pdf" in line


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("inspire-rh56dftp", "sensor inspire-rh56dftp: its pitch is not published; measure it and add it to the name"),
        ("grid:16x16", "'grid:16x16' is not a plain grid; give rows, cols and pitch"),
    ],
)
def test_a_sensor_without_pitch_reports_how_to_name_it(capsys: Capture, name: str, says: str) -> None:
    assert says in refused(capsys, "sensors", name)


@pytest.mark.parametrize("name", ["run[old]", "run[/]", "run[red]1", "läuft ✓"])
def test_names_are_shown_as_they_are(tmp_path: Path, capsys: Capture, name: str) -> None:
    folder = tmp_path / name
    folder.mkdir(parents=True)
    file = save_npz(folder / "a.npz")
    assert main(["info", str(file)]) == 0
    assert name in capsys.readouterr().out
    assert main(["estimate", str(file), "--out", str(folder / "out")]) == 0
    assert name in capsys.readouterr().out


@pytest.mark.parametrize("name", ["left[1]", "hand[/]", "[red]hand"])
def test_names_of_sensors_and_pads_are_shown_as_they_are(tmp_path: Path, capsys: Capture, name: str) -> None:
    toml = tmp_path / "hand.toml"
    toml.write_text(TOML.replace('"hand"', f'"{name}"\nnote = "{name}!"').replace('"palm"', f'"{name} palm"'))
    assert main(["sensors", str(toml)]) == 0
    said = capsys.readouterr().out
    assert f"{name}!" in said
    assert f"{name} palm" in said
    file = save_npz(tmp_path / "a.npz", sensor=None)
    assert main(["info", str(file), "--sensor", str(toml)]) == 0
    assert f"{name} palm" in capsys.readouterr().out
    assert main(["estimate", str(file), "--sensor", str(toml), "--out", str(tmp_path)]) == 0
    assert f"{name} palm" in capsys.readouterr().out


# As a program


def program(*arguments: object, **more: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "taxelflow.cli", *map(str, arguments)],
        check=False,
        capture_output=True,
        text=True,
        **more,
    )


@pytest.mark.long
def test_the_program_ends_with_0_when_all_went_well(tmp_path: Path) -> None:
    done = program("estimate", save_npz(tmp_path / "a.npz"), "--out", tmp_path / "out")
    assert (done.returncode, "Traceback" in done.stderr) == (0, False)


def test_it_gives_1_when_something_was_lost(tmp_path: Path, capsys: Capture) -> None:
    text = dsa_xml([DsaMatrix(4, 7)], [(32 * k, dsa_words([1] * 28)) for k in range(20)], promised=30)
    (tmp_path / "a.dsa").write_bytes(bz2.compress(text.encode()))
    assert main(["estimate", str(tmp_path / "a.dsa"), "--out", str(tmp_path / "out")]) == 1
    assert "20 of 30 scans" in capsys.readouterr().err


def test_the_program_ends_with_2_and_one_line_on_bad_input(tmp_path: Path) -> None:
    done = program("estimate", tmp_path / "none.npz", "--out", tmp_path / "out")
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("wild", [np.inf, -np.inf, 3.4e38, 1e300])
def test_the_program_warns_of_no_arithmetic(tmp_path: Path, capsys: Capture, wild: float) -> None:
    values = grasp()
    values[30, 3] = wild
    assert main(["estimate", str(save_npz(tmp_path / "a.npz", values)), "--out", str(tmp_path / "out")]) == 0
    assert "Warning" not in capsys.readouterr().err  # which pytest would raise, if it were numpy's


@pytest.mark.parametrize("sentinel", [3.4e38, -1e300])
def test_a_reading_beyond_any_sensors_is_counted_as_missing(tmp_path: Path, capsys: Capture, sentinel: float) -> None:
    values = grasp()
    values[30, 3] = values[31, 7] = sentinel
    assert main(["info", str(save_npz(tmp_path / "a.npz", values)), "--json"]) == 0
    (pad,) = json.loads(capsys.readouterr().out)["pads"]
    assert (pad["missing_readings"], abs(pad["lowest"]) < 1e6, pad["highest"] < 1e6) == (2, True, True)


def test_the_program_stands_a_closed_pipe(tmp_path: Path) -> None:
    command = f'"{sys.executable}" -m taxelflow.cli sensors schunk-sdh2 | head -1'
    done = subprocess.run(["bash", "-o", "pipefail", "-c", command], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_table_whose_reader_has_gone_ends_in_order() -> None:
    """rich exits with 1 there."""
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "w") as closed:  # noqa: PTH123 - a descriptor
        command = [sys.executable, "-m", "taxelflow.cli", "sensors"]
        done = subprocess.run(command, check=False, stdout=closed, stderr=subprocess.PIPE, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.long
@pytest.mark.parametrize("closed", [">&-", ">&- 2>&-"])
def test_the_program_works_as_a_daemon_whose_streams_are_closed(tmp_path: Path, closed: str) -> None:
    words = f'sensors schunk-sdh2 --plot "{tmp_path / "a.svg"}"'
    done = subprocess.run(["bash", "-c", f'"{sys.executable}" -m taxelflow {words} {closed}'], check=False)
    assert (done.returncode, (tmp_path / "a.svg").is_file()) == (0, True)


def test_the_program_writes_to_a_terminal_that_knows_only_ascii() -> None:
    done = program("sensors", "barretthand-162", env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert (done.returncode, done.stderr) == (0, "")


def test_the_teapots_handle_by_the_program(recordings: Path, tmp_path: Path) -> None:
    recording = recordings / "sdh-dsa" / "slip_and_rotation_teapot_handle.dsa"
    assert main(["estimate", str(recording), "--out", str(tmp_path / "out")]) == 0
    contacts = json.loads((tmp_path / "out" / "summary.json").read_text())["contacts"]
    nets = [contact["net_m"] for contact in contacts if contact["pad"] == "finger2_distal"]
    assert 0.015 < float(np.hypot(*np.sum(nets, axis=0))) < 0.025
    assert len(rows_of(tmp_path / "out" / "slips.csv")) == 109 * 6
