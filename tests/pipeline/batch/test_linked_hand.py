"""`taxelflow batch` on recordings of a hand whose fingers move: the object's motion in space, told from theirs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import pytest

from batched import alone, one_by_one, statuses
from linked import SPEED_M_S, carried
from taxelflow.cli import main

if TYPE_CHECKING:
    from pathlib import Path


def test_motion_in_space_is_separated_from_that_of_the_fingers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("taxelflow.pipeline.batch.run.connected", alone)
    monkeypatch.setattr("taxelflow.pipeline.batch.run.outcomes", one_by_one)
    rides, stays = (carried(tmp_path, name, stays=name == "stays.npz") for name in ("rides.npz", "stays.npz"))
    out = tmp_path / "out"
    assert main(["batch", str(rides), str(stays), "--out", str(out)]) == 0
    assert statuses(out) == {"rides.npz": "done", "stays.npz": "done"}
    for name, true_m_s, slips in (("rides", SPEED_M_S, False), ("stays", 0.0, True)):
        found = pd.read_parquet(out / name / "object3d.parquet")
        last = found.iloc[-20:]
        np.testing.assert_allclose(last.vx_m_s, true_m_s, atol=0.15 * SPEED_M_S)
        np.testing.assert_allclose(last.vy_m_s, 0.0, atol=0.15 * SPEED_M_S)
        assert (last["rank"] == 3).all()
        assert last.unobservable.str.contains("translation").all()
        whole = pd.read_parquet(out / name / "slips.parquet")
        moves = whole[whole.t_s >= last.t_s.iloc[0]].dx_m.abs().mean() > 0.5 * SPEED_M_S / 50
        assert moves == slips
    assert main(["estimate", str(stays), "--out", str(tmp_path / "one")]) == 0
    text = pd.read_csv(tmp_path / "one" / "object3d.csv")
    exact = pd.read_parquet(out / "stays" / "object3d.parquet")
    assert list(exact.columns) == list(text.columns)
    np.testing.assert_allclose(exact.x_m, text.x_m, rtol=1e-8, atol=1e-9)
