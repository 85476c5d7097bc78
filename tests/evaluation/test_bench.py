from __future__ import annotations

import gc
import json
import subprocess
import sys
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest

from costly import mostly_long
from rigged import rigged
from taxelflow.errors import RecordingMissing
from taxelflow.evaluation.bench import Bench, _sensors, _simulated, bench, live_step
from taxelflow.evaluation.bench_effort import USUAL, Effort
from taxelflow.evaluation.bench_large import _covering
from taxelflow.evaluation.bench_throughput import batch_centroids
from taxelflow.publish.summary import to_json
from taxelflow.simulation.simulate import save, simulate

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.sensors.sensor import Sensor

SENSORS = _sensors()

WAYS = [
    "literal equations (SciPy)",
    "convolution kernel",
    "convolution step",
    "lnorm kernel",
    "lnorm step",
    "stage condition",
    "stage contacts",
    "stage estimate",
    "stage monitor",
    "stage fuse",
    "all stages",
]
STAGES = ["parsing", "conditioning", "segmenting", "estimating", "monitoring and fusing", "writing"]


QUICK = Effort(
    rounds=2,
    budget_s=0.01,
    strokes=4,
    readings=1,
    batch_bytes=200_000,
    batch_rounds=1,
    peer_rounds=2,
    peer_warm=1,
    large=((4, 6, 30),),
    large_rounds=1,
)


def hurried(patch: pytest.MonkeyPatch) -> list[list[str]]:
    """Processes are only noted, not started."""
    started: list[list[str]] = []

    def run(command: list[str], **_more: object) -> None:
        started.append(command)

    patch.setattr("taxelflow.evaluation.bench.subprocess.run", run)
    return started


@pytest.fixture(scope="module")
def started() -> list[list[str]]:
    return []


@pytest.fixture(scope="module")
def figures(started: list[list[str]]) -> Bench:
    with pytest.MonkeyPatch.context() as patch:
        commands = hurried(patch)
        patch.setattr("taxelflow.evaluation.bench._sensors", lambda: [SENSORS[1]])
        result = bench(None, effort=QUICK)
        started.extend(commands)
    return result


@pytest.mark.long
def test_a_sensor_is_measured_in_each_way(figures: Bench) -> None:
    assert [(row.sensor, row.what) for row in figures.latencies] == [("grid-16x16", what) for what in WAYS]


def test_two_hands_and_two_grids_are_measured() -> None:
    assert [sensor.name for sensor in SENSORS] == ["barretthand-162", "grid-16x16", "schunk-sdh2", "64x64"]


@pytest.mark.parametrize("sensor", mostly_long(SENSORS, *SENSORS[:3]), ids=[sensor.name for sensor in SENSORS])
def test_what_is_timed_as_all_stages_follows_every_pad(sensor: Sensor) -> None:
    values = np.random.default_rng(0).uniform(1.0, 10.0, (16, sensor.layout.taxels))
    step = live_step(sensor, values)
    outputs = [step(k) for k in range(4)]
    assert [len(output) for output in outputs] == [1, 1, 1, 1]
    last = outputs[-1]
    assert last.slips.contact.all()
    assert last.slips.valid.all()
    assert (last.slips.load > 0).all()
    assert (last.contacts.force > 0).all()


def test_times_are_positive_and_ratios_refer_to_the_literal_equations(figures: Bench) -> None:
    literal = {row.sensor: row.p50_us for row in figures.latencies if row.what == WAYS[0]}
    for row in figures.latencies:
        assert 0 < row.p50_us <= row.p99_us
        assert row.times_faster == pytest.approx(literal[row.sensor] / row.p50_us)


def test_shares_are_of_all_stages_and_add_up_to_1(figures: Bench) -> None:
    assert [share.stage for share in figures.shares] == STAGES
    assert all(share.seconds > 0 for share in figures.shares)
    assert sum(share.share for share in figures.shares) == pytest.approx(1)


def test_without_a_recording_one_about_as_long_as_the_longest_real_one_is_simulated(figures: Bench) -> None:
    assert figures.recording == "simulated.npz"
    assert figures.scans > 100
    assert simulate(_simulated(USUAL.strokes)).scans == pytest.approx(6893, rel=0.01)


def test_starts_are_compared_with_that_of_numpy(figures: Bench) -> None:
    assert [start.command for start in figures.starts] == ["import numpy", "taxelflow --help", "taxelflow sensors"]
    assert all(start.seconds > 0 for start in figures.starts)
    assert figures.starts[0].over_import_numpy == 1


@pytest.mark.long
def test_what_is_started_runs(figures: Bench, started: list[list[str]]) -> None:
    assert figures.starts
    commands = {tuple(command) for command in started}
    assert len(commands) == 3
    for command in commands:
        assert command[0] == sys.executable
        subprocess.run(command, stdout=subprocess.DEVNULL, check=True)


def test_reading_is_measured_in_each_format_beside_the_plain_library(figures: Bench) -> None:
    assert [row.format for row in figures.readings] == ["npz", "csv", "mcap", "bag", "parquet"]
    for row in figures.readings:
        assert min(row.scans_per_s, row.mb_per_s, row.library_scans_per_s) > 0
        assert row.ratio == pytest.approx(row.scans_per_s / row.library_scans_per_s)


def test_json_makes_the_round_trip(figures: Bench) -> None:
    assert msgspec.json.decode(to_json(figures), type=Bench) == figures
    assert set(json.loads(to_json(figures))) == {
        "latencies",
        "peers",
        "throughputs",
        "large",
        "recording",
        "scans",
        "shares",
        "readings",
        "starts",
    }


@pytest.mark.long
def test_a_recording_of_ones_own_is_measured_and_left_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hurried(monkeypatch)
    monkeypatch.setattr("taxelflow.evaluation.bench._sensors", list)
    save(rigged("turn"), tmp_path / "turn.npz")
    figures = bench(tmp_path / "turn.npz", effort=QUICK)
    assert (figures.recording, figures.scans) == ("turn.npz", 186)
    assert [path.name for path in tmp_path.iterdir()] == ["turn.npz"]
    assert sum(share.share for share in figures.shares) == pytest.approx(1)


def test_a_missing_recording_is_refused_in_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hurried(monkeypatch)
    monkeypatch.setattr("taxelflow.evaluation.bench._sensors", lambda: pytest.fail("measured before"))
    with pytest.raises(RecordingMissing, match=r"none\.npz does not exist"):
        bench(tmp_path / "none.npz", effort=QUICK)


def test_the_garbage_collector_runs_again_afterwards(figures: Bench) -> None:
    assert figures.latencies
    assert gc.isenabled()


def test_throughput_is_of_reading_centroids_and_the_whole_step(figures: Bench) -> None:
    assert [(row.array, row.what) for row in figures.throughputs] == [
        (array, what) for array in ("16x16", "32x32", "64x64") for what in ("reading", "centroids", "batch step")
    ]
    for row in figures.throughputs:
        assert row.gb_per_s > 0
        assert row.million_scans_per_s > 0
        assert row.what != "reading" or row.share_of_read == 1


def test_a_large_pad_is_measured_with_and_without_unseen_errors(figures: Bench) -> None:
    assert [(row.pad, row.taxels, row.scans, row.unseen_error) for row in figures.large] == [
        ("4x6", 24, 30, 0.0),
        ("4x6", 24, 30, 0.05),
    ]
    assert all(row.cpu_s > 0 for row in figures.large)


@pytest.mark.parametrize("size", USUAL.large, ids=str)
def test_a_large_pad_is_covered_in_all_scans(size: tuple[int, int, int]) -> None:
    rows, cols, scans = size
    recording = simulate(_covering(rows, cols, scans))
    readings = np.concatenate([block.values for block in recording.blocks()])
    assert readings.shape == (scans, rows * cols)
    assert np.quantile(readings[scans // 2], 0.01) > 0.1 * readings.max()
    assert recording.truth is not None
    travelled = np.ptp(recording.truth.pose[:, :2], axis=0)
    assert np.hypot(*travelled) == pytest.approx(0.01, rel=0.02)


def test_the_benchs_centroids_are_those_of_the_estimator() -> None:
    random = np.random.default_rng(0)
    pressure, x, y = random.uniform(1, 2, (5, 256)), random.normal(size=16), random.normal(size=16)
    places_x, places_y, found = np.tile(x, 16), np.repeat(y, 16), np.empty((5, 2))
    batch_centroids(pressure, places_x, places_y, 16, found)
    expected = pressure @ np.stack([places_x, places_y], axis=1) / pressure.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(found, expected, rtol=1e-12)
