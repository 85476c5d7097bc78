"""Data sets of LeRobot, format v3.0: episodes as rows of one Parquet file, with their schema and statistics beside it.

Source: the description of LeRobotDataset v3.0 by Hugging Face. No videos, one file: episodes of touch are small.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.errors import ExtraMissing, ParameterInvalid, written_at

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

VERSION = "v3.0"
FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_ONLY = FILE.format(chunk_index=0, file_index=0)
_INDICES = ("frame_index", "episode_index", "index", "task_index")
_TASK_INDEX = {
    "index_columns": ["task"],
    "column_indexes": [],
    "columns": [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": dtype, "metadata": None}
        for name, kind, dtype in (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    ],
    "pandas_version": "2.2.0",
}
"""LeRobot reads the tasks with pandas, and finds a task by the index."""


@dataclass(frozen=True, eq=False)
class Episode:
    """task: what was done. columns: name to (frames, numbers), such as `observation.pressure`; all of one length.

    names: of the numbers of a column, where they have names.
    """

    task: str
    columns: Mapping[str, NDArray[Any]]
    names: Mapping[str, list[str]]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))


def check_lerobot(directory: Path, option: str = "out") -> None:
    """Refuse what `write_lerobot` would, before the episodes are made. option: the one that names the directory.

    Raises ExtraMissing, ParameterInvalid.
    """
    try:
        import_module("pyarrow")
    except ImportError as error:
        raise ExtraMissing("tables", "pyarrow") from error
    if directory.exists() and not (directory.is_dir() and not any(directory.iterdir())):
        raise ParameterInvalid(option, str(directory), "be a directory that is new or empty")


def write_lerobot(episodes: Sequence[Episode], directory: Path, rate_hz: float, robot: str) -> None:
    """Write a data set into a directory that is new or empty. robot: name of gripper or sensor.

    LeRobot counts in frames: `timestamp` is the frame over the rate. Raises ExtraMissing, ParameterInvalid, OSError.
    """
    check_lerobot(directory)
    arrow: Any = import_module("pyarrow")
    parquet: Any = import_module("pyarrow.parquet")
    rate = max(round(rate_hz), 1)
    tasks = list(dict.fromkeys(episode.task for episode in episodes))
    columns = _rows(episodes, tasks, rate)
    with written_at(directory):
        for part in ("data", "meta/episodes"):
            (directory / part / _ONLY).parent.mkdir(parents=True)
        parquet.write_table(arrow.table({n: _column(arrow, v) for n, v in columns.items()}), directory / "data" / _ONLY)
        parquet.write_table(_episodes(arrow, episodes), directory / "meta/episodes" / _ONLY)
        table = arrow.table({"task_index": arrow.array(range(len(tasks)), arrow.int64()), "task": tasks})
        table = table.replace_schema_metadata({"pandas": json.dumps(_TASK_INDEX)})
        parquet.write_table(table, directory / "meta/tasks.parquet")
        stats = {name: _stats(values) for name, values in columns.items()}
        _write_json(directory / "meta/stats.json", stats)
        _write_json(directory / "meta/info.json", _info(episodes, columns, tasks, rate, robot))


def _rows(episodes: Sequence[Episode], tasks: list[str], rate: int) -> dict[str, NDArray[Any]]:
    """All frames of all episodes, (frames, numbers) or (frames,)."""
    found: dict[str, NDArray[Any]] = {
        name: np.concatenate([episode.columns[name] for episode in episodes]) for name in episodes[0].columns
    }
    lengths = [len(episode) for episode in episodes]
    frame = np.concatenate([np.arange(length) for length in lengths])
    found["timestamp"] = (frame / rate).astype(np.float32)
    own = np.repeat(np.arange(len(episodes)), lengths)
    task = np.array([tasks.index(episode.task) for episode in episodes])[own]
    for name, values in zip(_INDICES, (frame, own, np.arange(len(frame)), task), strict=True):
        found[name] = values.astype(np.int64)
    return found


def _column(arrow: Any, values: NDArray[Any]) -> Any:
    """A column of numbers, or of lists of one length; LeRobot's reader takes a list of one number for a number."""
    if values.ndim == 1 or values.shape[1] == 1:
        return arrow.array(values.ravel())
    return arrow.FixedSizeListArray.from_arrays(arrow.array(values.ravel()), values.shape[1])


def _episodes(arrow: Any, episodes: Sequence[Episode]) -> Any:
    """One row per episode: where its frames are, and its statistics."""
    ends = np.cumsum([len(episode) for episode in episodes]).tolist()
    rows: list[dict[str, Any]] = []
    for number, (episode, end) in enumerate(zip(episodes, ends, strict=True)):
        places = {"data/chunk_index": 0, "data/file_index": 0, "meta/episodes/chunk_index": 0}
        row = {"episode_index": number, "tasks": [episode.task], "length": len(episode), **places}
        row |= {"meta/episodes/file_index": 0, "dataset_from_index": end - len(episode), "dataset_to_index": end}
        for name, values in episode.columns.items():
            row |= {f"stats/{name}/{key}": value for key, value in _stats(values).items()}
        rows.append(row)
    return arrow.Table.from_pylist(rows)


def _stats(values: NDArray[Any]) -> dict[str, list[Any]]:
    """Minimum, maximum, mean and standard deviation per number, over the frames where it is known; and their count."""
    known = np.ma.masked_invalid(values.reshape(len(values), -1).astype(np.float64))
    parts = {"min": known.min(axis=0), "max": known.max(axis=0), "mean": known.mean(axis=0), "std": known.std(axis=0)}
    return {**{name: np.ma.filled(part, 0.0).tolist() for name, part in parts.items()}, "count": [len(values)]}


def _info(
    episodes: Sequence[Episode], columns: Mapping[str, NDArray[Any]], tasks: list[str], rate: int, robot: str
) -> dict[str, Any]:
    """What info.json holds."""
    features = {}
    for name, values in columns.items():
        shape = list(values.shape[1:]) or [1]
        features[name] = {"dtype": str(values.dtype), "shape": shape, "names": episodes[0].names.get(name)}
    return {
        "codebase_version": VERSION,
        "robot_type": robot,
        "total_episodes": len(episodes),
        "total_frames": sum(map(len, episodes)),
        "total_tasks": len(tasks),
        "chunks_size": 1000,  # limits that the format declares; nothing here reaches them
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 100,
        "fps": rate,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": f"data/{FILE}",
        "video_path": None,
        "features": features,
    }


def _write_json(path: Path, content: dict[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
