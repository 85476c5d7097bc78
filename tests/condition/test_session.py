from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from synthetic import assert_same, conditioned, dome, grid_sensor, pieces, raw_scans
from taxelflow.condition.parameters import Conditioner
from taxelflow.messages import joined

if TYPE_CHECKING:
    from taxelflow.messages import Floats, Scans

PALM = grid_sensor(4, 7, full_scale=140e3)
TWO = grid_sensor(4, 7, pads=2, full_scale=140e3)


def noisy(scans: int, taxels: int = 28, sigma: float = 100.0, seed: int = 0) -> Floats:
    drawn: Floats = np.random.default_rng(seed).normal(0, sigma, (scans, taxels))
    return drawn


def grasp(scans: int = 100, seed: int = 0) -> Floats:
    """20 idle scans, then a dome that stays."""
    values = noisy(scans, seed=seed)
    values[20:] += dome(PALM)
    return values


@pytest.mark.parametrize("mode", ["batch", "stream"])
@pytest.mark.parametrize(
    ("unit", "more", "factor"),
    [
        ("Pa", {}, 1.0),
        ("kPa", {}, 1e3),
        ("psi", {}, 6894.757293168),
        ("N/cm2", {}, 1e4),
        ("count", {"scale_pa": 0.5}, 0.5),
        ("count", {}, 1.0),
    ],
)
def test_readings_become_pascal(unit: str, more: dict[str, Any], factor: float, mode: str) -> None:
    pascal = dome(PALM) + noisy(50)
    sensor = grid_sensor(4, 7, unit=unit, **more)
    scans, _ = conditioned(pascal / factor, sensor, mode=mode, tare="none")
    np.testing.assert_allclose(scans.pressure, pascal, rtol=1e-12)
    assert np.median(scans.noise) == pytest.approx(100, rel=0.25)
    assert scans.contact.all()


def test_a_contact_begins_above_one_level_and_ends_below_another() -> None:
    idle = noisy(240)
    session = Conditioner(contact_on=6.0, contact_off=4.0).start(PALM, np.zeros(28, bool), [raw_scans(idle)])
    assert session.baseline is not None
    levels = [0, 5, 5.9, 6.1, 5, 4.1, 3.9, 5, 6.1, 0]
    values = [session.baseline.offset + level * session.baseline.noise for level in levels]
    contact = next(session.step(raw_scans(values))).contact[:, 0]
    assert contact.tolist() == [False, False, False, True, True, True, False, False, True, False]


def test_one_loud_taxel_in_a_pad_that_sums_to_nothing_is_no_contact() -> None:
    session = Conditioner().start(PALM, np.zeros(28, bool), [raw_scans(noisy(240))])
    assert session.baseline is not None
    noise = session.baseline.noise
    value = -noise.copy()
    value[3] = 27 * noise[3]
    contact = next(session.step(raw_scans([value + session.baseline.offset]))).contact
    assert not contact.any()


def test_an_evenly_raised_pad_without_a_peak_is_no_contact() -> None:
    session = Conditioner().start(PALM, np.zeros(28, bool), [raw_scans(noisy(240))])
    assert session.baseline is not None
    value = session.baseline.offset + 3 * session.baseline.noise
    assert not next(session.step(raw_scans([value]))).contact.any()


def test_idle_noise_is_never_taken_for_a_contact() -> None:
    for mode in ("batch", "stream"):
        scans, _ = conditioned(noisy(3000), PALM, mode=mode)
        assert not scans.contact.any()


@pytest.mark.parametrize("scans", range(1, 12))
def test_a_recording_shorter_than_a_window_works_in_both_modes_alike(scans: int) -> None:
    values = dome(PALM) + noisy(scans)
    batch, _ = conditioned(values, PALM, mode="batch")
    stream, _ = conditioned(values, PALM, mode="stream")
    assert len(batch) == len(stream) == scans
    assert batch.contact.all()
    assert stream.contact.all()


@pytest.mark.parametrize("scans", [4, 6, 8, 11])
def test_a_short_recording_does_not_make_its_noise_look_smaller(scans: int) -> None:
    sensor = grid_sensor(10, 20)
    _, session = conditioned(50e3 + noisy(scans, 200), sensor)
    assert session.baseline is not None
    assert 0.5 < np.median(session.baseline.noise) / 100 < 1.5


def test_an_empty_block_gives_an_empty_block_or_none() -> None:
    for mode in ("batch", "stream"):
        off = np.zeros(28, bool)
        session = Conditioner().start(PALM, off, [raw_scans(noisy(30))] if mode == "batch" else None)
        assert sum(len(scans) for scans in session.step(raw_scans(np.zeros((0, 28))))) == 0


def test_a_stream_holds_its_first_12_scans_back_and_then_gives_each_at_once() -> None:
    session = Conditioner().start(PALM, np.zeros(28, bool), None)
    given_out = [
        sum(len(scans) for scans in session.step(piece)) for piece in pieces(raw_scans(grasp(40)), range(1, 40))
    ]
    assert given_out == [0] * 11 + [12] + [1] * 28
    assert list(session.finish()) == []


def stream(values: Floats, cuts: Any = ()) -> list[Scans]:
    session = Conditioner().start(PALM, np.zeros(28, bool), None)
    blocks = [scans for piece in pieces(raw_scans(values), cuts) for scans in session.step(piece)]
    return [*blocks, *session.finish()]


def scan_by_scan(blocks: list[Scans]) -> list[Any]:
    """Every scan with the noise model it came with."""
    return [
        (block.t_s[k], block.pressure[k].tolist(), block.noise.tolist(), block.contact[k, 0], block.complete[k, 0])
        for block in blocks
        for k in range(len(block))
    ]


@pytest.fixture(scope="module")
def gap_and_whole() -> tuple[Floats, list[Any]]:
    """A grasp (160, taxels) with a taxel that is missing for a while, and its stream in one block."""
    values = grasp(160)
    values[50:60, 12] = np.nan
    return values, scan_by_scan(stream(values))


@pytest.mark.long
@settings(max_examples=15)
@given(cuts=st.lists(st.integers(0, 160), max_size=20))
def test_a_stream_does_not_depend_on_how_it_is_cut(gap_and_whole: tuple[Floats, list[Any]], cuts: list[int]) -> None:
    values, whole = gap_and_whole
    assert scan_by_scan(stream(values, cuts)) == whole


@pytest.mark.parametrize("cuts", [(), (45, 52), range(1, 400)], ids=["one block", "three blocks", "single scans"])
def test_an_offset_found_late_makes_one_scan_incomplete(cuts: Any) -> None:
    """The pad is loaded at first; its offset is found when it is idle. The scan that first uses it is no motion."""
    values = 2000.0 + noisy(400)
    values[:40] += dome(PALM)
    values[300:] += dome(PALM)
    blocks = scan_by_scan(stream(values, cuts))
    assert len(blocks) == 400
    (found,) = [k for k, (*_, complete) in enumerate(blocks) if not complete]
    before, after = (np.mean(blocks[k][1]) for k in (found - 1, found))
    assert found > 40
    assert before - after == pytest.approx(2000, abs=150)


def test_a_stream_of_single_scans_is_that_of_one_block() -> None:
    values = grasp(500)
    assert scan_by_scan(stream(values, range(500))) == scan_by_scan(stream(values))


@pytest.mark.long
@settings(max_examples=15)
@given(cuts=st.lists(st.integers(0, 100), max_size=10))
def test_a_batch_does_not_depend_on_how_it_is_cut(cuts: list[int]) -> None:
    values = grasp(100)
    assert_same(conditioned(values, PALM, cuts=cuts)[0], conditioned(values, PALM)[0])


@pytest.mark.parametrize("known", [12, 13, 40, 200])
def test_a_stream_is_causal_after_what_it_holds_back(known: int) -> None:
    values, other = grasp(300), grasp(300)
    other[known:] = 5 * noisy(300 - known, seed=9) + 3000
    assert scan_by_scan(stream(values))[:known] == scan_by_scan(stream(other))[:known]


def test_a_stream_learns_the_noise_of_loaded_taxels_as_it_goes() -> None:
    load = np.where(np.arange(1200) < 100, -1000.0, 2000.0)[:, np.newaxis]
    values = np.maximum(np.round(load + noisy(1200, sigma=5.0)), 0)
    blocks = stream(values)
    assert np.median(blocks[0].noise) == pytest.approx(1e-4 * 140e3)  # nothing is known yet but the range
    assert np.median(blocks[-1].noise) == pytest.approx(5, rel=0.3)


@pytest.mark.parametrize("full_scale", [None, 140e3])
def test_a_stream_that_was_idle_for_long_at_0_learns_its_noise_once_something_touches(full_scale: float | None) -> None:
    values = np.zeros((600, 28))
    values[400:] = np.maximum(dome(PALM) + noisy(200) - 500.0, 0.0)
    sensor = grid_sensor(4, 7, full_scale=full_scale)
    session, noise = Conditioner().start(sensor, np.zeros(28, bool), None), 0.0
    for scan in range(450):
        block = raw_scans(values[scan : scan + 1], np.array([0.01 * scan]))
        noise = max((float(np.median(scans.noise)) for scans in session.step(block)), default=0.0)
        assert scan >= 400 or noise < 20
    assert noise == pytest.approx(100, rel=0.5)


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_a_missing_taxel_that_was_idle_changes_nothing_for_its_pad(mode: str) -> None:
    values = np.maximum(np.round(grasp() / 50), 0)
    values[:, 0] = 0
    broken = values.copy()
    broken[40:60:3, 0] = np.nan
    sensor = grid_sensor(4, 7, full_scale=4095.0, unit="count")
    whole, partial = (conditioned(array, sensor, mode=mode)[0] for array in (values, broken))
    assert_same(whole, partial)
    assert partial.complete.all()


@pytest.mark.parametrize("mode", ["batch", "stream"])
@pytest.mark.parametrize("missing", [np.nan, np.inf, -np.inf])
def test_a_missing_loaded_taxel_makes_that_pads_scan_incomplete_and_no_others(mode: str, missing: float) -> None:
    values = dome(TWO) + dome(TWO, pad=1) + noisy(100, 56)
    loaded = int(np.argmax(dome(TWO)))
    values[50:53, loaded] = missing
    scans, _ = conditioned(values, TWO, mode=mode)
    assert np.flatnonzero(~scans.complete[:, 0]).tolist() == [50, 51, 52]
    assert scans.complete[:, 1].all()
    assert np.isfinite(scans.pressure).all()
    assert (scans.pressure[50:53, loaded] == 0).all()


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_a_pad_without_any_reading_stays_in_contact_or_idle(mode: str) -> None:
    values = noisy(160, 56)
    values[40:120] += dome(TWO)
    slower = np.arange(160) % 4 != 0
    values[slower, :28] = np.nan  # a pad that is read every fourth time
    values[100:110, 28:] = np.nan
    scans, _ = conditioned(values, TWO, mode=mode)
    assert np.flatnonzero(scans.contact[:, 0]).tolist() == list(range(40, 120))
    assert np.flatnonzero(scans.complete[40:120, 0]).tolist() == list(range(0, 80, 4))
    assert not scans.contact[:, 1].any()


def test_a_missing_loaded_taxel_stays_loaded_until_it_is_heard_again() -> None:
    values = grasp()
    loaded = int(np.argmax(dome(PALM)))
    values[40:60, loaded] = np.nan
    values[60:, loaded] = 0
    values[70:, loaded] = np.nan
    scans, _ = conditioned(values, PALM)
    incomplete = np.flatnonzero(~scans.complete[:, 0])
    assert incomplete.tolist() == list(range(40, 60))


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_a_taxel_declared_off_reads_zero_and_has_no_noise(mode: str) -> None:
    masked = np.arange(28) == 5
    values = dome(PALM) + noisy(50)
    values[:, 5] = 1e6
    scans, session = conditioned(values, PALM, mode=mode, masked=masked)
    assert (scans.pressure[:, 5] == 0).all()
    assert (scans.noise == 0).tolist() == masked.tolist()
    assert session.baseline is not None
    assert session.baseline.masked.tolist() == masked.tolist()
    assert scans.complete.all()


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_a_taxel_never_heard_from_is_masked(mode: str) -> None:
    values = dome(PALM) + noisy(50)
    values[:, 5] = np.nan
    scans, _ = conditioned(values, PALM, mode=mode)
    assert np.flatnonzero(scans.noise == 0).tolist() == [5]
    assert scans.complete.all()
    assert scans.contact.all()


@pytest.mark.parametrize("mode", ["batch", "stream"])
@pytest.mark.parametrize("missing", [np.nan, np.inf])
def test_a_pad_without_any_reading_is_never_in_contact(mode: str, missing: float) -> None:
    values = dome(TWO, pad=1) + noisy(50, 56)
    values[:, :28] = missing
    scans, _ = conditioned(values, TWO, mode=mode)
    assert not scans.contact[:, 0].any()
    assert scans.contact[:, 1].all()
    assert np.isfinite(scans.pressure).all()


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_a_scan_without_any_reading_is_no_contact_in_that_scan_alone(mode: str) -> None:
    values = dome(PALM) + noisy(50)
    values[30] = np.nan
    scans, _ = conditioned(values, PALM, mode=mode)
    assert np.flatnonzero(~(scans.contact & scans.complete)).tolist() == [30]


@pytest.mark.parametrize("mode", ["batch", "stream"])
@pytest.mark.parametrize("wild", [1e7, -1e7])
def test_a_glitch_of_one_reading_does_not_spoil_the_others(mode: str, wild: float) -> None:
    values = grasp()
    values[60, 3] = wild
    scans, _ = conditioned(values, PALM, mode=mode)
    assert scans.contact[21:60, 0].all()
    assert scans.contact[61:, 0].all()


@pytest.mark.parametrize("mode", ["batch", "stream"])
@pytest.mark.parametrize("wild", [1e30, -1e30, 1e200, 1.7e308, -1.7e308])
def test_an_absurd_reading_does_no_arithmetic_harm(mode: str, wild: float) -> None:
    values = grasp()
    values[60, 3] = wild
    scans, _ = conditioned(values, grid_sensor(4, 7, unit="kPa"), mode=mode)
    assert np.isfinite(scans.pressure).all()
    assert np.isfinite(scans.noise).all()


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_readings_of_all_zeros_are_no_contact(mode: str) -> None:
    scans, _ = conditioned(np.zeros((50, 28)), PALM, mode=mode)
    assert not scans.contact.any()
    assert (scans.pressure == 0).all()


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_negative_readings_are_no_contact(mode: str) -> None:
    scans, _ = conditioned(-dome(PALM) + noisy(50), PALM, mode=mode, tare="none")
    assert not scans.contact.any()


def test_times_pass_through_as_they_are() -> None:
    t_s = np.cumsum(np.random.default_rng(0).uniform(0.01, 0.3, 50))
    scans, _ = conditioned(grasp(50), PALM, t_s=t_s)
    np.testing.assert_array_equal(scans.t_s, t_s)


def test_the_raw_scans_are_not_written_to() -> None:
    values = grasp()
    raw = raw_scans(values.copy())
    session = Conditioner().start(PALM, np.zeros(28, bool), [raw])
    joined(list(session.step(raw)))
    np.testing.assert_array_equal(raw.values, values)
