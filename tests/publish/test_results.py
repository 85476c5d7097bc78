from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING

import numpy as np
import pytest

from rigged import strokes_by_both, track
from taxelflow.errors import ResultMissing
from taxelflow.pipeline.api import estimate, read
from taxelflow.publish.results import read_result

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return strokes_by_both(tmp_path_factory.mktemp("stroke"))


@pytest.fixture
def spoilt(results: list[Path], tmp_path: Path) -> Callable[[str, bytes], Path]:
    """A copy of a result in which one file holds something else."""

    def spoil(name: str, content: bytes) -> Path:
        shutil.copytree(results[0], tmp_path / "result")
        (tmp_path / "result" / name).write_bytes(content)
        return tmp_path / "result"

    return spoil


@pytest.mark.long
def test_numbers_come_back_as_they_were_estimated(results: list[Path]) -> None:
    for directory, method in zip(results, ("lnorm", "convolution"), strict=True):
        summary, tracks = read_result(directory)
        want = estimate(read(summary.input), method)
        assert (summary.method, summary.sensor) == (method, "barretthand-162")
        assert [track.pad for track in tracks] == list(want.pads)
        for number, found in enumerate(tracks):
            assert found.method == method
            for name, array in {
                "x_m": want.slips.pose[:, number, 0],
                "y_m": want.slips.pose[:, number, 1],
                "dx_m": want.slips.displacement[:, number, 0],
                "vy_m_s": want.slips.velocity[:, number, 1],
                "std_x_m": np.sqrt(want.slips.covariance[:, number, 0, 0]),
                "lag_s": want.slips.lag_s[:, number],
            }.items():
                np.testing.assert_allclose(found.numbers[name], array, rtol=1e-8, err_msg=name)
            np.testing.assert_allclose(found.numbers["t_s"], want.slips.t_s, atol=1e-6)
            np.testing.assert_array_equal(found.flags["contact"], want.slips.contact[:, number])
            np.testing.assert_array_equal(found.flags["slipping"], want.slipping[:, number])


def test_a_track_knows_when_its_positions_were_true(results: list[Path]) -> None:
    lags = []
    for directory in results:
        palm = read_result(directory)[1][-1]
        assert palm.position_m.shape == (140, 2)
        known = np.isfinite(palm.position_m[:, 0])
        lags.append(float(np.median((palm.numbers["t_s"] - palm.t_s)[known])))
        assert np.isfinite(palm.t_s).all()  # where the lag is unknown, too
    assert lags == pytest.approx([0, 1 / 14], abs=1e-5)


def test_times_without_a_lag_are_the_scans() -> None:
    late = track(np.zeros(3), np.zeros(3), lag_s=0.05)
    np.testing.assert_allclose(late.t_s, [-0.05, 0.05, 0.15])
    late.numbers["lag_s"][1] = np.nan
    np.testing.assert_allclose(late.t_s, [-0.05, 0.1, 0.15])


@pytest.mark.parametrize("name", ["summary.json", "slips.csv"])
def test_a_missing_file_is_named(results: list[Path], tmp_path: Path, name: str) -> None:
    shutil.copytree(results[0], tmp_path / "result")
    (tmp_path / "result" / name).unlink()
    with pytest.raises(ResultMissing, match=rf"result holds no {name}; give a directory that `taxelflow estimate"):
        read_result(tmp_path / "result")


def test_an_interrupted_run_is_no_result(results: list[Path], tmp_path: Path) -> None:
    shutil.copytree(results[0], tmp_path / "result")
    for name in ("summary.json", "slips.csv"):
        (tmp_path / "result" / name).rename(tmp_path / "result" / f"{name}.part")
    with pytest.raises(ResultMissing):
        read_result(tmp_path / "result")


@pytest.mark.parametrize("name", ["none", "file"])
def test_what_is_no_directory_is_no_result(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ResultMissing, match=f"{name} holds no summary.json"):
        read_result(tmp_path / name)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"{}", b"\xff\xfe", b'{"taxelflow": 1}'], ids=repr)
def test_an_invalid_summary_is_refused(spoilt: Callable[[str, bytes], Path], content: bytes) -> None:
    with pytest.raises(ResultMissing, match=r"readable summary\.json \(.+\)") as caught:
        read_result(spoilt("summary.json", content))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"garbage\n",
        b"t_s,pad,contact\n0.1,palm,1\n",
        b"\xff\xfe\x00,\x01\n" * 9,
    ],
    ids=["empty", "garbage", "columns", "binary"],
)
def test_invalid_rows_are_refused(spoilt: Callable[[str, bytes], Path], content: bytes) -> None:
    with pytest.raises(ResultMissing, match=r"slips\.csv"):
        read_result(spoilt("slips.csv", content))


def test_an_invalid_number_is_refused(results: list[Path], spoilt: Callable[[str, bytes], Path]) -> None:
    content = (results[0] / "slips.csv").read_bytes()
    with pytest.raises(ResultMissing, match=r"slips\.csv"):
        read_result(spoilt("slips.csv", content.replace(b"palm,1,", b"palm,yes,")))


def test_columns_of_a_later_version_do_no_harm(results: list[Path], spoilt: Callable[[str, bytes], Path]) -> None:
    lines = (results[0] / "slips.csv").read_text().splitlines()
    wider = "\n".join([lines[0] + ",more", *(line + ",7" for line in lines[1:])]) + "\n"
    before, after = read_result(results[0])[1], read_result(spoilt("slips.csv", wider.encode()))[1]
    for one, other in zip(before, after, strict=True):
        np.testing.assert_array_equal(one.position_m, other.position_m)


def test_the_layout_comes_with_the_result(results: list[Path]) -> None:
    summary, _ = read_result(results[0])
    assert summary.layout.layout.taxels == 162
    assert json.loads((results[0] / "summary.json").read_text())["layout"]["name"] == "barretthand-162"
