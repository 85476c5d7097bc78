"""LeRobot's format v3.0: its schema is checked here, as lerobot itself brings torch."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from taxelflow.cli import main
from taxelflow.errors import ParameterInvalid
from taxelflow.pipeline import api
from taxelflow.publish.lerobot import Episode, write_lerobot

pytest.importorskip("pyarrow", reason="pyarrow is not installed: pip install 'taxelflow[tables]'")
import pyarrow as pa
from pyarrow import parquet

INFO = {
    "codebase_version",
    "robot_type",
    "total_episodes",
    "total_frames",
    "total_tasks",
    "chunks_size",
    "data_files_size_in_mb",
    "video_files_size_in_mb",
    "fps",
    "splits",
    "data_path",
    "video_path",
    "features",
}


def episode(frames: int, task: str) -> Episode:
    return Episode(
        task,
        {
            "observation.state": np.arange(2.0 * frames, dtype=np.float32).reshape(frames, 2),
            "action": np.full((frames, 1), float(frames), dtype=np.float32),
        },
        {"action": ["force_n"]},
    )


def test_the_files_have_the_schema_of_the_format(tmp_path: Path) -> None:
    write_lerobot([episode(3, "hold"), episode(5, "pour"), episode(2, "hold")], tmp_path / "set", 100.0, "gripper")
    info = json.loads((tmp_path / "set/meta/info.json").read_text())
    assert set(info) == INFO
    assert (info["codebase_version"], info["fps"], info["splits"]) == ("v3.0", 100, {"train": "0:3"})
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (3, 10, 2)
    assert info["features"]["observation.state"] == {"dtype": "float32", "shape": [2], "names": None}
    assert info["features"]["action"] == {"dtype": "float32", "shape": [1], "names": ["force_n"]}
    data = parquet.read_table(tmp_path / "set" / info["data_path"].format(chunk_index=0, file_index=0))
    assert set(data.column_names) == set(info["features"])
    assert data.schema.field("observation.state").type == pa.list_(pa.float32(), 2)
    assert data.schema.field("action").type == pa.float32()  # the reader has no lists of one number
    for name in ("frame_index", "episode_index", "index", "task_index"):
        assert data.schema.field(name).type == pa.int64()
    assert data["timestamp"].to_pylist() == pytest.approx([0, 0.01, 0.02, 0, 0.01, 0.02, 0.03, 0.04, 0, 0.01])
    assert data["task_index"].to_pylist() == [0] * 3 + [1] * 5 + [0] * 2
    assert data["index"].to_pylist() == list(range(10))


def test_episodes_locate_their_frames_and_tasks_are_an_index(tmp_path: Path) -> None:
    write_lerobot([episode(3, "hold"), episode(5, "pour")], tmp_path, 100.0, "gripper")
    rows = parquet.read_table(tmp_path / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    places = [(row["dataset_from_index"], row["dataset_to_index"], row["length"], row["tasks"]) for row in rows]
    assert places == [(0, 3, 3, ["hold"]), (3, 8, 5, ["pour"])]
    assert rows[1]["stats/action/mean"] == [5.0]
    assert rows[0]["data/chunk_index"] == rows[0]["meta/episodes/file_index"] == 0
    pandas = pytest.importorskip("pandas")
    tasks = pandas.read_parquet(tmp_path / "meta/tasks.parquet")
    assert tasks.loc["pour"]["task_index"] == 1
    stats = json.loads((tmp_path / "meta/stats.json").read_text())
    assert stats["observation.state"]["max"] == [8.0, 9.0]


def test_the_table_reader_that_lerobot_uses_loads_it_with_the_features_of_info(tmp_path: Path) -> None:
    """LeRobot makes a feature of each entry of info.json, a number where the shape is [1], and casts the data to it."""
    datasets = pytest.importorskip("datasets", reason="datasets is not installed: pip install datasets")
    write_lerobot([episode(3, "hold"), episode(5, "pour")], tmp_path / "set", 100.0, "gripper")
    info = json.loads((tmp_path / "set/meta/info.json").read_text())
    features = {
        name: datasets.Value(one["dtype"])
        if one["shape"] == [1]
        else datasets.Sequence(datasets.Value(one["dtype"]), length=one["shape"][0])
        for name, one in info["features"].items()
    }
    for part, given in (("data", datasets.Features(features)), ("meta/episodes", None)):
        paths = [str(path) for path in sorted((tmp_path / "set" / part).glob("*/*.parquet"))]
        loaded = datasets.Dataset.from_parquet(paths, features=given, cache_dir=str(tmp_path / "cache"))
        assert len(loaded) == (8 if part == "data" else 2)
        if part == "data":
            assert loaded[7]["action"] == 5.0
            assert loaded[7]["observation.state"] == [8.0, 9.0]


def test_a_directory_with_something_in_it_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine").touch()
    with pytest.raises(ParameterInvalid, match="be a directory that is new or empty"):
        write_lerobot([episode(2, "hold")], tmp_path, 100.0, "gripper")


def test_convert_writes_a_recording_with_its_results(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording, out = tmp_path / "stroke.npz", tmp_path / "set"
    assert main(["simulate", "stroke", "--out", str(recording)]) == 0
    assert main(["convert", str(recording), str(out), "--to", "lerobot", "--method", "convolution"]) == 0
    assert "scans in" in capsys.readouterr().out
    data = parquet.read_table(out / "data/chunk-000/file-000.parquet")
    source = api.read(recording)
    assert data.num_rows == source.scans
    taxels = source.sensor.layout.taxels
    first = np.concatenate([block.values for block in source.blocks()])[0] * source.sensor.to_si
    np.testing.assert_allclose(data["observation.pressure"][0].as_py(), first.astype(np.float32))
    assert data.schema.field("observation.pressure").type.list_size == taxels
    assert data.schema.field("observation.velocity").type.list_size == 3 * len(source.sensor.layout.pads)
    assert max(map(max, data["observation.slipping"].to_pylist())) in (0.0, 1.0)


def test_convert_refuses_a_method_where_nothing_is_estimated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["convert", "stroke.npz", str(tmp_path / "a.csv"), "--method", "lnorm"]) == 2
    assert "--method must be left out without --to lerobot" in capsys.readouterr().err


@pytest.mark.long
def test_trials_of_a_controller_are_episodes_of_the_format(tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'taxelflow[sim]'")
    out = tmp_path / "set"
    words = ["--controller", "constant", "--trials", "2", "--seed", "7", "--events", "weak", "none"]
    assert main(["control", *words, "--lerobot", str(out)]) == 0
    info = json.loads((out / "meta/info.json").read_text())
    assert set(info) == INFO
    assert (info["fps"], info["total_episodes"], info["robot_type"]) == (100, 2, "two-pad-gripper")
    shapes = {name: feature["shape"] for name, feature in info["features"].items()}
    assert shapes["observation.pressure"] == [512]
    assert shapes["observation.velocity"] == [6]
    assert info["features"]["observation.state"]["names"] == ["left_m", "right_m", "force_n"]
    data = parquet.read_table(out / info["data_path"].format(chunk_index=0, file_index=0))
    assert set(data.column_names) == set(shapes)
    for name, shape in shapes.items():
        kind = data.schema.field(name).type
        assert shape == ([kind.list_size] if pa.types.is_fixed_size_list(kind) else [1])
        assert shape != [1] or not pa.types.is_fixed_size_list(kind)
    episodes = parquet.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [row["tasks"] for row in episodes] == [["hold the ball: weak"], ["hold the rod: none"]]
    assert sum(row["length"] for row in episodes) == len(data) == info["total_frames"]
    assert all(np.isfinite(action) for action in data["action"].to_pylist())
