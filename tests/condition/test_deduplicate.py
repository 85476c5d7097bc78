from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synthetic import assert_same, conditioned, dome, grid_sensor, pieces, raw_scans, recorded
from taxelflow import registry
from taxelflow.api import estimate, read
from taxelflow.condition.deduplicate import Deduplicator

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.messages import Floats

PALM = grid_sensor(4, 7, full_scale=140e3)
WIDE = grid_sensor(9, 21, full_scale=140e3)
both_modes = pytest.mark.parametrize("mode", ["batch", "stream"])


def noisy_grasp(scans: int = 300, sigma: float = 100.0, *, clipped: bool = True, step: float = 10.0) -> Floats:
    """A third idle, then a dome; idle taxels read exactly 0 if the sensor clips. Quantised."""
    random = np.random.default_rng(0)
    load = np.where(np.arange(scans) < scans // 3, 0.0, 1.0)[:, np.newaxis] * dome(PALM)
    values: Floats = step * np.round((load + random.normal(0, sigma, load.shape)) / step)
    return np.where(load > 5 * sigma, np.maximum(values, 0), 0) if clipped else values


def logged(values: Floats, times: int, rate_hz: float = 30.0) -> tuple[Floats, Floats]:
    """What a logger writes that is so many times as fast as the sensor: stamps and scans."""
    stamps: Floats = np.arange(times * len(values)) / (times * rate_hz)
    return stamps, np.repeat(values, times, axis=0)


def sifted(t_s: Floats, values: Floats, *, passes: int = 2, **more: bool) -> tuple[Deduplicator, Floats]:
    sifter = Deduplicator(values.shape[1], np.full(values.shape[1], np.inf), **{"drop": True, **more})
    kept = np.zeros(0)
    for _ in range(passes):
        sifter.restart()
        kept = sifter.step(t_s, values).t_s
    return sifter, kept


@pytest.mark.parametrize("times", [2, 3, 10])
@pytest.mark.parametrize("clipped", [True, False])
def test_repeats_of_a_loaded_sensor_are_dropped_and_its_true_rate_is_told(times: int, clipped: bool) -> None:
    values = noisy_grasp(clipped=clipped)
    sifter, kept = sifted(*logged(values, times))
    idle = 100 if clipped else 0
    assert len(kept) == idle * times + (300 - idle)
    assert sifter.counts.repeated == (300 - idle) * (times - 1)
    assert 1 / sifter.counts.usual_s == pytest.approx(30, rel=0.01)
    assert sifter.counts.gaps == 0


def test_a_logger_that_is_not_a_whole_number_of_times_as_fast() -> None:
    values = noisy_grasp(clipped=False)
    t_s = np.arange(700) / 70.0
    sifter, kept = sifted(t_s, values[(t_s * 30 + 1e-9).astype(int)])
    assert len(kept) == 300
    assert 1 / sifter.counts.usual_s == pytest.approx(30, rel=0.02)


def test_an_idle_sensor_that_clips_repeats_itself_rightly() -> None:
    values = noisy_grasp()
    sifter, kept = sifted(np.arange(300) / 30, values)
    assert (len(kept), sifter.counts.repeated) == (300, 0)


def test_a_still_contact_without_noise_repeats_itself_rightly() -> None:
    moving = np.array([dome(PALM, x) for x in np.linspace(-0.01, 0.01, 100)])
    values = np.concatenate([moving, np.repeat(moving[-1:], 200, axis=0), moving[::-1]])
    assert len(sifted(np.arange(400) / 30, values)[1]) == 400


def test_a_still_contact_under_a_converter_coarser_than_the_noise_repeats_itself_rightly() -> None:
    values = noisy_grasp(1000, sigma=0.12, clipped=False, step=1.0)
    same = (values[1:] == values[:-1]).all(axis=1)
    assert same.sum() > 50
    assert len(sifted(np.arange(1000) / 30, values)[1]) == 1000


def test_a_smooth_motion_betrays_its_logger_by_the_beat() -> None:
    moving = np.array([dome(WIDE, x) for x in np.linspace(-0.06, 0.06, 100)])
    sifter, kept = sifted(*logged(moving, 3))
    assert sifter.counts.repeated == 200
    assert len(kept) == 100


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
def test_a_stream_drops_by_what_it_has_seen(known: int) -> None:
    t_s, values = logged(noisy_grasp(), 3)
    other = values.copy()
    other[known:] = np.random.default_rng(9).normal(0, 1e4, other[known:].shape)
    kept = [sifted(t_s, array, passes=1)[1] for array in (values, other)]
    before = [times[times < t_s[known] - 1e-9].tolist() for times in kept]
    assert before[0] == before[1]


def test_missing_readings_repeat_like_any_other() -> None:
    values = noisy_grasp(clipped=False)
    values[:, 3] = np.nan
    assert len(sifted(*logged(values, 2))[1]) == 300


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


# Gaps


def stroke_with_gap(gap_s: float) -> tuple[Floats, Floats]:
    """A dome that moves on while 10 scans are lost."""
    x = np.concatenate([np.linspace(-0.05, -0.02, 40), np.linspace(0.02, 0.05, 40)])
    values = np.array([dome(WIDE, place, place / 3) for place in x])
    t_s = np.arange(80) / 30
    t_s[40:] += gap_s
    return t_s, values + np.random.default_rng(0).normal(0, 50, values.shape)


@pytest.mark.parametrize("method", sorted({*registry.names("estimator")} - {"template"}))
@both_modes
def test_no_motion_is_invented_across_a_gap(method: str, mode: str) -> None:
    t_s, values = stroke_with_gap(0.5)
    result = estimate(recorded(values, WIDE, t_s), method, mode=mode)  # type: ignore[arg-type]
    slips = result.slips
    assert result.summary.gaps == 1
    after = slips.t_s >= t_s[40] - 1e-9
    spans = slips.span_s[after, 0]
    assert not np.nanmax(np.where(np.isfinite(spans), spans, 0.0)) > 0.1
    moved = slips.displacement[..., :2]
    if np.isfinite(moved).any():
        per_scan = 0.03 / 39
        assert np.nanmax(np.abs(moved[after, 0, 0])) < 20 * per_scan
        net = result.summary.pads["pad0"].net_m[0]
        assert net < 0.075  # of 100 mm, 40 lie in the gap
    assert "contact" in [event.event for event in result.events]
    assert [event.event for event in result.events].count("release") == 0
    assert any(note.startswith("1 gap of 0.533 s") for note in result.summary.notes)


@both_modes
def test_the_template_knows_the_object_again_and_measures_what_a_gap_hid(mode: str) -> None:
    t_s, values = stroke_with_gap(0.5)
    slips = estimate(recorded(values, WIDE, t_s), "template", mode=mode).slips  # type: ignore[arg-type]
    first = int(np.searchsorted(slips.t_s, t_s[40] - 1e-9))
    assert slips.displacement[first, 0, 0] == pytest.approx(0.04, abs=0.0002)
    assert slips.span_s[first, 0] == pytest.approx(0.5 + 1 / 30)


@pytest.mark.parametrize("method", ["convolution", "principal_axis"])
def test_the_object_does_not_jump_across_a_gap(method: str) -> None:
    t_s, values = stroke_with_gap(0.5)
    pose = estimate(recorded(values, WIDE, t_s), method).motions.pose[:, :2]
    steps = np.abs(np.diff(pose, axis=0))
    assert np.nanmax(steps) < 0.005


def test_the_first_scan_after_a_gap_is_not_complete_and_no_other() -> None:
    t_s, values = stroke_with_gap(0.5)
    scans, session = conditioned(values, WIDE, t_s=t_s)
    assert np.flatnonzero(~scans.complete[:, 0]).tolist() == [40]
    assert scans.contact[40].all()
    assert (session.counts.gaps, round(session.counts.longest_gap_s, 3)) == (1, 0.533)


def test_three_lost_scans_are_a_gap_and_one_is_not() -> None:
    values = noisy_grasp(60, clipped=False)
    for lost, gaps in ((1, 0), (3, 1)):
        t_s = np.arange(60) / 30
        t_s[30:] += lost / 30
        assert sifted(t_s, values)[0].counts.gaps == gaps


def test_a_sensor_that_hangs_while_its_logger_goes_on_leaves_a_gap() -> None:
    values = np.repeat(noisy_grasp(clipped=False), 3, axis=0)
    hung = np.concatenate([values[:600], np.repeat(values[599:600], 90, axis=0), values[600:]])
    sifter, _ = sifted(np.arange(990) / 90.0, hung)
    assert sifter.counts.gaps == 1
    assert sifter.counts.longest_gap_s == pytest.approx(93 / 90, abs=0.02)


def test_a_slower_rate_is_not_a_gap_for_ever() -> None:
    t_s = np.concatenate([np.arange(100) / 100, 1 + np.arange(1, 101) / 10])
    sifter, _ = sifted(t_s, noisy_grasp(200, clipped=False))
    assert 1 <= sifter.counts.gaps <= 8


def test_jitter_is_no_gap() -> None:
    t_s = np.cumsum(np.random.default_rng(0).uniform(0.02, 0.045, 300))
    sifter, _ = sifted(t_s, noisy_grasp(clipped=False))
    assert sifter.counts.gaps == 0
    assert sifter.counts.step_s == pytest.approx(float(np.diff(t_s).mean()))
    assert sifter.counts.step_std_s == pytest.approx(float(np.diff(t_s).std()))


def test_conditioned_scans_are_the_same_however_a_stream_with_repeats_and_gaps_comes() -> None:
    t_s, values = logged(noisy_grasp(clipped=False), 3)
    t_s[400:] += 2.0
    one, _ = conditioned(values, PALM, mode="stream", t_s=t_s)
    other, _ = conditioned(values, PALM, mode="stream", t_s=t_s, cuts=range(0, 900, 7))
    assert_same(one, other)
