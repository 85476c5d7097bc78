from __future__ import annotations

import gc
from typing import Any

import numpy as np
import pytest

from taxelflow.errors import ExtraMissing
from taxelflow.evaluation import bench_peers as timing
from taxelflow.evaluation.bench_effort import Effort
from taxelflow.evaluation.bench_peers import bench_peers, hand_in_contact

QUICK = Effort(peer_rounds=5, peer_warm=2)


def test_every_pad_of_the_hand_is_loaded_in_every_scan_by_something_that_moves() -> None:
    layout, scans = hand_in_contact(20)
    assert (layout.taxels, len(layout.pads), len(scans)) == (162, 7, 80)
    pressure = np.concatenate([scan.pressure for scan in scans])
    for pad in range(7):
        own = pressure[:, layout.of_pad(pad)]
        assert (own.max(axis=1) > 30e3).all()
        assert own.std(axis=0).max() > 5e3
    assert np.all(np.diff([scan.t_s[0] for scan in scans]) > 0)


def test_estimators_are_timed_against_phase_correlation() -> None:
    pytest.importorskip("cv2")
    found = bench_peers(("lnorm", "principal_axis"), QUICK)
    assert found.skipped is None
    assert [row.what for row in found.rows] == ["cv2.phaseCorrelate, 7 pads", "lnorm step", "principal_axis step"]
    peer = found.rows[0]
    assert (peer.p50_over_peer, peer.p99_over_peer) == (1, 1)
    for row in found.rows:
        assert 0 < row.p50_us <= row.p99_us
        assert row.p50_over_peer == pytest.approx(row.p50_us / peer.p50_us)
        assert row.p99_over_peer == pytest.approx(row.p99_us / peer.p99_us)
    assert gc.isenabled()


@pytest.mark.long
def test_each_step_has_every_scan_once_and_in_order() -> None:
    seen: dict[str, list[int]] = {"a": [], "b": []}
    steps = {name: own.append for name, own in seen.items()}
    taken = timing._in_turn(steps, {}, 2, 3)
    assert seen["a"] == seen["b"] == list(range(20))
    assert [len(times) for times in taken.values()] == [3, 3]


@pytest.mark.long
def test_rounds_in_which_something_was_learned_are_a_row_of_their_own() -> None:
    last = [0]

    def step(k: int) -> None:
        last[0] = k

    taken = timing._in_turn({"a": step}, {"a": lambda: last[0] < 12}, 2, 6)
    assert {what: len(times) for what, times in taken.items()} == {"a": 4, "a, while it learns": 4}


@pytest.mark.long
def test_a_pattern_is_learned_at_first() -> None:
    pytest.importorskip("cv2")
    found = bench_peers(("template",), QUICK)
    assert "template step, while it learns" in [row.what for row in found.rows]


def test_without_opencv_a_line_reports_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(module: str) -> Any:
        raise ExtraMissing("bench", module)

    monkeypatch.setattr(timing, "needed", absent)
    found = bench_peers((), QUICK)
    assert found.rows == []
    assert found.skipped == "cv2 is not installed; install it with: pip install 'taxelflow[bench]'"
