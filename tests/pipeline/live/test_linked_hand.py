"""A live run of a hand whose fingers move: JSON lines with the object's motion in space."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from linked import SPEED_M_S, carried
from streaming import published
from taxelflow.cli import main

if TYPE_CHECKING:
    from pathlib import Path


def test_json_lines_of_a_linked_hand_hold_the_motion_in_space(tmp_path: Path) -> None:
    path = carried(tmp_path, "stays.npz", stays=True)
    lines = tmp_path / "a.jsonl"
    assert main(["run", f"replay:{path}?speed=max", "--to", f"jsonl:{lines}", "--quiet"]) == 0
    rows = published(lines)
    told = [row["object3d"] for row in rows]
    last = told[-20:]
    for axis in ("vx_m_s", "vy_m_s"):
        np.testing.assert_allclose([row[axis] for row in last], 0.0, atol=0.15 * SPEED_M_S)
    assert {row["rank"] for row in last} == {3}
    assert all("translation" in row["unobservable"] for row in last)
    assert told[0]["vx_m_s"] is None  # nothing touches yet
    np.testing.assert_allclose([row["x_m"] for row in last], 0.0, atol=5e-4)
