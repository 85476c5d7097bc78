from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import taxelflow
from batched import slides
from taxelflow.errors import ExtraMissing
from taxelflow.pipeline.batch.task import Settings, estimate_one, finished
from taxelflow.pipeline.stages import Pipeline

FILES = ["events.parquet", "object.parquet", "slips.parquet", "summary.json"]


@dataclass(frozen=True)
class Broken:
    """An estimator that fails."""

    error: Exception

    def start(self, _layout: object, _mode: str) -> Any:
        raise self.error


def settings(estimator: Any = None, **changes: Any) -> Settings:
    pipeline = Pipeline(estimator or taxelflow.estimator("convolution"))
    return replace(Settings("convolution", pipeline, None, None, None, None, None), **changes)


@pytest.fixture
def slide(tmp_path: Path) -> Path:
    return slides(tmp_path, "a.npz")[0]


def files(out: Path) -> list[str]:
    return sorted(path.name for path in out.iterdir())


def test_a_recording_becomes_parquet_files_with_what_estimate_writes(slide: Path, tmp_path: Path) -> None:
    out = tmp_path / "out" / "a"
    outcome = estimate_one(settings(), str(slide), str(out))
    assert (outcome.status, outcome.message, outcome.recorded_s) == ("done", "", 5.9)
    assert files(out) == FILES
    assert files(out.parent) == [".parts", "a"]
    assert files(out.parent / ".parts") == []
    result = taxelflow.estimate(slide)
    saved = result.save(tmp_path / "saved")
    assert (out / "summary.json").read_bytes() == (saved / "summary.json").read_bytes()
    slips = pd.read_parquet(out / "slips.parquet")
    pd.testing.assert_frame_equal(slips, result.to_dataframe())
    for name in ("object", "events"):
        exact, text = pd.read_parquet(out / f"{name}.parquet"), pd.read_csv(saved / f"{name}.csv")
        assert list(exact.columns) == list(text.columns)
        numbers = [name for name in text if name not in {"pad", "event", "quality"}]
        np.testing.assert_allclose(exact[numbers], text[numbers], rtol=1e-8, atol=1e-6)
    assert len(slips)
    assert slips.x_m.isna().any()


def test_a_name_as_long_as_file_systems_allow_is_estimated(slide: Path, tmp_path: Path) -> None:
    out = tmp_path / "out" / ("n" * 250)
    assert estimate_one(settings(), str(slide), str(out)).status == "done"
    assert files(out) == FILES


def test_a_finished_recording_is_not_estimated_again(slide: Path, tmp_path: Path) -> None:
    out = tmp_path / "out" / "a"
    estimate_one(settings(), str(slide), str(out))
    before = {name: (out / name).stat().st_mtime_ns for name in FILES}
    outcome = estimate_one(settings(Broken(ValueError("never called"))), str(slide), str(out))
    assert (outcome.status, outcome.seconds) == ("done", None)
    assert {name: (out / name).stat().st_mtime_ns for name in FILES} == before


def test_results_without_a_summary_are_not_finished(slide: Path, tmp_path: Path) -> None:
    out = tmp_path / "out" / "a"
    estimate_one(settings(), str(slide), str(out))
    whole = {name: (out / name).read_bytes() for name in FILES}
    (out / "summary.json").unlink()
    (out / "slips.parquet").write_bytes(b"torn")
    assert estimate_one(settings(), str(slide), str(out)).seconds is not None
    assert {name: (out / name).read_bytes() for name in FILES} == whole


@pytest.mark.parametrize("name", FILES)
def test_results_that_lack_a_file_are_not_finished(slide: Path, tmp_path: Path, name: str) -> None:
    out = tmp_path / "out" / "a"
    estimate_one(settings(), str(slide), str(out))
    (out / name).unlink()
    assert finished(out) is None
    assert estimate_one(settings(), str(slide), str(out)).seconds is not None
    assert files(out) == FILES


@pytest.mark.parametrize(
    ("error", "status", "says"),
    [
        (ValueError("odd"), "failed", "ValueError: odd"),
        (ExtraMissing("h5", "h5py"), "fault", "h5py is not installed"),
        (OSError(28, "No space left on device"), "fault", "No space left"),
        (MemoryError("12 GB"), "fault", "MemoryError: 12 GB"),
        (ImportError("no module my_touch"), "fault", "my_touch"),
    ],
    ids=lambda one: type(one).__name__ if isinstance(one, Exception) else None,
)
def test_an_error_is_a_value(slide: Path, tmp_path: Path, error: Exception, status: str, says: str) -> None:
    out = tmp_path / "out" / "a"
    outcome = estimate_one(settings(Broken(error)), str(slide), str(out))
    assert outcome.status == status
    assert says in outcome.message
    assert not out.exists()
    assert files(out.parent / ".parts") == []


def test_what_is_wrong_with_a_recording_is_its_failure(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(b"PK")
    outcome = estimate_one(settings(), str(tmp_path / "a.npz"), str(tmp_path / "out" / "a"))
    assert outcome.status == "failed"
    assert outcome.message.startswith("cannot read ")


def test_what_is_wrong_with_a_worker_is_a_fault(slide: Path, tmp_path: Path) -> None:
    out = str(tmp_path / "out" / "a")
    unseen = estimate_one(settings(), str(tmp_path / "elsewhere.npz"), out)
    assert (unseen.status, unseen.message) == ("fault", f"a worker does not see {tmp_path / 'elsewhere.npz'}")
    other = estimate_one(settings(taxelflow="0.0.9"), str(slide), out)
    assert (other.status, other.message) == (
        "fault",
        f"a worker has taxelflow {taxelflow.__version__}, not 0.0.9",
    )


def test_a_truncated_recording_is_done_and_reports_the_loss(slide: Path, tmp_path: Path) -> None:
    path = tmp_path / "torn.csv"
    whole = taxelflow.read(slide)
    taxelflow.convert(whole, path)
    path.write_text(path.read_text()[:-20])
    for _ in range(2):
        outcome = estimate_one(settings(sensor=whole.sensor), str(path), str(tmp_path / "out" / "torn"))
        assert outcome.status == "done"
        assert "is truncated: 59 scans could be read" in outcome.message
