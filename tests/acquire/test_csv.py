from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from synthetic import grid_sensor
from taxelflow.acquire.csv import open_csv
from taxelflow.errors import RecordingCorrupt, SensorNeeded, TaxelCountWrong, TimesNotIncreasing
from taxelflow.pipeline.api import read

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.acquire.base import Reading

SENSOR = grid_sensor(1, 3)
HEADER = "t_s,a,b,c\n"


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def read_csv(tmp_path: Path, text: str) -> tuple[list[list[float]], Reading]:
    reading = open_csv(write(tmp_path / "scans.csv", text), SENSOR).blocks()
    rows = [[t, *values] for block in reading for t, values in zip(block.t_s, block.values.tolist(), strict=True)]
    return rows, reading


def test_times_and_taxels_are_read(tmp_path: Path) -> None:
    rows, reading = read_csv(tmp_path, HEADER + "0.0,1,2,3\n0.1,4.5,-5e1,6\n")
    assert rows == [[0.0, 1, 2, 3], [0.1, 4.5, -50, 6]]
    assert reading.loss is None


@pytest.mark.parametrize("field", ["", " ", "nan", "NaN"])
def test_an_empty_or_nan_field_is_a_missing_taxel(tmp_path: Path, field: str) -> None:
    rows, _ = read_csv(tmp_path, f"{HEADER}0.0,1,{field},3\n")
    np.testing.assert_array_equal(rows, [[0.0, 1, np.nan, 3]])


@pytest.mark.parametrize("text", ["﻿" + HEADER + "0,1,2,3\n", HEADER.replace("\n", "\r\n") + "0,1,2,3\r\n"])
def test_a_byte_order_mark_and_windows_line_ends_are_fine(tmp_path: Path, text: str) -> None:
    path = tmp_path / "scans.csv"
    path.write_bytes(text.encode())
    assert open_csv(path, SENSOR).load().values.tolist() == [[1, 2, 3]]


def test_a_last_line_without_an_end_and_blank_lines_are_fine(tmp_path: Path) -> None:
    rows, reading = read_csv(tmp_path, HEADER + "0,1,2,3\n\n1,4,5,6\n\n")
    assert len(rows) == 2
    assert reading.loss is None
    rows, _ = read_csv(tmp_path, HEADER + "0,1,2,3\n1,4,5,6")
    assert len(rows) == 2


def test_quoted_fields_are_fine(tmp_path: Path) -> None:
    rows, _ = read_csv(tmp_path, '"t_s","a, left","b","c"\n"0","1","2","3"\n')
    assert rows == [[0, 1, 2, 3]]


def test_a_long_file_comes_in_blocks_and_twice_the_same(tmp_path: Path) -> None:
    text = HEADER + "".join(f"{scan},{scan},0,0\n" for scan in range(2100))
    recording = open_csv(write(tmp_path / "a.csv", text), SENSOR)
    assert [len(block) for block in recording.blocks()] == [1024, 1024, 52]
    np.testing.assert_array_equal(recording.load().values[:, 0], np.arange(2100))


@pytest.mark.parametrize("text", ["", "a,b,c\n1,2,3\n", "\n\n"])
def test_a_wrong_header_is_shown_with_the_right_one(tmp_path: Path, text: str) -> None:
    with pytest.raises(RecordingCorrupt, match=r"the header starts with .*a header row `t_s,"):
        open_csv(write(tmp_path / "a.csv", text), SENSOR)


def test_a_sensor_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(SensorNeeded, match="--sensor"):
        read(write(tmp_path / "a.csv", HEADER + "0,1,2,3\n"))


def test_a_wrong_taxel_count_is_named(tmp_path: Path) -> None:
    with pytest.raises(TaxelCountWrong, match=r"4 taxels per scan but sensor 'grid' has 3"):
        open_csv(write(tmp_path / "a.csv", "t_s,a,b,c,d\n0,1,2,3,4\n"), SENSOR)


def test_text_where_a_number_belongs_is_corrupt_after_the_scans_before_it(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", HEADER + "0,1,2,3\n1,1,2,3\n2,1,high,3\n3,1,2,3\n")
    reading = open_csv(path, SENSOR).blocks()
    assert next(reading).t_s.tolist() == [0, 1]
    with pytest.raises(RecordingCorrupt, match=r"scan 2: .*high"):
        next(reading)


def test_a_short_last_row_is_a_truncated_file_of_which_the_rest_is_read(tmp_path: Path) -> None:
    rows, reading = read_csv(tmp_path, HEADER + "0,1,2,3\n1,1,2,3\n2,1,2")
    assert len(rows) == 2
    assert reading.loss is not None
    assert "2 scans could be read" in str(reading.loss)


def test_blank_lines_after_a_short_last_row_change_nothing(tmp_path: Path) -> None:
    rows, reading = read_csv(tmp_path, HEADER + "0,1,2,3\n1,1\n\n")
    assert len(rows) == 1
    assert reading.loss is not None


@pytest.mark.parametrize("row", ["1,1,2", "1,1,2,3,4"])
def test_a_ragged_row_in_the_middle_is_corrupt(tmp_path: Path, row: str) -> None:
    reading = open_csv(write(tmp_path / "a.csv", f"{HEADER}0,1,2,3\n{row}\n2,1,2,3\n"), SENSOR).blocks()
    assert len(next(reading)) == 1
    with pytest.raises(RecordingCorrupt, match=r"scan 1 has [35] columns, the header 4"):
        next(reading)


def test_a_last_row_that_is_too_long_is_corrupt(tmp_path: Path) -> None:
    with pytest.raises(RecordingCorrupt, match="scan 1 has 5 columns"):
        read_csv(tmp_path, HEADER + "0,1,2,3\n1,1,2,3,4\n")


def test_a_header_alone_is_refused_as_empty(tmp_path: Path) -> None:
    with pytest.raises(RecordingCorrupt, match=r"it is not damaged, but holds no scans; record it again$"):
        read_csv(tmp_path, HEADER)


def test_a_missing_time_is_an_error_about_times(tmp_path: Path) -> None:
    with pytest.raises(TimesNotIncreasing, match=r"scan 1 has no time .nan.; leave out scans"):
        read_csv(tmp_path, HEADER + "0,1,2,3\n,1,2,3\n")


@pytest.mark.parametrize(
    "content", [b"\xff\xfe\x00\x01" * 50, b"t_s,a,b,c\n0,1,2,\xff\xff\n", b"t_s,a,b,c\n0,\x00,2,3\n"]
)
def test_bytes_that_are_no_text_are_corrupt(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(content)
    with pytest.raises(RecordingCorrupt) as caught:
        open_csv(path, SENSOR).load()
    assert "\n" not in str(caught.value)


def test_a_field_without_end_is_corrupt(tmp_path: Path) -> None:
    with pytest.raises(RecordingCorrupt):
        open_csv(write(tmp_path / "a.csv", HEADER + '0,1,2,"' + "9" * 200_000), SENSOR).load()
