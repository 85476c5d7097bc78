from __future__ import annotations

import tracemalloc
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from costly import mostly_long
from synthetic import grid_sensor, recorded, times
from taxelflow.acquire.base import Recording, Truth
from taxelflow.acquire.csv import write_csv
from taxelflow.acquire.npz import write_npz
from taxelflow.acquire.parquet import write_parquet
from taxelflow.acquire.ros.write import write_mcap
from taxelflow.cli import main
from taxelflow.errors import FormatUnknown, TimesNotIncreasing
from taxelflow.messages import Joints, RawScans
from taxelflow.pipeline.api import convert, read
from taxelflow.sensors.catalogue import load_sensor

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

SENSOR = grid_sensor(2, 3)
CARRYING = (".npz", ".parquet", ".mcap")


def known(values: Any, t_s: Any = None) -> Recording:
    """A recording with everything that one can carry."""
    raw = RawScans(times(len(values)) / 3 if t_s is None else np.asarray(t_s), np.asarray(values, dtype=np.float64))
    pose = np.stack([raw.t_s * 0.01, raw.t_s * 0, np.full(len(raw), np.nan)], axis=1)
    masked = np.array([False, True, False, False, False, True])
    truth = Truth(SENSOR.layout.pads[0], raw.t_s, pose, np.arange(len(raw)) % 2 > 0, pose[:, ::-1].copy())
    return Recording("memory", "memory", SENSOR, lambda: iter([raw]), scans=len(raw), masked=masked, truth=truth)


@pytest.mark.parametrize("suffix", CARRYING)
@given(values=st.lists(st.lists(st.floats(allow_infinity=False), min_size=6, max_size=6), min_size=1, max_size=4))
def test_what_is_converted_reads_back_to_the_bit(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, values: list[list[float]]
) -> None:
    recording = known(values)
    path = tmp_path_factory.getbasetemp() / f"a{suffix}"
    convert(recording, path)
    back = read(path)
    raw, source = back.load(), recording.load()
    np.testing.assert_array_equal(raw.t_s, source.t_s)
    np.testing.assert_array_equal(raw.values, source.values)
    assert (back.sensor, back.scans, back.notes) == (SENSOR, len(values), ())
    np.testing.assert_array_equal(back.masked, recording.masked)
    truth = back.known_truth
    assert truth.pad == recording.known_truth.pad
    for name in ("t_s", "pose", "slipping", "second"):
        np.testing.assert_array_equal(getattr(truth, name), getattr(recording.known_truth, name))


@given(values=st.lists(st.lists(st.floats(allow_infinity=False), min_size=6, max_size=6), min_size=1, max_size=4))
def test_csv_keeps_every_digit_of_times_and_readings(
    tmp_path_factory: pytest.TempPathFactory, values: list[list[float]]
) -> None:
    recording = known(values)
    path = tmp_path_factory.getbasetemp() / "a.csv"
    convert(recording, path)
    raw = read(path, SENSOR).load()
    np.testing.assert_array_equal(raw.t_s, recording.load().t_s)
    np.testing.assert_array_equal(raw.values, recording.load().values)


@pytest.mark.parametrize("suffix", CARRYING)
@pytest.mark.parametrize("t_s", [[-0.3, 0.0, 0.1], [1.7e9, 1.7e9 + 0.01, 1.7e9 + 0.1]])
def test_times_before_and_long_after_the_epoch_stay(tmp_path: Path, suffix: str, t_s: list[float]) -> None:
    convert(known(np.zeros((3, 6)), t_s), tmp_path / f"a{suffix}")
    assert read(tmp_path / f"a{suffix}").load().t_s.tolist() == t_s


@pytest.mark.parametrize(
    ("suffix", "cols", "blocks"),
    mostly_long([(".npz", 16, 12), (".parquet", 16, 24), (".mcap", 16, 12), (".csv", 2, 16)], (".npz", 16, 12)),
)
def test_memory_does_not_grow_with_the_recording(tmp_path: Path, suffix: str, cols: int, blocks: int) -> None:
    sensor = grid_sensor(8, cols)
    block = np.random.default_rng(0).integers(0, 4000, (1024, 8 * cols)).astype(np.float64)

    def there_and_back(count: int) -> int:
        def scans() -> Iterator[RawScans]:
            return (RawScans(np.arange(1024.0) + 1024 * number, block) for number in range(count))

        path = tmp_path / f"a{suffix}"
        convert(Recording("memory", "memory", sensor, scans), path)
        return sum(len(scans) for scans in read(path, sensor).blocks())

    there_and_back(1)  # imports count too
    tracemalloc.start()
    try:
        assert there_and_back(blocks) == blocks * 1024
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 0.8 * blocks * block.nbytes


def test_an_unknown_suffix_is_answered_with_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(FormatUnknown, match=r"no writer for .*a\.xyz.* known are \.npz, \.csv, \.parquet, \.mcap"):
        convert(known(np.zeros((2, 6))), tmp_path / "a.xyz")


@pytest.mark.parametrize("suffix", [*CARRYING, ".csv"])
def test_a_recording_that_breaks_leaves_no_file(tmp_path: Path, suffix: str) -> None:
    broken = recorded(np.zeros((3, 6)), SENSOR, t_s=[0.0, 1.0, 0.5])
    (tmp_path / f"a{suffix}").write_text("what was there")
    with pytest.raises(TimesNotIncreasing):
        convert(broken, tmp_path / f"a{suffix}")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["what was there"]


def command(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    code = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return code, out, err


def test_the_command_converts_there_and_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    convert(known(np.arange(60.0).reshape(10, 6)), tmp_path / "a.npz")
    for one, other in (("a.npz", "b.mcap"), ("b.mcap", "c.parquet"), ("c.parquet", "d.npz")):
        code, out, err = command(capsys, "convert", tmp_path / one, tmp_path / other)
        assert (code, err) == (0, "")
        assert out == f"10 scans of grid in {tmp_path / other}\n"
    with np.load(tmp_path / "a.npz") as first, np.load(tmp_path / "d.npz") as last:
        assert set(first) == set(last)
        for name in first:
            np.testing.assert_array_equal(first[name], last[name])


def test_the_command_reports_what_a_csv_does_not_hold(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    convert(known(np.zeros((3, 6))), tmp_path / "a.npz")
    code, _, err = command(capsys, "convert", tmp_path / "a.npz", tmp_path / "a.csv")
    assert code == 0
    assert "a csv holds neither sensor, truth nor mask: give --sensor when it is read" in err
    held = known(np.zeros((3, 6)))
    joints = Joints(("a",), np.zeros(1), np.ones((1, 1)))
    convert(replace(held, masked=np.zeros(6, dtype=np.bool_), truth=None, joints=joints), tmp_path / "b.npz")
    _, _, err = command(capsys, "convert", tmp_path / "b.npz", tmp_path / "b.csv")
    assert "a csv holds neither sensor nor joint angles: give --sensor when it is read" in err


def test_what_is_left_of_a_truncated_file_is_converted_with_exit_code_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    convert(recorded(np.random.default_rng(0).normal(size=(16000, 6)), SENSOR), tmp_path / "a.mcap")
    content = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "a.mcap").write_bytes(content[: len(content) * 3 // 4])
    code, out, err = command(capsys, "convert", tmp_path / "a.mcap", tmp_path / "b.npz")
    assert code == 1
    scans = int(out.split()[0])
    assert 0 < scans < 16000
    assert f"is truncated: {scans} scans could be read" in err
    assert read(tmp_path / "b.npz").scans == scans


def test_the_command_refuses_what_it_cannot_write(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    convert(known(np.zeros((3, 6))), tmp_path / "a.npz")
    code, out, err = command(capsys, "convert", tmp_path / "a.npz", tmp_path / "a.xyz")
    assert (code, out) == (2, "")
    assert err.startswith("taxelflow: no writer for") and err.count("\n") == 1


@pytest.mark.parametrize("suffix", [*CARRYING, ".csv"])
@pytest.mark.parametrize("name", ["xela-4x4@4.7mm", "icub-fingertips-60", "barretthand-bh280-96", "schunk-sdh2"])
def test_what_a_sensor_sends_is_converted_not_what_is_made_of_it(tmp_path: Path, suffix: str, name: str) -> None:
    sensor = load_sensor(name)
    sent = np.random.default_rng(0).uniform(0, 300, (5, sensor.channel_map.columns))
    recording = Recording("memory", "memory", sensor, lambda: iter([RawScans(times(5), sent)]))
    path = tmp_path / f"a{suffix}"
    convert(recording, path)
    back = read(path, sensor if suffix == ".csv" else None)
    assert back.sensor == sensor
    np.testing.assert_array_equal(next(back.read()).values, sent)
    np.testing.assert_array_equal(back.load().values, recording.load().values)


@pytest.mark.parametrize("suffix", CARRYING)
def test_scans_may_lie_in_memory_in_any_order(tmp_path: Path, suffix: str) -> None:
    values = np.asfortranarray(np.arange(24.0).reshape(4, 6))
    recording = Recording("memory", "memory", SENSOR, lambda: iter([RawScans(times(4), values)]))
    convert(recording, tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(read(tmp_path / f"a{suffix}").load().values, values)


@pytest.mark.parametrize("suffix", CARRYING)
def test_a_real_bag_is_converted_to_the_bit(tmp_path: Path, recordings: Path, suffix: str) -> None:
    bag = read(recordings / "sdh-bags" / "no_slippage.bag")
    convert(bag, tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(read(tmp_path / f"a{suffix}").load().values, bag.load().values)


@pytest.mark.parametrize("write", [write_npz, write_csv, write_parquet, write_mcap])
def test_a_writer_writes_the_blocks_that_it_is_given(tmp_path: Path, write: Any) -> None:
    recording = known(np.arange(24.0).reshape(4, 6))
    watched: list[int] = []
    write(recording, tmp_path / "a", (watched.append(len(block)) or block for block in recording.source_blocks()))
    assert sum(watched) == 4
    assert (tmp_path / "a").stat().st_size > 100
