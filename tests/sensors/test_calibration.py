from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest

import taxelflow
from synthetic import dome, grid_sensor, recorded
from taxelflow.cli import main
from taxelflow.errors import CalibrationInvalid, CalibrationUnfit
from taxelflow.sensors.calibration import (
    Calibration,
    PadCalibration,
    fingerprint,
    load_calibration,
    save_calibration,
    to_toml,
)
from taxelflow.sensors.pads import Group, Patch
from taxelflow.sensors.sensor import Sensor

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.acquire.base import Recording


def of(sensor: Sensor, method: str = "convolution", **more: Any) -> Calibration:
    pad = PadCalibration(
        name=sensor.pads[-1].name,
        gain_x=1.25,
        gain_y=0.9,
        mm_per_index_x=6.25,
        mm_per_index_y=4.5,
        T_pad_robot=(0.1, -0.2, 1e-7),
        std_pad_robot=(0.0, 1e-4, 0.01),
        time_offset_s=-0.125,
        std_time_offset_s=0.001,
        scans=52,
        interior_scans=8,
        residual_mm=0.25,
        std_x=0.01,
        note='a "note"\nof two lines',
    )
    return Calibration(method, sensor.name, fingerprint(sensor), "0.1.0", (msgspec.structs.replace(pad, **more),))


def test_a_file_holds_what_was_written(tmp_path: Path) -> None:
    made = of(grid_sensor(4, 7))
    path = tmp_path / "cal.toml"
    save_calibration(made, str(path))
    assert load_calibration(path) == made
    assert [file.name for file in tmp_path.iterdir()] == ["cal.toml"]
    assert "std_y" not in path.read_text()


@pytest.mark.parametrize(
    ("before", "after", "seen"),
    [
        ("gain_x = 1.25", "gain_x = -1.0", "gain_x"),
        ("gain_x = 1.25", "gain_x = nan", "gain_x"),
        ("gain_x = 1.25", 'gain_x = "much"', "gain_x"),
        ("gain_x = 1.25", "gain_z = 1.25", "gain_z"),
        ("gain_x = 1.25\n", "", "gain_x"),
        ("[[pads]]", "[[pads]", "TOML"),
        ('method = "convolution"\n', "", "method"),
        ('method = "convolution"', "method = 3", "method"),
    ],
)
def test_a_broken_file_is_refused_in_one_line(tmp_path: Path, before: str, after: str, seen: str) -> None:
    text = to_toml(of(grid_sensor(4, 7)))
    assert before in text
    path = tmp_path / "cal.toml"
    path.write_text(text.replace(before, after))
    with pytest.raises(CalibrationInvalid, match=seen) as error:
        load_calibration(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b"gain = 1"])
def test_another_file_is_no_calibration(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "cal.toml"
    path.write_bytes(content)
    with pytest.raises(CalibrationInvalid):
        load_calibration(path)


@pytest.mark.parametrize(
    "other",
    [
        grid_sensor(4, 8),
        grid_sensor(4, 7, name="foot"),
        grid_sensor(4, 7, pitch_m=(0.01, 0.02)),
        grid_sensor(4, 7, missing=((0, 0),)),
        grid_sensor(4, 7, pads=2),
    ],
)
def test_another_sensor_or_layout_is_refused(other: Sensor) -> None:
    with pytest.raises(CalibrationUnfit, match="grid"):
        of(grid_sensor(4, 7)).gains(other)


def test_unit_places_and_groups_may_change() -> None:
    own = grid_sensor(4, 7)
    pads = (msgspec.structs.replace(own.pads[0], origin_m=(1.0, 2.0), note="moved"),)
    changed = msgspec.structs.replace(own, unit="kPa", pads=pads, groups=(Group("g", (Patch("pad0"),)),))
    np.testing.assert_array_equal(of(own).gains(changed), [[1.25, 0.9]] * 2)


def test_groups_inherit_the_gain_of_their_pad() -> None:
    two = grid_sensor(4, 7, pads=2)
    pads = tuple(msgspec.structs.replace(pad, origin_m=(0.1 * k, 0.0)) for k, pad in enumerate(two.pads))
    groups = (
        Group("left", (Patch("pad1", cols=(0, 2)),)),
        Group("other", (Patch("pad0"),)),
        Group("both", (Patch("pad0"), Patch("pad1"))),
    )
    sensor = msgspec.structs.replace(two, pads=pads, groups=groups)
    expected = [[1, 1], [1.25, 0.9], [1.25, 0.9], [1, 1], [(1 + 1 + 1.25 + 0.9) / 4] * 2]
    np.testing.assert_allclose(of(sensor).gains(sensor), expected)


def test_estimating_refuses_another_method_and_the_file_is_read(stroke: Recording, tmp_path: Path) -> None:
    exact = replace(stroke, sensor=msgspec.structs.replace(stroke.sensor, unseen_error=0.0))  # no pose beside a rest
    path = tmp_path / "cal.toml"
    save_calibration(of(exact.sensor), path)
    with pytest.raises(CalibrationUnfit, match="LNorm"):
        taxelflow.estimate(exact, "lnorm", calibration=path)
    with pytest.raises(CalibrationUnfit, match="PrincipalAxis"):
        taxelflow.estimate(exact, "principal_axis", calibration=path)
    plain = taxelflow.estimate(exact, gain=2.0)
    result = taxelflow.estimate(exact, gain=2.0, calibration=str(path))
    np.testing.assert_allclose(result.slips.pose[..., 0], 1.25 * plain.slips.pose[..., 0], rtol=1e-12)
    np.testing.assert_allclose(result.slips.pose[..., 1], 0.9 * plain.slips.pose[..., 1], rtol=1e-12)
    assert result.summary.parameters["calibration"]["pads"][0]["gain_x"] == 1.25
    assert "calibration" not in plain.summary.parameters


@pytest.mark.parametrize("method", ["lnorm", "convolution"])
def test_gains_of_one_change_no_bit(stroke: Recording, method: str) -> None:
    ones = of(stroke.sensor, method, gain_x=1.0, gain_y=1.0)
    plain, same = (taxelflow.estimate(stroke, method, calibration=cal).slips for cal in (None, ones))
    for name in ("pose", "displacement", "covariance", "displacement_covariance"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(same, name))


def test_a_touched_pad_without_a_gain_is_named() -> None:
    two = grid_sensor(4, 7, pads=2)
    idle = np.zeros((20, 56))
    values = np.concatenate([idle, np.array([dome(two) + dome(two, pad=1)] * 20)])
    result = taxelflow.estimate(
        recorded(values + np.random.default_rng(0).normal(0, 50, (40, 56)), two), calibration=of(two)
    )
    assert [note for note in result.summary.notes if "calibration" in note] == [
        "not in the calibration, so at gain 1: pad0"
    ]


def test_a_file_that_is_not_there_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scans = tmp_path / "a.csv"
    scans.write_text("t_s,a\n0,1\n")
    there = ["estimate", str(scans), "--out", str(tmp_path / "out"), "--sensor", "barretthand-162"]
    assert main([*there[:2], "--out", str(tmp_path / "out"), "--calibration", str(tmp_path / "none.toml")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
