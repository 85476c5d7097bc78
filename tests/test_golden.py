"""What `make golden` calls a difference: a bit on the machine of the archive, more than rounding on any other."""

from __future__ import annotations

import numpy as np
import pytest

from golden.__main__ import main
from golden.archive import compare, machine
from golden.runs import Run

ELSEWHERE = {**machine(), "cpu": "another"}


def run(shift_m: float = 0.0, unknown: int = 0) -> Run:
    """20 scans of a pad whose pose is known to 1 mm, moved by so much, and unknown in the first scans."""
    pose = 0.01 * np.arange(60.0).reshape(20, 1, 3) + shift_m
    pose[:unknown] = np.nan
    covariance = np.broadcast_to(1e-6 * np.eye(3), (20, 1, 3, 3)).copy()
    return {
        "kept:slips.pose": pose,
        "kept:slips.covariance": covariance,
        "kept:slips.quality": np.ones((20, 1), np.uint8),
    }


@pytest.mark.parametrize(
    ("method", "changed", "here", "elsewhere"),
    [
        ("convolution", run(), 0, 0),
        ("convolution", run(1e-12), 1, 0),
        ("convolution", run(1e-8), 1, 1),
        ("template", run(1e-5), 1, 0),
        ("template", run(1e-3), 1, 1),
        ("template", run(unknown=1), 1, 0),
        ("template", run(unknown=5), 1, 1),
    ],
)
def test_a_run_is_compared_to_the_bit_here_and_to_a_stated_tolerance_elsewhere(
    method: str, changed: Run, here: int, elsewhere: int, capsys: pytest.CaptureFixture[str]
) -> None:
    name = f"bar-on-grid/{method}/batch"
    assert compare((machine(), {name: run()}), {name: changed}) == here
    assert ("slips.pose" in capsys.readouterr().out) == bool(here)
    assert compare((ELSEWHERE, {name: run()}), {name: changed}) == elsewhere
    shown = capsys.readouterr().out
    assert "another machine than the archive's" in shown
    assert ("slips.pose" in shown) == bool(elsewhere)


def test_a_run_that_the_archive_lacks_is_a_difference(capsys: pytest.CaptureFixture[str]) -> None:
    assert compare((machine(), {}), {"stroke/lnorm/batch": run()}) == 1
    assert "not in the archive" in capsys.readouterr().out


def test_a_part_of_the_archive_is_not_written(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["update", "--only", "stroke"])
    assert "--only stroke is for compare" in capsys.readouterr().err
