from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from logged import PALM, WIDE, deduplicated, logged, noisy_grasp
from synthetic import conditioned, dome, pieces, raw_scans, recorded
from taxelflow.condition.deduplicate import Deduplicator
from taxelflow.pipeline.api import estimate, read

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.messages import Floats

both_modes = pytest.mark.parametrize("mode", ["batch", "stream"])


@pytest.mark.parametrize("times", [2, 3, 10])
@pytest.mark.parametrize("clipped", [True, False])
def test_repeats_of_a_loaded_sensor_are_dropped_and_its_true_rate_is_reported(times: int, clipped: bool) -> None:
    values = noisy_grasp(clipped=clipped)
    deduplicator, kept = deduplicated(*logged(values, times))
    idle = 100 if clipped else 0
    assert len(kept) == idle * times + (300 - idle)
    assert deduplicator.counts.repeated == (300 - idle) * (times - 1)
    assert 1 / deduplicator.counts.usual_s == pytest.approx(30, rel=0.01)
    assert deduplicator.counts.gaps == 0


def test_a_logger_that_is_not_a_whole_number_of_times_as_fast() -> None:
    values = noisy_grasp(clipped=False)
    t_s = np.arange(700) / 70.0
    deduplicator, kept = deduplicated(t_s, values[(t_s * 30 + 1e-9).astype(int)])
    assert len(kept) == 300
    assert 1 / deduplicator.counts.usual_s == pytest.approx(30, rel=0.02)


def test_an_idle_sensor_that_clips_repeats_itself_rightly() -> None:
    values = noisy_grasp()
    deduplicator, kept = deduplicated(np.arange(300) / 30, values)
    assert (len(kept), deduplicator.counts.repeated) == (300, 0)


def test_a_still_contact_without_noise_repeats_itself_rightly() -> None:
    moving = np.array([dome(PALM, x) for x in np.linspace(-0.01, 0.01, 100)])
    values = np.concatenate([moving, np.repeat(moving[-1:], 200, axis=0), moving[::-1]])
    assert len(deduplicated(np.arange(400) / 30, values)[1]) == 400


def test_a_still_contact_under_a_converter_coarser_than_the_noise_repeats_itself_rightly() -> None:
    values = noisy_grasp(1000, sigma=0.12, clipped=False, step=1.0)
    same = (values[1:] == values[:-1]).all(axis=1)
    assert same.sum() > 50
    assert len(deduplicated(np.arange(1000) / 30, values)[1]) == 1000


def test_a_smooth_motion_betrays_its_logger_by_the_beat() -> None:
    moving = np.array([dome(WIDE, x) for x in np.linspace(-0.06, 0.06, 100)])
    deduplicator, kept = deduplicated(*logged(moving, 3))
    assert deduplicator.counts.repeated == 200
    assert len(kept) == 100


def without_repeats(readings: Floats, *, passes: int = 2) -> int:
    """How many of these scans (scans, taxels) are kept, after a first one that is all 0, the lowest."""
    values = np.concatenate([np.zeros_like(readings[:1]), readings])
    return len(deduplicated(np.arange(len(values)) / 30, values, passes=passes)[1]) - 1


@pytest.mark.parametrize(("taxels", "least"), [(2, 100), (3, 5), (4, 4)])
def test_the_fewer_taxels_are_loaded_the_more_scans_of_noise_they_need_and_two_never_suffice(
    taxels: int, least: int
) -> None:
    """Noise that reverses with each scan, the first of which follow the idle one."""
    for reversals in (least - 1, least):
        noise = np.resize([[1.0], [2.0]], (reversals + 2, 1)) * np.ones(taxels)
        recognised = without_repeats(np.append(noise, noise[-1:], axis=0), passes=1) == len(noise)
        assert recognised == (reversals >= least and taxels > 2)


@pytest.mark.parametrize(("rising", "recognised"), [(5, False), (3, True)])
def test_loads_that_rise_and_fall_for_five_scans_each_are_too_smooth_to_be_evidence(
    rising: int, recognised: bool
) -> None:
    wave = 1.0 + rising - np.abs(np.arange(100) % (2 * rising) - rising)
    readings = wave[:, np.newaxis] * np.ones(28)
    assert (without_repeats(np.append(readings, readings[-1:], axis=0)) == 100) == recognised


@pytest.mark.parametrize(
    ("taxels", "times", "dropped"), [(2, 2, False), (3, 2, True), (28, 2, True), (28, 1.25, False)]
)
def test_a_beat_needs_three_loaded_taxels_and_a_logger_that_is_half_as_fast_again(
    taxels: int, times: float, dropped: bool
) -> None:
    ramp = np.ones((100, 28))
    ramp[:, :taxels] += np.arange(100)[:, np.newaxis]
    ramp[:, taxels:] = 0.0
    logger = (np.arange(times * 100) / times).astype(int)
    assert (without_repeats(ramp[logger]) == 100) == dropped


@pytest.mark.parametrize(("in_turn", "dropped"), [(6, True), (12, False)])
def test_a_beat_is_never_more_than_two_scans_early_or_late(in_turn: int, dropped: bool) -> None:
    """Scans come twice for a while, then three times each: 1.5 or 3 scans early or late."""
    runs = np.resize(np.repeat([2, 3], in_turn), 60)
    values = np.repeat(1.0 + np.arange(60), runs)[:, np.newaxis] * np.ones(28)
    assert (without_repeats(values) == 60) == dropped


def test_repeats_can_be_kept() -> None:
    t_s, values = logged(noisy_grasp(), 3)
    scans, _ = conditioned(values, PALM, t_s=t_s, repeats="keep")
    assert len(scans) == 900


@given(cuts=st.lists(st.integers(0, 900), max_size=20))
def test_what_is_dropped_does_not_depend_on_how_the_stream_is_cut(cuts: list[int]) -> None:
    t_s, values = logged(noisy_grasp(), 3)
    t_s[500:] += 1.0
    whole, parts = Deduplicator(28, np.full(28, np.inf), drop=True), Deduplicator(28, np.full(28, np.inf), drop=True)
    once = whole.step(t_s, values)
    again = [parts.step(piece.t_s, piece.values) for piece in pieces(raw_scans(values, t_s), cuts)]
    np.testing.assert_array_equal(once.t_s, np.concatenate([piece.t_s for piece in again]))
    np.testing.assert_array_equal(once.gap, np.concatenate([piece.gap for piece in again]))
    assert whole.counts == parts.counts


@pytest.mark.parametrize("known", [100, 101, 350])
def test_a_stream_drops_by_what_it_has_received(known: int) -> None:
    t_s, values = logged(noisy_grasp(), 3)
    other = values.copy()
    other[known:] = np.random.default_rng(9).normal(0, 1e4, other[known:].shape)
    kept = [deduplicated(t_s, array, passes=1)[1] for array in (values, other)]
    before = [times[times < t_s[known] - 1e-9].tolist() for times in kept]
    assert before[0] == before[1]


def test_missing_readings_repeat_like_any_other() -> None:
    values = noisy_grasp(clipped=False)
    values[:, 3] = np.nan
    assert len(deduplicated(*logged(values, 2))[1]) == 300


@pytest.mark.long
@both_modes
def test_noise_and_motion_are_those_of_the_sensor_not_of_its_logger(mode: str) -> None:
    moving = np.array([dome(WIDE, x) for x in np.linspace(-0.05, 0.05, 200)])
    moving += np.random.default_rng(1).normal(0, 100, moving.shape)
    plain = estimate(recorded(moving, WIDE, np.arange(200) / 30), mode=mode)  # type: ignore[arg-type]
    t_s, values = logged(moving, 3)
    repeated = estimate(recorded(values, WIDE, t_s), mode=mode)  # type: ignore[arg-type]
    speeds = [result.slips.velocity[100:180, 0, 0].mean() for result in (plain, repeated)]
    assert speeds[1] == pytest.approx(speeds[0], rel=0.02)
    assert repeated.summary.pads["pad0"].noise == pytest.approx(plain.summary.pads["pad0"].noise, rel=0.2)
    assert repeated.summary.rate_hz == pytest.approx(30, rel=0.02)
    assert repeated.summary.repeated_values_dropped > 350
    assert any("repeat the one before bit for bit" in note for note in repeated.summary.notes)


@pytest.mark.long
def test_a_batch_of_repeats_gives_the_scans_of_the_sensor() -> None:
    values = noisy_grasp(clipped=False)
    t_s, repeated = logged(values, 3)
    one, _ = conditioned(values, PALM, t_s=t_s[::3], tare="none")
    other, _ = conditioned(repeated, PALM, t_s=t_s, tare="none")
    np.testing.assert_array_equal(one.t_s, other.t_s)
    np.testing.assert_array_equal(one.pressure, other.pressure)


@pytest.mark.parametrize("times", [2, 3])
def test_a_real_sliding_object_behind_a_fast_logger(recordings: Path, times: int) -> None:
    recording = read(recordings / "sdh-dsa" / "slip_and_rotation_teapot_handle.dsa")
    raw = recording.load()
    loaded = int((raw.values > 0).any(axis=1).sum())
    t_s, values = logged(raw.values, times)
    scans = estimate(recorded(values, recording.sensor, t_s)).summary
    assert scans.repeated_values_dropped == pytest.approx(loaded * (times - 1), abs=3)
