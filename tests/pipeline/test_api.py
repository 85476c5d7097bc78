from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from functools import cache
from importlib import import_module
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import pytest

import taxelflow
from costly import mostly_long
from synthetic import METHODS, dome, grid_sensor, recorded
from taxelflow.errors import (
    FormatUnknown,
    NameUnknown,
    ParameterInvalid,
    RecordingMissing,
    SensorNeeded,
    TaxelflowError,
)
from taxelflow.estimation.centroid.lnorm import LNorm
from taxelflow.messages import cut, joined
from taxelflow.pipeline import api

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from taxelflow.acquire.base import Recording

PALM = grid_sensor(4, 7)
PUBLIC = {
    "Calibration",
    "Columns",
    "Conditioner",
    "Contact",
    "ContactFeatures",
    "Estimates",
    "Event",
    "Layout",
    "Live",
    "Load",
    "Motion",
    "Motions",
    "Pad",
    "PadResult",
    "Pipeline",
    "RawScans",
    "Recording",
    "Result",
    "RigidField",
    "SCENARIOS",
    "Scans",
    "Scenario",
    "Second",
    "Sensing",
    "Sensor",
    "SlipMonitor",
    "Slips",
    "Smoothing",
    "TaxelflowError",
    "Trajectory",
    "Truth",
    "calibrate",
    "convert",
    "estimate",
    "estimator",
    "load_calibration",
    "load_sensor",
    "read",
    "read_trajectory",
    "recording",
    "save_calibration",
    "simulate",
}
DSA = ["masked_matrix", "reactive_grasping", "slip_and_rotation_teapot_handle", "tennisball"]
LONG_DSA = "slip_examples_pen_and_wooden_block"
BEGINNING = 900
"""Scans of a real recording that are estimated."""


def test_the_public_face_is_exactly_this() -> None:
    assert set(taxelflow.__all__) == PUBLIC
    assert set(taxelflow._HOME) == PUBLIC
    assert set(dir(taxelflow)) >= PUBLIC  # what an editor or a notebook completes


@pytest.mark.parametrize("name", sorted(PUBLIC))
def test_every_public_name_is_what_its_home_defines(name: str) -> None:
    home = import_module(f"taxelflow.{taxelflow._HOME[name]}")
    assert getattr(taxelflow, name) is getattr(home, name)


def test_a_name_that_is_not_public_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="nonsense"):
        taxelflow.nonsense  # noqa: B018


@pytest.mark.parametrize(
    "program",
    [
        "import taxelflow; taxelflow.read; taxelflow.estimate; assert callable(taxelflow.estimate)",
        *mostly_long(
            [
                "import taxelflow.estimation.centroid.paper_reference; assert callable(taxelflow.estimate)",
                "from taxelflow import read, estimate; assert callable(estimate)",
                "import taxelflow.pipeline; from taxelflow import estimate; assert callable(estimate)",
                "import taxelflow.estimation.base; import taxelflow; assert callable(taxelflow.estimate)",
            ]
        ),
    ],
)
def test_estimate_is_the_function_whatever_was_imported_before(program: str) -> None:
    subprocess.run([sys.executable, "-c", program], check=True)


def test_the_version_is_known() -> None:
    assert taxelflow.__version__.count(".") == 2


def test_a_recording_is_estimated_by_path_and_as_object(tmp_path: Path) -> None:
    import msgspec

    values = dome(PALM) + np.random.default_rng(0).normal(0, 100, (30, 28))
    path = tmp_path / "scans.npz"
    np.savez(path, t=np.arange(30) / 10, pressure=values, sensor=msgspec.json.encode(PALM).decode())
    for recording in (path, str(path), api.read(path)):
        result = api.estimate(recording)
        assert len(result.slips) == 30
        assert result.pads == ("pad0",)


def test_results_are_typed_arrays_of_scans_and_pads(stroke: Recording) -> None:
    result = api.estimate(stroke, "lnorm", gain=1.04)
    shapes = {
        "displacement": (80, 1, 3),
        "pose": (80, 1, 3),
        "velocity": (80, 1, 3),
        "covariance": (80, 1, 3, 3),
        "displacement_covariance": (80, 1, 3, 3),
        "span_s": (80, 1),
        "lag_s": (80, 1),
        "t_s": (80,),
    }
    for name, shape in shapes.items():
        array = getattr(result.slips, name)
        assert (array.shape, array.dtype) == (shape, np.float64), name
    assert (result.slipping.shape, result.slipping.dtype) == ((80, 1), np.bool_)
    assert result.motions.velocity.shape == (80, 3)


def test_a_sensor_may_be_given_as_name_file_or_object(tmp_path: Path) -> None:
    path = tmp_path / "scans.csv"
    path.write_text("t_s," + ",".join(map(str, range(162))) + "\n0" + ",0" * 162 + "\n")
    toml = tmp_path / "hand.toml"
    toml.write_text('name = "mine"\nunit = "Pa"\n[[pads]]\nname = "p"\nrows = 9\ncols = 18\npitch_m = [0.01, 0.01]\n')
    assert api.read(path, "barretthand-162").sensor.name == "barretthand-162"
    assert api.read(path, toml).sensor.name == api.read(path, str(toml)).sensor.name == "mine"
    assert api.read(path, grid_sensor(9, 18)).sensor.name == "grid"
    assert taxelflow.load_sensor(toml) == taxelflow.load_sensor(str(toml))


def test_suffixes_are_known_in_any_case(tmp_path: Path) -> None:
    path = tmp_path / "SCANS.CSV"
    path.write_text("t_s,a\n0,1\n")
    assert len(api.read(path, grid_sensor(1, 1)).load()) == 1


def test_what_cannot_be_read_is_refused_with_the_reason(tmp_path: Path) -> None:
    with pytest.raises(RecordingMissing, match="does not exist"):
        api.read(tmp_path / "none.npz")
    with pytest.raises(RecordingMissing, match="is a directory"):
        api.read(tmp_path)
    for name in ("scans.xyz", "scans"):
        (tmp_path / name).write_text("")
        with pytest.raises(FormatUnknown, match=r"known are \.npz, \.csv, \.dsa"):
            api.read(tmp_path / name)
    (tmp_path / "scans.csv.gz").write_bytes(b"")
    with pytest.raises(FormatUnknown, match=r"its suffix is '.gz'; unpack it first; known are"):
        api.read(tmp_path / "scans.csv.gz")
    (tmp_path / "scans.csv").write_text("t_s,a\n0,1\n")
    with pytest.raises(SensorNeeded):
        api.read(tmp_path / "scans.csv")


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"method": "magic"}, NameUnknown),
        ({"mode": "live"}, NameUnknown),
        ({"gain": 0.0}, ParameterInvalid),
        ({"gain": "large"}, ParameterInvalid),
        ({"sharpness": 1.0}, ParameterInvalid),
        ({"method": None}, ParameterInvalid),
        ({"method": LNorm}, ParameterInvalid),
        ({"condition": {"tare": "start"}}, ParameterInvalid),
        ({"smooth": 1.0}, ParameterInvalid),
        ({"contacts": 2.5}, ParameterInvalid),
    ],
    ids=str,
)
def test_wrong_arguments_are_foreseen_errors(
    stroke: Recording, arguments: dict[str, object], error: type[TaxelflowError]
) -> None:
    with pytest.raises(error):
        api.estimate(stroke, **arguments)  # type: ignore[arg-type]


def test_an_unknown_parameter_comes_with_those_that_are_known() -> None:
    with pytest.raises(ParameterInvalid, match=r"parameters of lnorm must be among gain.* \(got 'gian'\)"):
        api.estimator("lnorm", gian=1.0)


def test_a_truncated_recording_gives_a_result_that_reports_the_loss(tmp_path: Path) -> None:
    path = tmp_path / "scans.csv"
    path.write_text("t_s,a\n" + "".join(f"{scan},{scan % 3}\n" for scan in range(20)) + "20")
    result = api.estimate(api.read(path, grid_sensor(1, 1)))
    assert len(result.slips) == 20
    assert result.summary.loss is not None
    assert "20 scans" in result.summary.loss


def test_the_recording_is_not_read_before_it_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "scans.csv"
    path.write_text("t_s,a\n0,1\n1,high\n")
    api.read(path, grid_sensor(1, 1))
    with pytest.raises(TaxelflowError):
        api.estimate(api.read(path, grid_sensor(1, 1)))


def test_a_pressure_that_reaches_absurd_values_gives_a_result() -> None:
    values = dome(PALM) + np.random.default_rng(0).normal(0, 100, (40, 28))
    values[20, 3] = 3.4e38
    result = api.estimate(recorded(values, PALM))
    assert len(result.slips) == 40


@pytest.fixture(scope="module")
def beginning(recordings: Path) -> Callable[[str], Recording]:
    """The first scans of a real recording, which is read once."""

    @cache
    def of(name: str) -> Recording:
        whole = api.read(recordings / "sdh-dsa" / f"{name}.dsa")
        scans = joined(list(whole.source_blocks()))
        first = cut(scans, 0, min(len(scans), BEGINNING))
        return replace(whole, read=lambda: iter([first]), scans=len(first))

    return of


@pytest.mark.parametrize(("method", "mode"), [*product(METHODS, ["batch"]), ("convolution", "stream")])
@pytest.mark.parametrize("name", mostly_long([*DSA, LONG_DSA], DSA[0]))
def test_every_real_recording_is_estimated(
    beginning: Callable[[str], Recording], name: str, method: str, mode: str
) -> None:
    recording = beginning(name)
    result = api.estimate(recording, method, mode=mode)  # type: ignore[arg-type]
    assert len(result.slips) + result.summary.repeated_scans_dropped == recording.scans
    assert (np.diff(result.slips.t_s) > 0).all()
    assert result.summary.contact
    slips = result.slips
    assert not slips.valid[~slips.contact].any()
    assert 1 <= sum(pad.contact_scans > 0 for pad in result.summary.pads.values()) <= 4
    height, width = 14 * 0.0034, 6 * 0.0034
    known = slips.pose[np.isfinite(slips.pose[..., 0])]
    assert (np.abs(known[:, 0]) <= width / 2).all()
    assert (np.abs(known[:, 1]) <= height / 2).all()
    variance = slips.covariance[slips.valid][:, [0, 1], [0, 1]]
    assert (variance > 0).all()


@pytest.mark.parametrize(
    ("method", "mode"),
    mostly_long(
        [(method, mode) for method in METHODS for mode in ("batch", "stream")],
        ("convolution", "batch"),
        ("lnorm", "stream"),
    ),
)
def test_the_teapots_handle_slides_about_19_mm_along_one_pad(recordings: Path, method: str, mode: str) -> None:
    path = recordings / "sdh-dsa" / "slip_and_rotation_teapot_handle.dsa"
    contacts = api.estimate(path, method, mode=mode).summary.contacts  # type: ignore[arg-type]
    nets = [contact.net_m for contact in contacts if contact.pad == "finger2_distal"]
    assert 0.015 < float(np.hypot(*np.sum(np.array(nets, dtype=float), axis=0))) < 0.025


@pytest.mark.long
def test_the_many_slips_of_pen_and_block_are_detected(recordings: Path) -> None:
    result = api.estimate(recordings / "sdh-dsa" / f"{LONG_DSA}.dsa")
    assert sum(pad.slips for pad in result.summary.pads.values()) >= 40
