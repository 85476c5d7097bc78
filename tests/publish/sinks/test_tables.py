"""The tables of a live run are those of a batch of results."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from synthetic import grid_sensor
from taxelflow.errors import AddressInvalid, SinkUnusable
from taxelflow.messages import LearnedPattern, Output, SpatialMotions
from taxelflow.pipeline.api import estimate
from taxelflow.publish.patterns import read_patterns
from taxelflow.publish.sinks.base import Ending, Head, Update
from taxelflow.publish.sinks.patient import PatientFile
from taxelflow.publish.sinks.tables import TablesSink, write
from taxelflow.publish.tables import Tables
from taxelflow.runtime.addresses import parse_address

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.acquire.base import Recording
    from taxelflow.pipeline.result import Result


@pytest.fixture
def result(stroke: Recording) -> Result:
    return estimate(stroke)


def update_of(result: Result, spatial: SpatialMotions | None = None) -> Update:
    output = Output(
        result.slips,
        result.slipping,
        result.motions,
        result.events,
        result.contacts,
        result.evidence,
        result.evidence,
        spatial,
    )
    return Update(result.slips.t_s, output)


def opened(folder: Path) -> TablesSink:
    sensor, sink = grid_sensor(4, 7), TablesSink(folder)
    sink.open(Head(sensor, sensor.layout.pads, {}, lambda _kind, _text: None))
    return sink


def texts(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.glob("*.csv*")}


def test_a_run_leaves_the_tables_of_its_results_and_its_summary(result: Result, tmp_path: Path) -> None:
    sink = opened(tmp_path / "live")
    assert sink.lossless  # of a table no row may be missing
    sink.write(update_of(result))
    sink.close(Ending(result.summary, []))
    with Tables(tmp_path / "batch", result.pads) as expected:
        expected.write(result.slips, result.slipping, result.motions, result.events, result.contacts, result.evidence)
        expected.write_summary(result.summary)
    assert texts(tmp_path / "live") == texts(tmp_path / "batch")
    summaries = [(tmp_path / name / "summary.json").read_bytes() for name in ("live", "batch")]
    assert summaries[0] == summaries[1]
    assert len(result.events) > 1


def test_a_run_that_fails_keeps_its_rows_in_part_files(result: Result, tmp_path: Path) -> None:
    sink = opened(tmp_path)
    sink.write(update_of(result))
    sink.close(Ending(None, [], failed=True))
    assert {path.suffix for path in tmp_path.iterdir()} == {".part"}
    assert (tmp_path / "slips.csv.part").read_text().count("\n") == 81


def test_maps_and_motion_in_space_have_files_of_their_own(result: Result, tmp_path: Path) -> None:
    scans, pads = result.slips.contact.shape
    whole, flags = np.zeros(scans, np.int64), np.zeros(scans, np.bool_)
    vector, matrix = np.zeros((scans, 6)), np.zeros((scans, 6, 6))
    pose, blamed = np.zeros((scans, 7)), np.zeros((scans, pads), np.bool_)
    spatial = SpatialMotions(
        result.slips.t_s, vector, matrix, pose, matrix, whole, whole, matrix, matrix, vector, blamed, flags, whole
    )
    sink = opened(tmp_path)
    sink.write(update_of(result, spatial))
    line = np.zeros(2)
    learned = LearnedPattern("pad0", 0.0, 1.0, 9, line, line, np.ones((2, 2)), np.ones((2, 2)), False, whole[:0])
    sink.close(Ending(None, [learned]))
    assert (tmp_path / "object3d.csv").read_text().count("\n") == scans + 1
    assert [pattern.pad for pattern in read_patterns(tmp_path)] == ["pad0"]
    assert not (tmp_path / "summary.json").exists()


def test_a_run_that_ends_waits_for_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given_up: list[PatientFile] = []

    def note(file: PatientFile) -> None:
        given_up.append(file)

    monkeypatch.setattr(PatientFile, "give_up", note)
    sink = opened(tmp_path)
    sink.hurry()
    sink.close(Ending(None, []))
    assert len(given_up) == len(texts(tmp_path)) == 4


def test_a_directory_is_asked_for_and_nothing_else(tmp_path: Path) -> None:
    for text in ("tables:", f"tables:{tmp_path}?rows=3"):
        with pytest.raises(AddressInvalid):
            write(parse_address(text))
    (tmp_path / "file").write_text("")
    with pytest.raises(SinkUnusable):
        opened(tmp_path / "file")
