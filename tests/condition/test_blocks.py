"""The block form of the conditioner against its kernels: the same scans, to the bit."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from logged import logged, noisy_grasp
from taxelflow.condition import blocks
from taxelflow.condition.blocks import Blockwise, condition_block, deduplicate_block
from taxelflow.condition.contact import Conditioned, PadContact, Zeroed, condition
from taxelflow.condition.deduplicate import Deduplicator
from taxelflow.messages import Floats
from taxelflow.numerics.records import records

RECORDINGS = {
    "noisy": (np.arange(300) / 30, noisy_grasp(clipped=False)),
    "clipped": (np.arange(300) / 30, noisy_grasp()),
    "repeated": logged(noisy_grasp(), 3),
    "repeated smoothly": logged(np.cumsum(noisy_grasp(200, clipped=False), axis=0), 2),
}


def faulty(t_s: Floats, values: Floats) -> tuple[Floats, Floats]:
    """With two gaps in time, a taxel that is missing for a while, and a scan without any reading."""
    t_s, values = t_s.copy(), values.copy()
    t_s[100:] += 1.0
    t_s[101:] += 2.0
    values[150:160, 3] = values[170] = np.nan
    return t_s, values


@pytest.mark.parametrize("name", RECORDINGS)
@pytest.mark.parametrize("piece", [28, 28 * 37, 1 << 18])
def test_duplicates_and_gaps(name: str, piece: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocks, "_PIECE", piece)
    t_s, values = faulty(*RECORDINGS[name])
    ceiling = np.full(values.shape[1], np.quantile(values[np.isfinite(values)], 0.999))
    one, other = (Deduplicator(28, ceiling, drop=True, kernel=kernel) for kernel in (None, deduplicate_block))
    for part in (slice(0, 1), slice(1, 250), slice(250, None)):
        expected, found = one.step(t_s[part], values[part]), other.step(t_s[part], values[part])
        assert_array_equal(found.t_s, expected.t_s)
        assert_array_equal(found.values, expected.values)
        assert_array_equal(found.gap, expected.gap)
    assert one.counts.gaps > 0
    assert found_counts(other) == pytest.approx(found_counts(one), rel=1e-12)
    assert_array_equal(other._histories, one._histories)


def found_counts(deduplicator: Deduplicator) -> list[float]:
    counts = deduplicator.counts
    return [counts.repeated, counts.gaps, counts.longest_gap_s, counts.step_s, counts.step_std_s, counts.usual_s]


@pytest.mark.parametrize("piece", [28, 28 * 37, 1 << 18])
def test_tare_and_contact(piece: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocks, "_PIECE", piece)
    _, values = faulty(np.arange(300) / 30, noisy_grasp(clipped=False))
    values[155, :14] = 1e200
    noise = np.full(28, 1.0)
    noise[5] = 0.0
    outcomes = []
    for kernel in (condition, condition_block):
        pads, last = records(PadContact, 2), np.zeros(28)
        pads["start"], pads["stop"], pads["on"], pads["off"] = (0, 14), (14, 28), 6.0, 4.0
        flags = np.empty((2, 300, 2), dtype=np.bool_)
        filled = Conditioned(np.empty_like(values), flags[0], flags[1])
        gap = np.arange(300) == 200
        kernel(values, gap, Zeroed(np.full(28, 0.5), noise, last), pads, filled)
        outcomes.append((*filled, last, pads))
    for expected, found in zip(*outcomes, strict=True):
        assert_array_equal(found, expected)
    _, contact, complete, *_ = outcomes[0]
    assert contact.any()
    assert not contact.all()
    assert not complete.all()


def test_kernels_take_over_in_a_long_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocks, "_MOST_SCANS", 100)
    asked: list[str] = []
    either = Blockwise(lambda scans: asked.append("block"), lambda scans: asked.append("kernel"))
    for _ in range(4):
        either(np.zeros(60))
    assert asked == ["block", "block", "kernel", "kernel"]
