from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from synthetic import conditioned, dome, grid_sensor, recorded
from taxelflow.evaluation.checkup import check_up

if TYPE_CHECKING:
    from taxelflow.condition.health import Finding
    from taxelflow.messages import Floats

MAT = grid_sensor(10, 12, full_scale=140e3)
PLACE = {"row": MAT.layout.row, "col": MAT.layout.col}
lines = pytest.mark.parametrize("line", ["row", "col"])


def sliding(line: str, *, left: float = 1.0, gap_m: float = 0.0) -> Floats:
    """Idle, then two halves, `gap_m` apart across the line, that slide to and fro; line 5 reads `left` of its load."""
    way = 0.014 * np.stack([np.sin(np.arange(400) / 25), np.cos(np.arange(400) / 40)], axis=1)
    apart = 0.5 * gap_m * np.array([line == "col", line == "row"])
    values = np.sum([[dome(MAT, *(place + side * apart), radius_m=0.014) for place in way] for side in (1, -1)], axis=0)
    values[:60] = 0.0
    values[:, PLACE[line] == 5] *= left
    noisy: Floats = values + np.random.default_rng(3).normal(0.0, 100.0, values.shape)
    return noisy


def found_in(values: Floats) -> tuple[Finding, ...]:
    _, session = conditioned(values, MAT, mode="batch")
    assert session.baseline is not None
    return session.baseline.findings


@lines
@pytest.mark.parametrize("left", [0.0, 0.1])
def test_a_dead_line_is_found_taxel_by_taxel(line: str, left: float) -> None:
    findings = found_in(sliding(line, left=left))
    assert [(found.taxel, found.fault) for found in findings] == [(k, "line") for k in np.flatnonzero(PLACE[line] == 5)]
    assert left - 0.01 < findings[0].value < left + 0.1  # neighbours lie further from the middle


@lines
def test_a_gap_that_moves_with_the_object_is_no_dead_line(line: str) -> None:
    assert not found_in(sliding(line, gap_m=0.05))


def test_the_checkup_names_the_line() -> None:
    pad = check_up(recorded(sliding("row", left=0.1), MAT)).pads[0]
    assert len(pad.faults) == 12
    assert "row 5, col 0) on a line that reads 0.19 times those beside it" in pad.faults[0]
