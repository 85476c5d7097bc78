from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from synthetic import grid_sensor
from taxelflow.acquire.columns import Columns
from taxelflow.acquire.times import is_iso, iso_seconds, read_times
from taxelflow.errors import ParameterInvalid, RecordingCorrupt
from taxelflow.pipeline.api import read

if TYPE_CHECKING:
    from pathlib import Path

SENSOR = grid_sensor(1, 2)
START_S = 1_763_805_600.0  # 2025-11-22T10:00:00Z


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("2025-11-22T10:00:00", 0.0),
        ("2025-11-22 10:00:00.25", 0.25),
        ("2025-11-22T11:00:00.500000+01:00", 0.5),
        ("2025-11-22T10:00:01Z", 1.0),
        ("20251122T100002", 2.0),
    ],
)
def test_iso_8601_dates_are_unix_times_utc_without_a_zone(text: str, seconds: float) -> None:
    assert is_iso(text)
    assert iso_seconds(text) == pytest.approx(START_S + seconds, abs=1e-6)


@pytest.mark.parametrize("text", ["1763805600.0", "20251122", "nan", "", "now", "12:30"])
def test_a_number_is_no_date(text: str) -> None:
    assert not is_iso(text)


@pytest.mark.parametrize("quote", ["", '"'])
def test_a_csv_with_iso_times_is_read_in_s(tmp_path: Path, quote: str) -> None:
    stamps = [f"{quote}2025-11-22T10:00:00.{k:02d}0{quote}" for k in range(30)]
    (tmp_path / "a.csv").write_text("stamp,a,b\n" + "".join(f"{stamp},1,2\n" for stamp in stamps))
    scans = read(tmp_path / "a.csv", SENSOR, columns=Columns(time="stamp", time_unit="ns")).load()
    np.testing.assert_allclose(scans.t_s - START_S, np.arange(30) / 100, atol=1e-6)
    np.testing.assert_array_equal(scans.values, [[1.0, 2.0]] * 30)


def test_a_row_whose_date_is_broken_is_named(tmp_path: Path) -> None:
    rows = ["2025-11-22T10:00:00", "2025-11-22T10:00:01", "yesterday"]
    (tmp_path / "a.csv").write_text("t_s,a,b\n" + "".join(f"{row},1,2\n" for row in rows))
    with pytest.raises(RecordingCorrupt, match=r"scan 2: column .t_s. holds .yesterday., which is no time"):
        read(tmp_path / "a.csv", SENSOR).load()


def test_parquet_has_iso_times_too(tmp_path: Path) -> None:
    table = pa.table({"t_s": ["2025-11-22T10:00:00", "2025-11-22T10:00:00.5"], "a": [1.0, 2.0], "b": [1.0, 2.0]})
    pq.write_table(table, tmp_path / "a.parquet")
    assert np.diff(read(tmp_path / "a.parquet", SENSOR).load().t_s).tolist() == [0.5]


@pytest.mark.parametrize("head", ["", "time\n", "\ufeff"])
@pytest.mark.parametrize("rest", ["", ",7", "\t7"])
def test_times_may_stand_in_a_second_file(tmp_path: Path, head: str, rest: str) -> None:
    (tmp_path / "t.txt").write_text(head + "".join(f"{10 * k}{rest}\n" for k in range(20)), encoding="utf-8")
    (tmp_path / "a.csv").write_text("a,b\n" + "1,2\n" * 20)
    asked = Columns(times=tmp_path / "t.txt", time_unit="ms")
    np.testing.assert_allclose(read(tmp_path / "a.csv", SENSOR, columns=asked).load().t_s, np.arange(20) / 100)


def test_they_may_be_dates_or_an_array(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("stamp\n2025-11-22T10:00:00\n2025-11-22T10:00:01\n")
    assert (read_times(tmp_path / "t.csv", 1.0) - START_S).tolist() == [0.0, 1.0]
    np.save(tmp_path / "t.npy", np.arange(3))
    assert read_times(tmp_path / "t.npy", 1e3).tolist() == [0.0, 1e-3, 2e-3]


@pytest.mark.parametrize(("times", "seen"), [(19, "more than 19 scans"), (21, "20 scans, and .* 21 times")])
def test_as_many_times_as_scans_are_needed(tmp_path: Path, times: int, seen: str) -> None:
    (tmp_path / "t.txt").write_text("".join(f"{k}\n" for k in range(times)))
    (tmp_path / "a.csv").write_text("a,b\n" + "1,2\n" * 20)
    with pytest.raises(RecordingCorrupt, match=seen):
        read(tmp_path / "a.csv", SENSOR, columns=Columns(times=tmp_path / "t.txt")).load()


@pytest.mark.parametrize("content", ["t\n1\nx\n", "1\nx\n"])
def test_a_line_that_is_no_time_is_named(tmp_path: Path, content: str) -> None:
    (tmp_path / "t.txt").write_text(content)
    with pytest.raises(RecordingCorrupt, match=r"line . is 'x'; give a text file with one time per line"):
        read_times(tmp_path / "t.txt", 1.0)


def test_an_array_of_times_has_one_dimension(tmp_path: Path) -> None:
    np.save(tmp_path / "t.npy", np.zeros((2, 2)))
    with pytest.raises(RecordingCorrupt, match=r"it holds float64 \(2, 2\)"):
        read_times(tmp_path / "t.npy", 1.0)


def test_times_are_from_one_source_only(tmp_path: Path) -> None:
    with pytest.raises(ParameterInvalid, match=r"columns\.rate_hz must be left out"):
        Columns(times=tmp_path, rate_hz=10.0)


@pytest.mark.parametrize(
    ("t_s", "unit"),
    [
        (np.arange(50) * 10.0, "ms"),
        (1.7e18 + np.arange(50) * 1e7, "ns"),
        (1.7e15 + np.arange(50) * 1e4, "us"),
        (np.arange(50) * 1e7, "ns"),
    ],
)
def test_times_in_another_unit_are_guessed(tmp_path: Path, t_s: Any, unit: str) -> None:
    (tmp_path / "a.csv").write_text("t_s,a,b\n" + "".join(f"{t!r},1,2\n" for t in t_s.tolist()))
    reading = read(tmp_path / "a.csv", SENSOR).blocks()
    assert sum(map(len, reading)) == 50
    (note,) = reading.notes
    assert f"the times are likely in {unit} (--columns.time-unit {unit}" in note


def test_a_recording_of_one_scan_is_noted(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", t=np.zeros(1), pressure=np.zeros((1, 2)))
    reading = read(tmp_path / "a.npz", SENSOR).blocks()
    assert sum(map(len, reading)) == 1
    assert "the recording holds 1 scan: noise and motion need more; check that its rows are scans" in reading.notes[0]
