from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from synthetic import grid_sensor
from taxelflow.acquire.columns import Columns
from taxelflow.acquire.parquet import open_parquet
from taxelflow.errors import ExtraMissing, RecordingCorrupt, SensorNeeded, TaxelCountWrong
from taxelflow.pipeline.api import read

if TYPE_CHECKING:
    from pathlib import Path

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")

SENSOR = grid_sensor(1, 2)


def write(folder: Path, columns: dict[str, Any]) -> Path:
    path = folder / "a.parquet"
    pq.write_table(pa.table(columns), path)
    return path


def test_plain_columns_of_any_number_are_read(tmp_path: Path) -> None:
    path = write(
        tmp_path, {"t_s": [0.0, 0.1], "a": pa.array([1, None], pa.int16()), "b": pa.array([3, 4], pa.float32())}
    )
    recording = open_parquet(path, SENSOR)
    assert (recording.format, recording.scans) == ("parquet", 2)
    np.testing.assert_array_equal(recording.load().values, [[1, 3], [np.nan, 4]])
    np.testing.assert_array_equal(recording.load().t_s, [0.0, 0.1])


def test_a_taxel_that_was_never_read_is_missing(tmp_path: Path) -> None:
    path = write(tmp_path, {"t_s": [0.0, 0.1], "a": pa.nulls(2), "b": [3.0, 4.0]})
    np.testing.assert_array_equal(open_parquet(path, SENSOR).load().values, [[np.nan, 3], [np.nan, 4]])


def test_columns_of_joints_are_angles(tmp_path: Path) -> None:
    known = {"t_s": [0.0, 0.1, 0.2], "joint:a b": [0.5, None, 0.7], "a": [1.0, 2.0, 3.0], "b": [3.0, 4.0, 5.0]}
    recording = open_parquet(write(tmp_path, known), SENSOR)
    assert recording.load().values.shape == (3, 2)
    assert recording.joints is not None
    np.testing.assert_allclose(recording.joints.at(np.array([0.05, 0.2]), ["a b"])[:, 0], [0.55, 0.7])
    with pytest.raises(RecordingCorrupt, match="column 'joint:a b' holds string, not numbers; store angles in rad"):
        open_parquet(write(tmp_path, known | {"joint:a b": ["x", "y", "z"]}), SENSOR)


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_time_stamps_bring_their_unit(tmp_path: Path, unit: str) -> None:
    stamps = pa.array([2_000_000_000, 4_000_000_000], pa.timestamp("ns")).cast(pa.timestamp(unit))
    path = write(tmp_path, {"when": stamps, "a": [1, 2], "b": [3, 4]})
    np.testing.assert_allclose(open_parquet(path, SENSOR, Columns(time="when")).load().t_s, [2, 4])


def test_a_table_without_times_has_a_rate(tmp_path: Path) -> None:
    recording = open_parquet(write(tmp_path, {"a": np.zeros(2000), "b": np.ones(2000)}), SENSOR, Columns(rate_hz=20.0))
    np.testing.assert_allclose(recording.load().t_s, np.arange(2000) / 20)
    assert "the log has none" in recording.notes[0]


def test_a_long_file_comes_in_blocks(tmp_path: Path) -> None:
    path = write(tmp_path, {"t_s": np.arange(2100.0), "a": np.zeros(2100), "b": np.zeros(2100)})
    assert max(len(block) for block in open_parquet(path, SENSOR).blocks()) == 1024


@pytest.mark.parametrize(
    ("columns", "asked", "match"),
    [
        ({"t_s": [0.0], "a": ["x"], "b": [1]}, {}, "column 'a' holds string, not numbers"),
        ({"t_s": ["x"], "a": [1], "b": [1]}, {}, "Invalid isoformat string: 'x'"),
        ({"time": [0.0], "a": [1], "b": [1]}, {}, "no column 't_s'"),
        ({"t_s": [0.0], "a": [1], "b": [1]}, {"taxels": ("p*",)}, r"no column matches 'p\*'"),
    ],
)
def test_columns_that_do_not_fit_are_named(
    tmp_path: Path, columns: dict[str, Any], asked: dict[str, Any], match: str
) -> None:
    with pytest.raises(RecordingCorrupt, match=match):
        open_parquet(write(tmp_path, columns), SENSOR, Columns(**asked)).load()


def test_sensor_and_count_are_checked(tmp_path: Path) -> None:
    path = write(tmp_path, {"t_s": [0.0], "a": [1]})
    with pytest.raises(SensorNeeded):
        read(path)
    with pytest.raises(TaxelCountWrong, match="1 taxels per scan but sensor 'grid' has 2"):
        read(path, SENSOR)


def test_without_pyarrow_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path, {"t_s": [0.0], "a": [1], "b": [1]})
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ExtraMissing, match=r"pip install 'taxelflow\[tables\]'"):
        read(path, SENSOR)


@pytest.mark.parametrize(
    "kind", [pa.list_(pa.float32()), pa.list_(pa.int16(), 2), pa.large_list(pa.float64()), pa.list_(pa.float64())]
)
def test_a_column_of_lists_holds_all_taxels(tmp_path: Path, kind: Any) -> None:
    rows = pa.array([[1, 2], [3, None], None, [5, 6]], kind)
    recording = open_parquet(write(tmp_path, {"t_s": [0.0, 0.1, 0.2, 0.3], "taxels": rows}), SENSOR)
    np.testing.assert_array_equal(recording.load().values, [[1, 2], [3, np.nan], [np.nan] * 2, [5, 6]])


def test_lists_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    t_s = {"t_s": [0.0, 0.1]}
    ragged = open_parquet(write(tmp_path, t_s | {"taxels": [[1.0, 2.0], [3.0]]}), SENSOR)
    with pytest.raises(RecordingCorrupt, match="scan 1 has 1 numbers in column 'taxels'; it needs 2 in each row"):
        ragged.load()
    fixed = pa.array([[1, 2, 3], [4, 5, 6]], pa.list_(pa.int16(), 3))
    with pytest.raises(TaxelCountWrong, match="column 'taxels' holds lists of 3"):
        open_parquet(write(tmp_path, t_s | {"taxels": fixed}), SENSOR)
    both = t_s | {"taxels": [[1.0, 2.0], [3.0, 4.0]], "force": [1.0, 2.0]}
    with pytest.raises(RecordingCorrupt, match=r"2 columns of taxels; choose it alone, with --columns.taxels 'taxels'"):
        open_parquet(write(tmp_path, both), SENSOR)
    chosen = open_parquet(tmp_path / "a.parquet", SENSOR, Columns(taxels=("taxels",)))
    np.testing.assert_array_equal(chosen.load().values, [[1, 2], [3, 4]])
    with pytest.raises(RecordingCorrupt, match=r"column 'taxels' holds list<.*string.*>, not numbers"):
        open_parquet(write(tmp_path, t_s | {"taxels": [["a", "b"], ["c", "d"]]}), SENSOR)
