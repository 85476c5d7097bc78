"""Offsets of streams and recordings that start under a load."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

import taxelflow
from synthetic import conditioned, dome, grid_sensor
from taxelflow.condition.held_load import holds_load

if TYPE_CHECKING:
    from taxelflow.messages import Floats

SMALL = grid_sensor(4, 4, unit="count", pitch_m=(0.004, 0.004))
NONE = np.zeros(16, dtype=np.bool_)
PEAK = 400.0


def start_under_load(*, idle_scans: int = 0, seed: int = 2) -> Floats:
    """300 scans at rest, 100 of sliding by 6 mm, 100 at rest, in counts, then without load."""
    x_m = np.concatenate([np.zeros(300), np.linspace(0, 0.006, 100), np.full(100, 0.006)])
    loads = np.array([dome(SMALL, x + 0.001, 0.002, peak=PEAK, radius_m=0.0035) for x in x_m])
    return readings(np.concatenate([loads, np.zeros((idle_scans, 16))]), seed)


def readings(loads: Floats, seed: int = 2) -> Floats:
    random = np.random.default_rng(seed)
    return np.round(loads + 20 + random.normal(0, 4, 16) + random.normal(0, 2, loads.shape))


@pytest.mark.parametrize(
    ("fall", "taxels", "rise", "held"),
    [
        (5.0, 2, 0.0, False),  # within noise
        (8.0, 2, 0.0, True),
        (8.0, 1, 0.0, False),  # a fault
        (20.0, 2, 100.0, False),  # what a skin does beside a load
        (30.0, 2, 100.0, True),
    ],
)
def test_readings_fall_below_an_offset_that_holds_a_load(fall: float, taxels: int, rise: float, held: bool) -> None:
    idle, later = np.zeros((3, 12, 16)), np.zeros((3, 12, 16))
    later[:, :, :taxels] -= fall
    later[:, :, -1] += rise
    windows = np.concatenate([idle, later])
    windows[0, 0, 9] = np.nan
    assert holds_load(np.zeros(16), windows, np.ones(16), NONE) == held
    assert not holds_load(np.zeros(16), windows, np.ones(16), ~NONE)


def test_readings_that_are_all_equal_do_not_show_that_an_offset_holds_a_load() -> None:
    windows = np.stack([np.full((12, 16), 300.0) + np.arange(16), np.zeros((12, 16))])
    assert not holds_load(windows[0, 0], windows, np.ones(16), NONE)
    windows[1, :, 0] += np.arange(12)
    assert holds_load(windows[0, 0], windows, np.ones(16), NONE)


def test_a_stream_that_starts_under_a_load_finds_the_contact_once_it_moves() -> None:
    scans, session = conditioned(start_under_load(), SMALL, mode="stream")
    assert session.baseline is not None
    assert scans.contact[340:, 0].all()
    assert session.baseline.withdrawn.all()
    np.testing.assert_allclose(session.baseline.offset, 20, atol=0.1 * PEAK)


def test_a_stream_that_starts_under_a_load_has_its_idle_level_once_it_is_released() -> None:
    scans, session = conditioned(start_under_load(idle_scans=400), SMALL, mode="stream")
    assert session.baseline is not None
    assert session.baseline.tared.all()
    assert not scans.contact[-200:].any()
    np.testing.assert_allclose(session.baseline.offset, 20, atol=0.1 * PEAK)


@pytest.mark.parametrize("seed", range(4))
def test_a_batch_that_starts_under_a_load_and_never_lets_go_has_contact(seed: int) -> None:
    scans, _ = conditioned(start_under_load(seed=seed), SMALL)
    assert scans.contact.all()


def test_the_time_until_which_offsets_held_a_load_is_noted() -> None:
    values = start_under_load()
    result = taxelflow.estimate(taxelflow.recording(np.arange(len(values)) / 100, values, SMALL), mode="stream")
    (note,) = [one for one in result.summary.notes if one.startswith("the first offsets were too high")]
    assert "pad0 until 3." in note
    assert note.endswith("declare full_scale in the sensor file")


@pytest.mark.parametrize("blocks", [1, 7, 100])
def test_offsets_are_withdrawn_in_the_same_scan_whatever_the_blocks(blocks: int) -> None:
    values = start_under_load()
    whole, _ = conditioned(values, SMALL, mode="stream")
    parts, _ = conditioned(values, SMALL, mode="stream", cuts=range(blocks, len(values), blocks))
    np.testing.assert_array_equal(parts.pressure, whole.pressure)


@pytest.mark.parametrize("spread", [4.0, 100.0, 1000.0])
@pytest.mark.parametrize("beside", [0.0, -0.15])
def test_offsets_of_an_idle_start_stay_whatever_their_scatter(spread: float, beside: float) -> None:
    random = np.random.default_rng(5)
    load = dome(SMALL, 0.001, 0.002, peak=PEAK, radius_m=0.004)
    touched = np.repeat([0.0, 1.0, 0.0, 1.0, 0.0], 60)[:, np.newaxis] * np.where(load > 0, load, beside * PEAK)
    values = touched + spread * random.uniform(0, 1, 16) + random.normal(0, 2, touched.shape)
    scans, session = conditioned(values, SMALL, mode="stream")
    assert session.baseline is not None
    assert not session.baseline.withdrawn.any()
    np.testing.assert_array_equal(scans.contact[:, 0], touched.max(axis=1) > 0)


def test_a_failure_of_the_sensor_withdraws_no_offset() -> None:
    values = readings(np.zeros((600, 16))) + 300
    values[200:260] = 0.0
    scans, session = conditioned(values, SMALL, mode="stream")
    assert session.baseline is not None
    assert not session.baseline.withdrawn.any()
    assert not scans.contact.any()


def test_an_idle_pad_that_drifts_down_has_the_offset_of_now() -> None:
    values = readings(np.linspace(0, -100, 2000)[:, np.newaxis] * np.ones(16)) + 300
    scans, session = conditioned(values, SMALL, mode="stream")
    assert session.baseline is not None
    assert not scans.contact.any()
    assert np.abs(session.baseline.offset - values[-12:].mean(axis=0)).max() < 60


def test_an_offset_declared_idle_is_never_withdrawn() -> None:
    _, session = conditioned(start_under_load(), SMALL, mode="stream", tare="start")
    assert session.baseline is not None
    assert session.baseline.tared.all()
    assert not session.baseline.withdrawn.any()
