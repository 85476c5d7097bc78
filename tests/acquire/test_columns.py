from __future__ import annotations

import gzip
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taxelflow.acquire.columns import Columns
from taxelflow.acquire.csv import open_csv
from taxelflow.errors import ParameterInvalid, RecordingCorrupt, TaxelCountWrong
from taxelflow.pipeline.api import read as read_any
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor


def plain(taxels: int) -> Sensor:
    return Sensor("plain", "count", (Pad("pad", 1, taxels, (0.004, 0.004)),))


def read(folder: Path, text: str, count: int, name: str = "log.csv", **asked: Any) -> Any:
    path = folder / name
    path.write_text(text)
    return open_csv(path, plain(count), Columns(**asked)).load()


def refused(folder: Path, text: str, match: str, count: int = 2, **asked: Any) -> None:
    with pytest.raises((RecordingCorrupt, TaxelCountWrong), match=match) as caught:
        read(folder, text, count, **asked)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("unit", "factor"), [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)])
def test_time_may_stand_in_any_column_and_unit(tmp_path: Path, unit: Any, factor: float) -> None:
    raw = read(tmp_path, "a,stamp,b\n1,1000,2\n3,2000,4\n", 2, time="stamp", time_unit=unit)
    np.testing.assert_allclose(raw.t_s, [1000 * factor, 2000 * factor])
    assert raw.values.tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize("suffix", ["csv", "npy", "parquet", "times"])
def test_times_in_ms_are_the_numbers_that_times_in_s_are_read_as(tmp_path: Path, suffix: str) -> None:
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    rows = np.column_stack([10.0 * np.arange(800), np.ones(800)])
    np.savetxt(tmp_path / "a.csv", rows, "%g", delimiter=",", header="stamp,a", comments="")
    np.savetxt(tmp_path / "times.txt", rows[:, 0], "%g")
    np.save(tmp_path / "a.npy", rows)
    parquet.write_table(arrow.table({"stamp": rows[:, 0], "a": rows[:, 1]}), tmp_path / "a.parquet")
    asked = Columns(time="0" if suffix == "npy" else "stamp", time_unit="ms", taxels=("1" if suffix == "npy" else "a",))
    if suffix == "times":
        asked, suffix = Columns(times=tmp_path / "times.txt", time_unit="ms", taxels=("a",)), "csv"
    scans = read_any(tmp_path / f"a.{suffix}", plain(1), columns=asked).load()
    assert scans.t_s.tolist() == [k / 100 for k in range(800)]


@pytest.mark.parametrize(
    ("taxels", "wanted"),
    [
        (("p*",), [[1, 2, 3]]),
        (("p0", "p2", "p1"), [[1, 3, 2]]),
        (("re:p[02]", "q"), [[1, 3, 9]]),
        (("2-3", "1"), [[2, 3, 1]]),
        (("q", "p*"), [[9, 1, 2, 3]]),
    ],
)
def test_taxels_are_chosen_by_name_wildcard_expression_or_number_in_any_order(
    tmp_path: Path, taxels: tuple[str, ...], wanted: list[list[float]]
) -> None:
    raw = read(tmp_path, "t_s,p0,p1,p2,q,label\n0,1,2,3,9,left\n", len(wanted[0]), taxels=taxels)
    assert raw.values.tolist() == wanted


def test_columns_in_another_order_than_their_numbers_must_be_declared(tmp_path: Path) -> None:
    text = "t_s,p0,p10,p2\n0,1,3,2\n"
    refused(tmp_path, text, "columns are not sorted: 'p10' comes before.*--columns.order number, or file", 3)
    assert read(tmp_path, text, 3, order="number").values.tolist() == [[1, 2, 3]]
    assert read(tmp_path, text, 3, order="file").values.tolist() == [[1, 3, 2]]


def test_two_numbers_in_a_name_are_row_and_column(tmp_path: Path) -> None:
    text = "t_s,r0c0,r1c0,r0c1,r1c1\n0,1,3,2,4\n"
    assert read(tmp_path, text, 4, order="number").values.tolist() == [[1, 2, 3, 4]]


@pytest.mark.parametrize(
    ("name", "text", "asked"),
    [
        ("a.csv", "t_s;a;b\n0;1;2\n1;3;4\n", {"delimiter": ";"}),
        ("a.csv", "t_s\ta\tb\n0\t1\t2\n1\t3\t4\n", {"delimiter": "tab"}),
        ("a.tsv", "t_s\ta\tb\n0\t1\t2\n1\t3\t4\n", {}),
        ("a.txt", "t_s  a b\n 0 1  2\n1\t3 4\n", {}),
        ("a.txt", "# a log\n\nt_s a b\n0 1 2\n1 3 4\n", {"skip": 1}),
        ("a.txt", "0 1 2\n1 3 4\n", {"header": False, "time": "0"}),
        ("a.csv", "0,1\n2\n1,3\n4\n", {"header": False, "time": "0", "rows_per_scan": 2}),
        ("a.txt", "-1\n0 1\n2\n1 3\n4", {"header": False, "time": "0", "rows_per_scan": 2, "skip": 1}),
        ("a.csv", '"t_s","a","b"\n"0","1","2"\n"1","3","4"\n', {}),
    ],
)
def test_delimiters_headers_and_scans_of_several_rows(
    tmp_path: Path, name: str, text: str, asked: dict[str, Any]
) -> None:
    raw = read(tmp_path, text, 2, name, **asked)
    assert raw.t_s.tolist() == [0, 1]
    assert raw.values.tolist() == [[1, 2], [3, 4]]


def test_a_log_without_times_has_a_rate_and_that_is_noted(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("a,b\n" + "1,2\n" * 1500)
    recording = open_csv(path, plain(2), Columns(rate_hz=50.0))
    np.testing.assert_allclose(recording.load().t_s, np.arange(1500) / 50)
    assert recording.notes == ("times computed from the rate of 50 Hz: the log has none",)


@pytest.mark.parametrize(
    ("text", "match", "asked"),
    [
        ("t_s,a,b\n0,1,2\n", "no column matches 'p*' among t_s, a, b; set --columns.taxels", {"taxels": ("p*",)}),
        ("t_s,a,b\n0,1,2\n", "no column matches '1-7'", {"taxels": ("1-7",)}),
        ("t_s,a,b\n0,1,2\n", "column 'a' is matched twice", {"taxels": ("a", "*")}),
        ("# my log\nt_s,a,b\n0,1,2\n", "starts with '# my log'; pass over lines of comments with --columns.skip N", {}),
        ("t_s,a,b\n0,1,2\n", "no column 'stamp': the header starts with 't_s,a,b'", {"time": "stamp"}),
        ("t_s,a,b\n0,1,2\n", "3 taxels per scan but sensor 'plain' has 2", {"rate_hz": 1.0}),
        (
            "0;1;2\n1;3;4\n",
            "its first row has one field, '0;1;2'; set --columns.delimiter ';'",
            {"header": False, "time": "0"},
        ),
        ("a b\n1 2\n3 4\n", "its first row has one field, 'a b'; set --columns.delimiter space", {"rate_hz": 1.0}),
        (
            "t_s,a,b\n0,1,left\n",
            "scan 0: column 'b' holds 'left', which is no number; leave the field of a missing",
            {},
        ),
        (
            't_s,a,b\n0,"0,5","1,5"\n',
            "column 'a' holds '0,5', which is no number; write numbers with a decimal point",
            {},
        ),
        ("t_s,a,b\n12:34:05.1,1,2\n", "column 't_s' holds '12:34:05.1', which is no time; give times as numbers,", {}),
        ("t_s,a,b\n2024-05-01,1,2\nnoon,1,2\n", "scan 1: column 't_s' holds 'noon', which is no time; give times", {}),
        ("0.0,1,2\n0.1,1,2\n", "where it has no header, add --columns.no-header and the time's column, such as", {}),
        ("0,1,2\n", "give the number of the time's column, such as --columns.time 0, or the rate", {"header": False}),
        ("Time [ms],a,b\n0,1,2\n", "name the time with --columns.time 'Time [ms]' --columns.time-unit ms", {}),
        ("n,stamp,a,b\n0,0,1,2\n", "name the time with --columns.time 'stamp'", {}),
        ("force_a,force_b\n1,2\n", "'force_a,force_b'; a recording has a header row `t_s,", {}),
        (
            "0 1 2\n1 2\n3 4 5\n",
            "scan 1 has 2 columns, the first 3",
            {"header": False, "time": "0", "delimiter": "space"},
        ),
    ],
)
def test_what_does_not_fit_is_refused_with_what_was_found(
    tmp_path: Path, text: str, match: str, asked: dict[str, Any]
) -> None:
    refused(tmp_path, text, re.escape(match), **asked)


def test_columns_and_files_may_be_given_as_python_has_them(tmp_path: Path) -> None:
    (tmp_path / "t.txt").write_text("0\n1\n")
    text, numbered = "0.0,1,2\n0.1,3,4\n", Columns(time=0, header=False)  # type: ignore[arg-type]
    (tmp_path / "a.csv").write_text(text)
    assert open_csv(tmp_path / "a.csv", plain(2), numbered).load().t_s.tolist() == [0.0, 0.1]
    apart = Columns(times=str(tmp_path / "t.txt"), header=False, taxels=("1-2",))  # type: ignore[arg-type]
    assert open_csv(tmp_path / "a.csv", plain(2), apart).load().t_s.tolist() == [0.0, 1.0]


@pytest.mark.parametrize("pack", [gzip.compress, lambda text: text.decode().encode("utf-16")], ids=["gzip", "utf-16"])
def test_a_file_that_is_no_text_is_named_as_that(tmp_path: Path, pack: Any) -> None:
    (tmp_path / "a.csv").write_bytes(pack(b"t_s,a,b\n0,1,2\n" * 20))
    with pytest.raises(RecordingCorrupt, match=r"it is no text in UTF-8: unpack it .gunzip. or convert it .iconv"):
        open_csv(tmp_path / "a.csv", plain(2))


def test_a_cut_last_scan_of_several_rows_is_a_loss(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("0 1\n2\n1 3\n4\n2 5\n")
    reading = open_csv(path, plain(2), Columns(header=False, time="0", rows_per_scan=2)).blocks()
    assert sum(len(block) for block in reading) == 2
    assert "2 scans could be read" in str(reading.loss)


def test_a_mapping_may_stand_in_a_file_and_what_is_given_beside_it_comes_first(tmp_path: Path) -> None:
    mapping = tmp_path / "log.toml"
    mapping.write_text('time = "ms"\ntime_unit = "ms"\ntaxels = ["a", "b"]\n')
    raw = read(tmp_path, "ms,a,b,c\n5,1,2,3\n", 2, file=mapping)
    assert (raw.t_s.tolist(), raw.values.tolist()) == ([0.005], [[1, 2]])
    raw = read(tmp_path, "ms,a,b,c\n5,1,2,3\n", 1, file=mapping, taxels=("c",))
    assert raw.values.tolist() == [[3]]


def test_a_mapping_in_a_file_may_name_a_file_beside_it_and_a_column_by_number(tmp_path: Path) -> None:
    (tmp_path / "t.txt").write_text("7\n")
    (tmp_path / "log.toml").write_text('times = "t.txt"\ntaxels = ["a"]\n')
    assert read(tmp_path, "n,a\n5,1\n", 1, file=tmp_path / "log.toml").t_s.tolist() == [7]
    (tmp_path / "log.toml").write_text("time = 1\n")
    assert read(tmp_path, "a,ms\n5,8\n", 1, file=tmp_path / "log.toml").t_s.tolist() == [8]


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("times = 3", "a path is text, not 3"),
        ("tiem = 1", "must have only the fields time, time_unit, times, rate_hz.*tiem"),
        ("time_unit = 'h'", "columns.file must be a readable TOML file: Invalid enum value 'h'"),
        ("time = ", "columns.file must be a readable TOML file"),
        ("skip = -1", "columns.skip must be at least 0 .got -1.|-1"),
    ],
)
def test_a_broken_mapping_is_refused(tmp_path: Path, text: str, match: str) -> None:
    (tmp_path / "log.toml").write_text(text)
    with pytest.raises(ParameterInvalid, match=match):
        Columns(file=tmp_path / "log.toml").resolved()
    with pytest.raises(ParameterInvalid, match="No such file"):
        Columns(file=tmp_path / "none.toml").resolved()


@pytest.mark.parametrize(
    ("asked", "match"),
    [
        ({"rate_hz": 0.0}, r"columns.rate_hz must be a finite number above 0, in Hz \(got 0\.0\)"),
        ({"skip": -1}, "columns.skip must be at least 0"),
        ({"rows_per_scan": 0}, "columns.rows_per_scan must be at least 1"),
        ({"rows_per_scan": 2}, "add --columns.no-header"),
        ({"taxels": "p*"}, r"columns.taxels must be a tuple of patterns, such as \('p\*',\)"),
        ({"time_unit": "sec"}, "columns.time_unit must be one of s, ms, us, ns"),
        ({"order": "nmber"}, "columns.order must be one of file, number"),
        ({"delimiter": "::"}, r"columns.delimiter must be one character, tab or space \(got '::'\)"),
    ],
)
def test_parameters_out_of_range_are_refused(asked: dict[str, Any], match: str) -> None:
    with pytest.raises(ParameterInvalid, match=match):
        Columns(**asked)


def test_a_broken_expression_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterInvalid, match=r"columns.taxels must be a regular expression"):
        read(tmp_path, "t_s,a\n0,1\n", 1, taxels=("re:(",))


readings = st.just(float("nan")) | st.floats(-1e29, 1e29)  # what is larger is missing


@given(st.lists(st.lists(readings, min_size=3, max_size=3), min_size=1, max_size=5))
def test_the_fast_parser_and_the_careful_one_agree(
    tmp_path_factory: pytest.TempPathFactory, rows: list[list[float]]
) -> None:
    folder = tmp_path_factory.getbasetemp()
    lines = [",".join(map(repr, [number, *row])) for number, row in enumerate(rows)]
    quoted = [",".join(f'"{field}"' for field in line.split(",")) for line in lines]
    plain_one = read(folder, "t_s,a,b,c\n" + "\n".join(lines), 3)
    careful = read(folder, "t_s,a,b,c\n" + "\n".join(quoted), 3)
    np.testing.assert_array_equal(plain_one.values, careful.values)
    np.testing.assert_array_equal(plain_one.values, rows)


def test_the_icub_logs_are_read(recordings: Path) -> None:
    asked = Columns(header=False, skip=1, rows_per_scan=7, taxels=("14-73",), rate_hz=20.0)
    for path in sorted((recordings / "icub-grasp").glob("blue*.txt")):
        recording = open_csv(path, load_sensor("icub-fingertips-60"), asked)
        sent = next(recording.read()).values
        assert sent.shape == (12, 60)
        assert ((sent > 200) & (sent <= 255)).all()
        np.testing.assert_array_equal(recording.load().values, 255 - sent)


@pytest.mark.parametrize(
    ("header", "seen", "remedy"),
    [
        (",t_s,v0,v1", 3, "leave out '' with --columns.taxels 2-3, or choose the matching sensor with --sensor NAME"),
        ("t_s,v0,v1,", 3, "leave out '' with --columns.taxels 1-2, or"),
        ("Unnamed: 0,t_s,left,right", 3, "leave out 'Unnamed: 0' with --columns.taxels 2-3, or"),
        ("t_s,frame,v0,v1,label", 4, "leave out 'frame', 'label' with --columns.taxels 2-3, or"),
        ("t_s,v0,v1,v2", 3, "leave out columns that are no taxels with --columns.taxels, or"),
        ("v0,t_s,v1,", 3, "leave out columns that are no taxels with --columns.taxels, or"),
        ("t_s,v0", 1, "; choose the matching sensor"),
    ],
)
def test_columns_that_are_no_taxels_are_named_with_the_option_for_them(
    header: str, seen: int, remedy: str, tmp_path: Path
) -> None:
    rows = ",".join("1" for _ in header.split(","))
    with pytest.raises(TaxelCountWrong) as caught:
        read(tmp_path, f"{header}\n{rows}\n", 2)
    assert f"has {seen} taxels per scan but sensor 'plain' has 2;" in str(caught.value)
    assert remedy in str(caught.value)
    if "2-3" in remedy:
        assert read(tmp_path, f"{header}\n{rows}\n", 2, taxels=("2-3",)).values.tolist() == [[1, 1]]
