"""How fast recordings are read, format by format, beside the plain library that parses them."""

from __future__ import annotations

from importlib.util import find_spec
from time import perf_counter
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from taxelflow.pipeline import api

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from taxelflow.acquire.base import Recording
    from taxelflow.evaluation.bench_effort import Effort


class ReadingRate(msgspec.Struct, frozen=True):
    """One format, all of a recording, fastest of some rounds. MB are those of the file."""

    format: str
    megabytes: float
    scans_per_s: float
    mb_per_s: float
    library: str
    """What the plain library does: it parses the same file and keeps what it finds as it finds it."""
    library_scans_per_s: float
    ratio: float
    """Our rate over the library's."""


def reading_rates(recording: Recording, folder: Path, effort: Effort) -> list[ReadingRate]:
    """The recording written in each format into a folder, and read back in turn with the plain library."""
    plain: dict[str, tuple[str, Callable[[Path], object]]] = {
        ".npz": ("numpy.load", _npz),
        ".csv": ("numpy.loadtxt", lambda path: np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)),
        ".mcap": ("mcap, not decoded", _mcap),
        ".bag": ("rosbags", _bag),
    }
    if find_spec("pyarrow"):
        plain[".parquet"] = ("pyarrow", _parquet)
    return [_rate(recording, folder / f"reading{suffix}", *way, effort) for suffix, way in plain.items()]


def _rate(
    recording: Recording, path: Path, library: str, parse: Callable[[Path], object], effort: Effort
) -> ReadingRate:
    if path.suffix == ".bag":
        _write_bag(recording, path)
    else:
        api.convert(recording, path)
    opened = api.read(path, recording.sensor)
    ours, theirs, scans = float("inf"), float("inf"), 0
    for _ in range(effort.readings):
        start = perf_counter()
        scans = sum(map(len, opened.blocks()))
        middle = perf_counter()
        parse(path)
        ours, theirs = min(ours, middle - start), min(theirs, perf_counter() - middle)
    megabytes = path.stat().st_size / 1e6
    name = path.suffix.lstrip(".")
    return ReadingRate(name, megabytes, scans / ours, megabytes / ours, library, scans / theirs, theirs / ours)


def _npz(path: Path) -> object:
    with np.load(path) as archive:
        return archive["t"], archive["pressure"]


def _mcap(path: Path) -> object:
    from mcap.reader import make_reader

    with path.open("rb") as file:
        return [message.data for _, _, message in make_reader(file).iter_messages(log_time_order=False)]


def _parquet(path: Path) -> object:
    from pyarrow import parquet

    return [column.to_numpy() for column in parquet.read_table(path).columns]


def _bag(path: Path) -> object:
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        messages = reader.messages(connections=reader.connections)
        return [_data(reader.deserialize(content, link.msgtype)) for link, _, content in messages]


def _data(message: Any) -> object:
    return message.data


def _write_bag(recording: Recording, path: Path) -> None:
    """A ROS 1 bag of `std_msgs/Float64MultiArray`, as people log."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "std_msgs/msg/Float64MultiArray"
    layout = store.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    with Writer(path) as writer:
        link = writer.add_connection("/touch", kind, typestore=store)
        for block in recording.source_blocks():
            for t_s, values in zip(block.t_s.tolist(), block.values, strict=True):
                message = store.types[kind](layout=layout, data=values)
                writer.write(link, max(0, round(t_s * 1e9)), store.serialize_ros1(message, kind))
