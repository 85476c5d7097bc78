from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synthetic import pieces, raw_scans
from taxelflow.condition.sample import WINDOWS, Sample
from taxelflow.messages import Floats


def numbered(scans: int) -> Floats:
    count: Floats = np.arange(float(scans))[:, np.newaxis]
    return count


def stamped(values: Floats) -> tuple[Floats, Floats]:
    """Scans with their first value as their time, tenfold."""
    return 10.0 * values[:, 0], values


def sampled(scans: int, block: int = 5000) -> Sample:
    sample = Sample(1)
    for start in range(0, scans, block):
        sample.add(*stamped(numbered(scans)[start : start + block]))
    sample.close()
    return sample


def test_a_short_recording_is_kept_whole() -> None:
    windows = sampled(60).windows
    np.testing.assert_array_equal(windows.ravel(), np.arange(60))
    assert windows.shape == (5, WINDOWS.scans, 1)


@pytest.mark.parametrize("scans", [10_000, 100_000])
def test_never_more_windows_are_kept_than_allowed(scans: int) -> None:
    sample = sampled(scans)
    assert sample.windows.shape == (WINDOWS.most, WINDOWS.scans, 1)
    assert sample.windows_seen == scans // WINDOWS.scans


def test_every_window_is_of_consecutive_scans_and_none_is_kept_twice() -> None:
    windows = sampled(50_000).windows[:, :, 0]
    assert (np.diff(windows, axis=1) == 1).all()
    assert len(np.unique(windows[:, 0])) == WINDOWS.most


def test_windows_come_evenly_from_the_whole_recording() -> None:
    scans = 100_000
    share, _ = np.histogram(sampled(scans).windows[:, 0, 0], bins=8, range=(0, scans))
    assert (np.abs(share - WINDOWS.most / 8) < 5 * (WINDOWS.most / 8) ** 0.5).all()


@pytest.mark.parametrize("block", [5, 77, 20_000])
def test_every_window_knows_the_time_of_its_first_scan(block: int) -> None:
    sample = sampled(20_000, block)
    np.testing.assert_array_equal(sample.starts_s, 10.0 * sample.windows[:, 0, 0])


def test_a_replay_draws_the_same_windows() -> None:
    np.testing.assert_array_equal(sampled(30_000).windows, sampled(30_000).windows)


@given(cuts=st.lists(st.integers(0, 200), max_size=20), scans=st.integers(0, 200))
def test_the_sample_does_not_depend_on_how_scans_come(cuts: list[int], scans: int) -> None:
    whole, cut_up = Sample(1), Sample(1)
    raw = raw_scans(numbered(scans).reshape(scans, 1))
    whole.add(raw.t_s, raw.values)
    for piece in pieces(raw, [min(cut, scans) for cut in cuts]):
        cut_up.add(piece.t_s, piece.values)
    assert whole.remaining == cut_up.remaining
    whole.close()
    cut_up.close()
    np.testing.assert_array_equal(whole.windows, cut_up.windows)


def test_long_recordings_cut_differently_give_the_same_sample() -> None:
    np.testing.assert_array_equal(sampled(20_000, 20_000).windows, sampled(20_000, 77).windows)


def test_wanted_counts_down_to_the_next_full_window() -> None:
    sample = Sample(1)
    assert sample.remaining == WINDOWS.scans
    sample.add(*stamped(numbered(5)))
    assert (sample.remaining, sample.windows_seen) == (WINDOWS.scans - 5, 0)
    sample.add(*stamped(numbered(7)))
    assert (sample.remaining, sample.windows_seen) == (WINDOWS.scans, 1)


@given(scans=st.integers(0, 9 * WINDOWS.scans))
def test_scans_until_the_windows_have_doubled(scans: int) -> None:
    sample = Sample(1)
    sample.add(*stamped(numbered(scans)))
    expected = next(count for count in (1, 2, 4, 8, 16) if count > sample.windows_seen)
    assert sample.until_doubled == expected * WINDOWS.scans - scans


@pytest.mark.parametrize("missing", [False, True])
@pytest.mark.parametrize("cuts", [[], [50], [121, 122]])
def test_of_windows_before_any_reading_changes_the_first_counts(cuts: list[int], missing: bool) -> None:
    values = np.full((15 * WINDOWS.scans, 2), 7.0)
    values[:, 1] = np.nan if missing else 3.0
    values[123] += 1.0
    values[123, 1] = 0.0
    sample = Sample(2, forgets=True)
    for part in np.split(values, cuts):
        sample.add(*stamped(part))
    assert sample.windows_seen == 6
    np.testing.assert_array_equal(sample.windows[1], values[10 * WINDOWS.scans : 11 * WINDOWS.scans])
    assert len(sampled(100)) == 8


@pytest.mark.parametrize("scans", [1, 2, 11])
def test_fewer_scans_than_a_window_still_make_one(scans: int) -> None:
    windows = sampled(scans).windows
    assert len(windows) == 1
    np.testing.assert_array_equal(windows[0, :scans, 0], np.arange(scans))


def test_no_scans_make_no_window() -> None:
    assert len(sampled(0).windows) == 0


def test_what_is_kept_does_not_change_when_the_source_reuses_its_memory() -> None:
    sample, memory = Sample(1), np.ones((18, 1))
    sample.add(*stamped(memory))
    memory[:] = 7
    sample.add(*stamped(np.ones((6, 1))))
    assert (sample.windows == 1).all()


def test_windows_of_many_taxels_are_fewer() -> None:
    taxels = 20_000
    sample = Sample(taxels)
    for block in range(4):
        sample.add(np.arange(240.0) + 240 * block, np.full((240, taxels), float(block)))
    assert sample.windows.nbytes <= 1 << 26
    assert len(sample.windows) == len(sample.starts_s) == 34


def test_a_snapshot_stays_as_it_is_and_shares_what_it_holds() -> None:
    sample = sampled(WINDOWS.most * WINDOWS.scans)
    held = sample.snapshot()
    before = held.windows
    sample.add(*stamped(numbered(20_000)))
    np.testing.assert_array_equal(held.windows, before)
    assert not np.array_equal(sample.windows, before)
    assert (len(held), len(held.starts_s)) == (WINDOWS.most, WINDOWS.most)
    assert sum(one is other for one, other in zip(held._windows, sample._windows, strict=True)) > 0  # nothing is copied
