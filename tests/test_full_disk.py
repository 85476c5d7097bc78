from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rigged import estimated, refused
from synthetic import dome, grid_sensor

FULL = Path("/dev/full")
needs_full = pytest.mark.skipif(not FULL.exists(), reason="there is no /dev/full here")
SENSOR = "grid:4x7@10mm"


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    palm = grid_sensor(4, 7)
    values = [np.zeros(28)] * 30 + [dome(palm, 0.0005 * k - 0.01) for k in range(40)]
    path = tmp_path / "a.npz"
    np.savez(path, t=np.arange(70) / 30, pressure=np.array(values) + np.random.default_rng(0).normal(0, 100, (70, 28)))
    return path


@needs_full
@pytest.mark.parametrize("table", ["slips.csv.part", "summary.json.part"])
def test_results_on_a_full_disk_name_the_place(
    tmp_path: Path, recording: Path, table: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / table).symlink_to(FULL)
    said = refused(capsys, "estimate", recording, "--sensor", SENSOR, "--out", out)
    assert "No space left on device" in said
    assert "make room there" in said
    assert str(out) in said


@needs_full
@pytest.mark.parametrize("suffix", [".npz", ".csv", ".mcap", ".parquet"])
def test_a_conversion_on_a_full_disk_names_the_place(
    tmp_path: Path, recording: Path, suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / f"b{suffix}"
    out.with_name(f"{out.name}.part").symlink_to(FULL)
    said = refused(capsys, "convert", recording, out, "--sensor", SENSOR)
    assert "No space left on device" in said
    assert str(out) in said


def test_a_file_that_cannot_be_made_is_named_without_part(
    tmp_path: Path, recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(capsys, "convert", recording, "/proc/b.csv", "--sensor", SENSOR)
    assert said.endswith("No such file or directory: /proc/b.csv; check the path and permissions\n")
    made = estimated(recording, tmp_path / "out", "--sensor", SENSOR)
    said = refused(capsys, "film", made, "/proc/b.gif")
    assert said.endswith("No such file or directory: /proc/b.gif; check the path and permissions\n")
    (tmp_path / "b.csv").mkdir()
    said = refused(capsys, "convert", recording, tmp_path / "b.csv", "--sensor", SENSOR)
    assert said.endswith(f"Is a directory: {tmp_path}/b.csv; check the path and permissions\n")


@needs_full
def test_a_full_disk_under_standard_output_is_one_line() -> None:
    with FULL.open("w") as full:
        ran = subprocess.run(
            [sys.executable, "-m", "taxelflow.cli", "sensors"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert ran.returncode == 2
    assert ran.stderr.count("\n") == 1
    assert "No space left on device: standard output" in ran.stderr


def test_a_file_in_the_way_of_results_is_named(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, "estimate", recording, "--sensor", SENSOR, "--out", recording, "--method", "lnorm")
    assert said == f"taxelflow: File exists: {recording}; a file is in the way of a directory: give another one\n"
