from __future__ import annotations

import numpy as np
import pytest

from synthetic import conditioned, dome, grid_sensor
from taxelflow.messages import Floats

PADS = grid_sensor(4, 7, pads=2)
OF = [PADS.layout.of_pad(pad) for pad in range(2)]
STREAM = grid_sensor(4, 7, pads=2, full_scale=140e3)
TAXELS = PADS.layout.taxels
SCANS = 600


def noise(scans: int = SCANS, sigma: float = 20.0, seed: int = 0) -> Floats:
    drawn: Floats = np.random.default_rng(seed).normal(0, sigma, (scans, TAXELS))
    return drawn


def offset(mean: float, spread: float) -> Floats:
    """An idle reading per taxel, without spatial order, as electronics make it."""
    drawn: Floats = mean + np.random.default_rng(7).uniform(-spread, spread, TAXELS)
    return drawn


def grasps(pad: int, *, least: float = 0.0, most: float = 50e3, radius_m: float = 0.012) -> Floats:
    """(scans, taxels) of a load that comes and goes while it moves."""
    load = np.clip(np.sin(np.arange(SCANS) / 20), 0, 1)
    place = 0.01 * np.sin(np.arange(SCANS) / 31)
    scans = [
        dome(PADS, x, pad=pad, peak=least + (most - least) * share, radius_m=radius_m)
        for share, x in zip(load, place, strict=True)
    ]
    return np.array(scans)


def untouched(values: Floats, pad: int, mode: str = "batch") -> bool:
    """The pad's readings pass through as they are."""
    scans, session = conditioned(values, STREAM if mode == "stream" else PADS, mode=mode)
    assert session.baseline is not None
    return not session.baseline.tared[pad] and bool(np.array_equal(scans.pressure[:, OF[pad]], values[:, OF[pad]]))


@pytest.mark.parametrize("spread", [0.0, 300.0, 1500.0])
def test_idle_scans_take_an_offset_away_in_a_batch(spread: float) -> None:
    bias = offset(2000, spread)
    load = grasps(0)
    scans, session = conditioned(load + bias + noise(), PADS)
    assert session.baseline is not None
    assert session.baseline.tared.all()
    np.testing.assert_allclose(session.baseline.offset, bias, atol=20)
    np.testing.assert_allclose(scans.pressure, load, atol=20 * 6)
    touched = load[:, OF[0]].max(axis=1) > 2000
    assert scans.contact[touched, 0].all()
    assert not scans.contact[load[:, OF[0]].max(axis=1) == 0, 0].any()


@pytest.mark.parametrize("spread", [0.0, 300.0, 1500.0])
def test_an_idle_start_takes_an_offset_away_in_a_stream(spread: float) -> None:
    bias = offset(2000, spread)
    values = bias + noise()
    values[30:] += grasps(0)[:-30]
    scans, session = conditioned(values, STREAM, mode="stream")
    assert session.baseline is not None
    assert session.baseline.tared.all()
    np.testing.assert_allclose(session.baseline.offset, bias, atol=20 * 6 / 12**0.5)
    assert not scans.contact[:30].any()


def test_a_negative_offset_is_taken_away_too() -> None:
    _, session = conditioned(grasps(0) - 2000 + noise(), PADS)
    assert session.baseline is not None
    np.testing.assert_allclose(session.baseline.offset, -2000, atol=20)


@pytest.mark.parametrize("mode", ["batch", "stream"])
@pytest.mark.parametrize("radius_m", [0.006, 0.012, 0.02, 0.04])
def test_a_contact_from_the_first_to_the_last_scan_stays(mode: str, radius_m: float) -> None:
    values = dome(PADS, radius_m=radius_m) + noise()
    assert untouched(values, 0, mode)


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_a_steady_contact_stays_while_another_pad_moves(mode: str) -> None:
    values = dome(PADS, peak=30e3) + grasps(1) + noise()
    assert untouched(values, 0, mode)


@pytest.mark.parametrize("mode", ["batch", "stream"])
@pytest.mark.parametrize("radius_m", [0.006, 0.012, 0.02])
@pytest.mark.parametrize("peak", [1e3, 2e3, 4e3])
def test_a_light_steady_contact_stays_beside_a_strong_one(mode: str, peak: float, radius_m: float) -> None:
    values = dome(PADS, peak=peak, radius_m=radius_m) + grasps(1) + noise()
    assert untouched(values, 0, mode)


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_a_light_steady_contact_at_a_corner_stays(mode: str) -> None:
    values = dome(PADS, -0.03, 0.015, peak=3e3) + grasps(1) + noise()
    assert untouched(values, 0, mode)


@pytest.mark.parametrize("mode", ["batch", "stream"])
@pytest.mark.parametrize("radius_m", [0.006, 0.012, 0.02])
@pytest.mark.parametrize("least", [1e3, 2e3, 10e3])
def test_a_contact_whose_load_varies_but_never_lets_go_stays(mode: str, least: float, radius_m: float) -> None:
    assert untouched(grasps(0, least=least, radius_m=radius_m) + noise(), 0, mode)


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_an_object_that_slides_from_first_to_last_scan_stays(mode: str) -> None:
    values = np.array([dome(PADS, x) for x in np.linspace(-0.03, 0.03, SCANS)]) + noise()
    assert untouched(values, 0, mode)


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_pads_are_tared_independently(mode: str) -> None:
    bias = offset(1500, 300)
    values = dome(PADS, peak=30e3) + bias + noise()
    values[30:] += grasps(1)[:-30]
    sensor = STREAM if mode == "stream" else PADS
    _, session = conditioned(values, sensor, mode=mode)
    assert session.baseline is not None
    assert session.baseline.tared.tolist() == [False, True]
    np.testing.assert_array_equal(session.baseline.offset[OF[0]], 0)
    np.testing.assert_allclose(session.baseline.offset[OF[1]], bias[OF[1]], atol=50)


def test_a_stream_without_a_full_scale_takes_nothing_away_that_might_be_a_load() -> None:
    scans, _ = conditioned(dome(PADS, peak=3e3) + noise(), PADS, mode="stream")
    assert scans.contact[:, 0].all()


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_no_tare_leaves_every_reading_as_it_is(mode: str) -> None:
    values = grasps(0) + 2000 + noise()
    scans, _ = conditioned(values, STREAM, mode=mode, tare="none")
    np.testing.assert_array_equal(scans.pressure, values)


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_a_declared_idle_start_is_taken_away_whatever_it_reads(mode: str) -> None:
    values = dome(PADS, peak=20e3) + noise()
    values[12:] += grasps(1)[12:]
    scans, session = conditioned(values, STREAM, mode=mode, tare="start")
    assert session.baseline is not None
    assert session.baseline.tared.all()
    np.testing.assert_allclose(session.baseline.offset, values[:12].mean(axis=0), rtol=1e-12)
    assert not scans.contact[:, 0].any()


def test_a_declared_idle_start_is_the_start_of_a_long_recording_too() -> None:
    sensor = grid_sensor(1, 2)
    values = np.random.default_rng(0).normal(5000, 10, (40_000, 2))
    values[:12] -= 4000
    _, session = conditioned(values, sensor, tare="start")
    assert session.baseline is not None
    np.testing.assert_allclose(session.baseline.offset, values[:12].mean(axis=0), rtol=1e-12)


def test_a_missing_reading_in_the_idle_start_is_left_out_of_its_mean() -> None:
    values = offset(500, 100) + noise(100)
    values[3, 5] = np.nan
    _, session = conditioned(values, PADS, tare="start")
    assert session.baseline is not None
    np.testing.assert_allclose(session.baseline.offset[5], np.nanmean(values[:12, 5]))
    assert np.isfinite(session.baseline.offset).all()


def test_a_short_recording_declared_idle_gives_its_plain_mean() -> None:
    values = offset(500, 100) + noise(5)
    _, session = conditioned(values, PADS, tare="start")
    assert session.baseline is not None
    np.testing.assert_allclose(session.baseline.offset, values.mean(axis=0))


@pytest.mark.parametrize("missing", [np.nan, np.inf])
def test_a_dead_taxel_does_not_keep_a_pad_from_being_tared(missing: float) -> None:
    values = grasps(0) + 1000 + noise()
    values[:, 3] = missing
    _, session = conditioned(values, PADS)
    assert session.baseline is not None
    assert session.baseline.tared.all()
    assert session.baseline.masked.tolist() == [taxel == 3 for taxel in range(TAXELS)]


def test_a_taxel_that_fails_now_and_then_does_not_keep_a_pad_from_being_tared() -> None:
    values = grasps(0) + 1000 + noise()
    values[np.random.default_rng(3).random(SCANS) < 0.2, 3] = np.nan
    _, session = conditioned(values, PADS)
    assert session.baseline is not None
    assert session.baseline.tared.all()


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_an_idle_recording_with_an_offset_is_no_contact(mode: str) -> None:
    scans, session = conditioned(offset(3000, 500) + noise(), STREAM, mode=mode)
    assert session.baseline is not None
    assert session.baseline.tared.all()
    assert not scans.contact.any()


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_an_offset_small_against_full_scale_is_taken_away_even_if_loads_are_light(mode: str) -> None:
    values = offset(3000, 500) + noise()
    values[30:] += grasps(0, most=20e3)[:-30]
    scans, session = conditioned(values, STREAM, mode=mode)
    assert session.baseline is not None
    assert session.baseline.tared.all()
    assert not scans.contact[:30].any()
