"""What damaged files of every format make of the readers: an error of one line, or what can be read."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bagged import write_bag
from synthetic import DsaMatrix, grid_sensor, recorded, times, write_dsa
from taxelflow.errors import RecordingCorrupt, RecordingError, RecordingTooLarge, TaxelflowError, TopicUnclear
from taxelflow.pipeline.api import convert, read
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from taxelflow.acquire.base import Recording

SENSOR = grid_sensor(2, 3)
LARGE = grid_sensor(6, 10)
VALUES = np.arange(24.0).reshape(4, 6)


def converted(suffix: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / f"whole{suffix}"
        convert(recorded(VALUES, SENSOR), path)
        return path

    return write


def bag(storage: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / ("whole.bag" if storage == "ros1" else "bag")
        write_bag(path, {"/t": ("tactile_msgs/msg/TactileState", [[row] for row in VALUES])}, storage=storage)
        return path if storage == "ros1" else next(path.glob("bag*"))

    return write


def dsa(folder: Path) -> Path:
    return write_dsa(folder / "whole.dsa", VALUES, [DsaMatrix(2, 3)])


WHOLE = {
    "npz": converted(".npz"),
    "csv": converted(".csv"),
    "parquet": converted(".parquet"),
    "mcap": converted(".mcap"),
    "ros1 bag": bag("ros1"),
    "sqlite3": bag("sqlite3"),
    "ros2 mcap": bag("mcap"),
    "dsa": dsa,
}
STRIDES = {"mcap": 11, "sqlite3": 1021, "parquet": 31, "npz": 17, "ros1 bag": 23, "ros2 mcap": 37, "dsa": 3}
"""Every byte where a file is small; the others by steps that hit every kind of place."""


def attempt(path: Path) -> int:
    """Scans that are read; a foreseen error of one line gives none. Anything else fails the test."""
    try:
        reading = read(path, SENSOR).blocks()
        return sum(len(block) for block in reading) if reading else 0
    except TaxelflowError as error:
        assert "\n" not in str(error)
        return 0


@pytest.mark.parametrize("kind", WHOLE)
def test_a_file_cut_anywhere_gives_what_is_there_or_an_error_of_one_line(tmp_path: Path, kind: str) -> None:
    whole = WHOLE[kind](tmp_path)
    content = whole.read_bytes()
    assert attempt(whole) == len(VALUES)
    cut = tmp_path / f"cut{whole.suffix}"
    for length in range(0, len(content), STRIDES.get(kind, 1)):
        cut.write_bytes(content[:length])
        assert 0 <= attempt(cut) <= len(VALUES)


@pytest.mark.parametrize("kind", WHOLE)
def test_bytes_turned_over_never_give_a_traceback(tmp_path: Path, kind: str) -> None:
    whole = WHOLE[kind](tmp_path)
    content = whole.read_bytes()
    broken = tmp_path / f"broken{whole.suffix}"
    random = np.random.default_rng(1)
    for _ in range(90):
        spoiled = bytearray(content)
        for place in random.integers(0, len(content), 3):
            spoiled[place] ^= int(random.integers(1, 256))
        broken.write_bytes(spoiled)
        attempt(broken)


@pytest.mark.parametrize("suffix", [".npz", ".csv", ".txt", ".parquet", ".mcap", ".bag", ".db3", ".dsa"])
def test_an_empty_file_is_an_error_of_one_line(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"empty{suffix}"
    path.touch()
    with pytest.raises(RecordingError) as caught:
        read(path, SENSOR).load()
    assert "\n" not in str(caught.value)


@given(content=st.binary(max_size=200))
@pytest.mark.parametrize("suffix", [".mcap", ".bag", ".parquet", ".db3"])
def test_a_file_that_is_none_is_an_error_of_one_line(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, content: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / f"none{suffix}"
    magic = {".mcap": b"\x89MCAP0\r\n", ".bag": b"#ROSBAG V2.0\n", ".parquet": b"PAR1", ".db3": b"SQLite format 3\0"}
    for start in (b"", magic[suffix]):
        path.write_bytes(start + content)
        assert attempt(path) == 0


def long_mcap(folder: Path) -> tuple[Path, Recording]:
    values = np.random.default_rng(0).normal(size=(8000, 60))
    recording = recorded(values, LARGE)
    path = folder / "long.mcap"
    convert(recording, path)
    return path, recording


@pytest.mark.parametrize("share", [0.1, 0.5, 0.8])
def test_an_mcap_that_ends_before_its_first_scan_is_refused_as_cut(share: float, tmp_path: Path) -> None:
    path = converted(".mcap")(tmp_path)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * content.index(b"zstd"))])  # within the first chunk, or before it
    with pytest.raises(RecordingCorrupt, match=r"whole.mcap: it ends before its first scan \(.*\); record it again$"):
        read(path)


def test_of_a_truncated_mcap_what_is_there_is_read(tmp_path: Path) -> None:
    path, recording = long_mcap(tmp_path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 2 // 3])
    opened = read(path)
    assert (opened.sensor, opened.scans) == (LARGE, None)
    reading = opened.blocks()
    there = sum(len(block) for block in reading)
    assert 2000 < there < 8000
    assert f"is truncated: {there} scans could be read" in str(reading.loss)
    np.testing.assert_array_equal(read(path).load().values, recording.load().values[:there])


def test_a_spoiled_chunk_ends_an_mcap_with_what_came_before(tmp_path: Path) -> None:
    path, _ = long_mcap(tmp_path)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    reading = read(path).blocks()
    there = sum(len(block) for block in reading)
    assert 2000 < there < 8000
    assert f"{there} of 8000 scans" in str(reading.loss)


def test_a_chunk_that_declares_more_than_can_be_is_not_unpacked(tmp_path: Path) -> None:
    import zstandard

    path = converted(".mcap")(tmp_path)
    content = path.read_bytes()
    header = 8 + 9 + struct.unpack("<Q", content[9:17])[0]  # magic, then the first record
    packed = zstandard.compress(bytes(1000))
    chunk = struct.pack("<QQQI", 0, 0, 1 << 40, 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(packed))
    path.write_bytes(content[:header] + b"\x06" + struct.pack("<Q", len(chunk + packed)) + chunk + packed)
    with pytest.raises(RecordingTooLarge, match=f"a chunk of {len(packed)} bytes declares 1099511627776"):
        read(path, SENSOR)


def test_a_bag_without_an_index_names_the_command_to_run(tmp_path: Path) -> None:
    path = bag("ros1")(tmp_path)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(RecordingCorrupt, match=r"index is missing or damaged .*run `rosbag reindex whole.bag`"):
        read(path, SENSOR)


def test_a_recorder_that_was_killed_leaves_a_bag_without_an_index(tmp_path: Path) -> None:
    path = bag("ros1")(tmp_path)
    content = bytearray(path.read_bytes())
    place = content.index(b"index_pos=") + len(b"index_pos=")
    content[place : place + 8] = bytes(8)
    path.write_bytes(content)
    with pytest.raises(RecordingCorrupt, match=r"not indexed.*rosbag reindex"):
        read(path, SENSOR)


def test_a_bag_that_is_none_is_not_sent_to_reindexing(tmp_path: Path) -> None:
    path = tmp_path / "a.bag"
    path.write_bytes(b"t_s,a,b\n0,1,2\n")
    with pytest.raises(RecordingCorrupt, match="give a ROS 1 bag"):
        read(path, SENSOR)


def test_a_directory_without_metadata_is_no_bag(tmp_path: Path) -> None:
    path = bag("mcap")(tmp_path)
    (path.parent / "metadata.yaml").unlink()
    with pytest.raises(RecordingError, match=r"not a ROS 2 bag \(it has no metadata.yaml\)"):
        read(path.parent, SENSOR)
    assert attempt(path) == len(VALUES)


def test_of_a_bag_directory_with_a_cut_file_the_file_is_to_be_read_alone(tmp_path: Path) -> None:
    path = bag("mcap")(tmp_path)
    path.write_bytes(path.read_bytes()[:-50])
    with pytest.raises(RecordingCorrupt, match=r"read one of its \.mcap or \.db3 files alone"):
        read(path.parent, SENSOR)
    assert attempt(path) == len(VALUES)


def test_a_topics_name_cannot_break_the_line(tmp_path: Path) -> None:
    path = tmp_path / "a.bag"
    write_bag(path, {"/a\nb": ("std_msgs/msg/String", [["x"]])})
    with pytest.raises(TopicUnclear, match=r"/a b \(std_msgs/msg/String\)"):
        read(path, SENSOR)


def test_a_bag_whose_storage_is_gone_is_an_error_of_one_line(tmp_path: Path) -> None:
    path = bag("mcap")(tmp_path)
    path.unlink()
    with pytest.raises(RecordingCorrupt, match="missing"):
        read(path.parent, SENSOR)


@pytest.mark.parametrize(("factor", "odd"), [(1.0, False), (1e3, True), (1e-6, True)])
def test_times_in_a_wrong_unit_are_noted(tmp_path: Path, factor: float, odd: bool) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t_s,a\n" + "".join(f"{t * factor!r},1\n" for t in times(50, 100.0).tolist()))
    reading = read(path, Sensor("one", "count", (Pad("pad", 1, 1, (0.004, 0.004)),))).blocks()
    assert sum(len(block) for block in reading) == 50
    assert [("implausible for a tactile sensor" in note) for note in reading.notes] == [True] * odd
