"""Recordings and results as Python shows and gives them."""

from __future__ import annotations

import csv
import re
import sys
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest

import taxelflow
from rigged import rigged
from synthetic import dome, grid_sensor, recorded
from taxelflow.errors import (
    ExtraMissing,
    NameUnknown,
    ParameterInvalid,
    RecordingCorrupt,
    TaxelCountWrong,
    TimesNotIncreasing,
)
from taxelflow.publish.contact_table import contact_table

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.messages import Floats

PALM = grid_sensor(4, 7)
TWO = grid_sensor(4, 7, pads=2)


def moving(scans: int = 60) -> Floats:
    values: Floats = np.random.default_rng(0).normal(0, 100, (scans, 28))
    for scan in range(20, scans - 10):
        values[scan] += dome(PALM, 0.0005 * (scan - 40))
    return values


@pytest.fixture(scope="module")
def result() -> taxelflow.Result:
    return taxelflow.estimate(taxelflow.recording(np.arange(60) / 10, moving(), PALM))


# Recordings


def test_arrays_become_a_recording() -> None:
    found = taxelflow.recording(np.arange(60) / 10, moving(), PALM, masked=[3])
    assert np.flatnonzero(found.masked).tolist() == [3]
    np.testing.assert_array_equal(found.load().values, moving())
    in_grid = taxelflow.recording(np.arange(60) / 10, moving().reshape(60, 4, 7), "grid:4x7@10mm,Pa")
    np.testing.assert_array_equal(in_grid.load().values, moving())


def test_a_masked_element_is_a_missing_reading() -> None:
    found = taxelflow.recording([0, 1], np.ma.masked_array([[1, 2], [3, 4]], [[0, 1], [0, 0]]), "grid:1x2@4mm")
    np.testing.assert_array_equal(found.load().values, [[1, np.nan], [3, 4]])


def test_lists_and_integers_become_a_recording() -> None:
    found = taxelflow.recording([0, 1], [[1, 2], [3, 4]], "grid:1x2@4mm")
    assert found.load().values.dtype == np.float64


@pytest.mark.parametrize(
    ("t_s", "values", "error", "says"),
    [
        (np.arange(3), np.zeros((4, 28)), RecordingCorrupt, "shape (3,), values (4, 28)"),
        (np.zeros((3, 1)), np.zeros((3, 28)), RecordingCorrupt, "(3, 1)"),
        (np.arange(3), np.zeros(3), RecordingCorrupt, "(scans, taxels)"),
        (np.arange(3), np.zeros((3, 7, 4)), RecordingCorrupt, "no full grid"),
        (["a"], [[1.0]], RecordingCorrupt, "not numbers"),
        (np.arange(3), np.zeros((3, 28), complex), RecordingCorrupt, "not numbers: values are complex128"),
        (np.arange(3), np.zeros((3, 28), "m8[ms]"), RecordingCorrupt, "not numbers: values are timedelta64[ms]"),
        (np.arange(3), np.zeros((3, 27)), TaxelCountWrong, "27 taxels"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(t_s: object, values: object, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=re.escape(says)):
        taxelflow.recording(t_s, values, PALM)  # type: ignore[arg-type]


def test_times_of_arrays_must_increase() -> None:
    with pytest.raises(TimesNotIncreasing):
        taxelflow.recording([0.0, 2.0, 1.0], np.zeros((3, 28)), PALM).load()


def test_a_recording_has_a_length_and_gives_scan_after_scan() -> None:
    found = recorded(moving(), PALM, block=7)
    scans = list(found)
    assert len(found) == len(scans) == 60
    assert all(len(scan) == 1 for scan in scans)
    assert scans[-1].t_s[0] == found.load().t_s[-1]


def test_a_recording_that_does_not_declare_its_length_is_counted(tmp_path: Path) -> None:
    path = tmp_path / "scans.csv"
    path.write_text("t_s,a\n0,1\n1,2\n1.5,3\n")
    assert len(taxelflow.read(path, grid_sensor(1, 1))) == 3


def test_scans_are_pushed_as_a_live_device_gives_them() -> None:
    found = recorded(moving(), PALM)
    run = taxelflow.Pipeline(taxelflow.estimator("convolution"), mode="stream").start(taxelflow.Recording.live(PALM))
    outputs = [run.step(scan) for scan in found]
    assert sum(map(len, [*outputs, run.finish()])) == 60


def test_a_recording_is_shown_in_a_line() -> None:
    assert repr(recorded(moving(), PALM)) == "<Recording memory: 60 scans of grid (28 taxels, 1 pad)>"
    assert repr(taxelflow.simulate("stroke")).endswith("140 scans of barretthand-162 (162 taxels, 7 pads), with truth>")


def test_a_recording_without_scans_is_still_a_recording() -> None:
    assert taxelflow.Recording.live(PALM)


def test_scenarios_are_simulated_by_name() -> None:
    with pytest.raises(NameUnknown, match="stroke"):
        taxelflow.simulate("strike")
    assert len(taxelflow.simulate(rigged("stroke", motion={"strokes": 1}))) < 140


# Results


def test_a_result_is_shown_in_a_line(result: taxelflow.Result) -> None:
    shown = repr(result)
    assert shown.startswith("<Result convolution: 60 scans of grid, 1 contact, ")
    assert len(shown) < 100
    assert len(repr(result["pad0"])) < 100


def test_a_notebook_shows_contacts_and_nothing_that_a_name_injects() -> None:
    sensor = grid_sensor(4, 7)
    renamed = taxelflow.Sensor(name="<b>", unit="Pa", pads=sensor.pads)
    html = taxelflow.estimate(recorded(moving(), renamed))._repr_html_()
    assert "<th>slip speed<br>mm/s</th>" in html
    assert "<td>pad0</td>" in html
    assert "&lt;b&gt;" in html
    assert "<b>" not in html


def test_a_pad_has_its_own_arrays() -> None:
    values = np.concatenate([moving(), np.zeros((60, 28))], axis=1)
    result = taxelflow.estimate(recorded(values, TWO))
    assert list(result) == ["pad0", "pad1"]
    pad = result["pad0"]
    np.testing.assert_array_equal(pad.velocity, result.slips.velocity[:, 0])
    np.testing.assert_array_equal(pad.covariance, result.slips.covariance[:, 0])
    np.testing.assert_array_equal(pad.slipping, result.slipping[:, 0])
    assert set(pad.quality) <= {"", "ok", "ambiguous", "unresolved", "lost"}
    assert {event.pad for event in pad.events} == {"pad0"}
    assert [contact.pad for contact in pad.contacts] == ["pad0"]
    assert result["pad1"].events == []
    with pytest.raises(NameUnknown, match="known are pad0, pad1"):
        result["palm"]
    with pytest.raises(NameUnknown, match="unknown pad 0; known are pad0, pad1"):
        result[0]  # type: ignore[index]


def test_a_data_frame_has_the_columns_and_values_of_the_file(result: taxelflow.Result, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    frame = result.to_dataframe()
    with (result.save(tmp_path) / "slips.csv").open(newline="") as file:
        heading, *rows = csv.reader(file)
    assert list(frame.columns) == heading
    assert len(frame) == len(rows) == 60
    for number, name in enumerate(heading):
        written = [row[number] for row in rows]
        if name in ("pad", "quality"):
            assert frame[name].fillna("").tolist() == written
        else:
            read = np.array([float(text or "nan") for text in written])
            np.testing.assert_allclose(frame[name].to_numpy(dtype=float), read, rtol=1e-6, atol=1e-6, err_msg=name)


def test_without_pandas_the_extra_is_named(result: taxelflow.Result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ExtraMissing, match=r"pandas is not installed.*taxelflow\[tables\]"):
        result.to_dataframe()


def test_what_is_saved_is_what_the_program_writes(tmp_path: Path) -> None:
    recording = taxelflow.simulate("stroke")
    path = tmp_path / "stroke.npz"
    taxelflow.convert(recording, path)
    assert taxelflow.estimate(path).save(tmp_path / "saved") == tmp_path / "saved"
    from taxelflow.cli import main

    assert main(["estimate", str(path), "--out", str(tmp_path / "estimated")]) == 0
    names = sorted(file.name for file in (tmp_path / "estimated").iterdir())
    assert sorted(file.name for file in (tmp_path / "saved").iterdir()) == names
    for name in names:
        if name != "summary.json":  # which holds the parameters of the fusion only where they were asked for
            assert (tmp_path / "saved" / name).read_bytes() == (tmp_path / "estimated" / name).read_bytes(), name


@pytest.mark.long
def test_a_result_is_drawn(result: taxelflow.Result, tmp_path: Path) -> None:
    files = result.plot(tmp_path / "pictures", "png")
    assert {file.name for file in files} >= {"position-pad0.png", "path-convolution.png"}
    assert all(file.is_file() for file in files)


def test_pictures_of_an_unknown_format_are_refused(result: taxelflow.Result, tmp_path: Path) -> None:
    with pytest.raises(ParameterInvalid, match=r"format must be svg, png or pdf \(got 'jpg'\)"):
        result.plot(tmp_path / "pictures", "jpg")  # type: ignore[arg-type]
    assert not (tmp_path / "pictures").exists()


@pytest.mark.parametrize(("repeats", "noted"), [(1, False), (5, True)])
def test_stamps_that_are_too_coarse_are_noted(repeats: int, noted: bool) -> None:
    t_s = np.arange(60) // repeats / 10
    t_s[1] = t_s[0]  # one that a logger wrote twice
    notes = taxelflow.estimate(taxelflow.recording(t_s, moving(), PALM)).summary.notes
    assert any(note.startswith("dropped 48 scans with the time stamp of the one before, 12") for note in notes) == noted


def test_a_path_that_rounds_to_nothing_has_no_minus(result: taxelflow.Result) -> None:
    (contact,) = result.summary.contacts
    still = msgspec.structs.replace(contact, net_m=(-1e-6, 1e-6), turn_rad=-1e-6)
    (row,) = contact_table(msgspec.structs.replace(result.summary, contacts=[still])).rows
    assert row[-2:] == ["0.0, 0.0", "0.0"]


@pytest.mark.parametrize("masked", [np.zeros(28, dtype=np.bool_), [True], [1.5], ["a"], [28], [-1]], ids=str)
def test_masked_holds_numbers_of_taxels(masked: object) -> None:
    with pytest.raises(ParameterInvalid, match="masked must hold numbers of taxels, from 0 to 27"):
        taxelflow.recording(np.arange(60) / 10, moving(), PALM, masked=masked)  # type: ignore[arg-type]


@pytest.mark.parametrize("given", [np.zeros((3, 28)), [1, 2], None], ids=["array", "list", "none"])
def test_arrays_in_place_of_a_recording_are_refused_with_what_makes_one(given: object) -> None:
    with pytest.raises(ParameterInvalid, match=r"recording must be a path, or a Recording: taxelflow\.recording\("):
        taxelflow.estimate(given)  # type: ignore[arg-type]
