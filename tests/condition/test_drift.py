from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from costly import mostly_long
from synthetic import assert_same, conditioned, dome, grid_sensor, raw_scans
from taxelflow.condition.parameters import Conditioner
from taxelflow.sensors.pads import Group, Patch

if TYPE_CHECKING:
    from taxelflow.messages import Floats

PALM = grid_sensor(4, 7, full_scale=140e3)
TWO = grid_sensor(4, 7, pads=2, full_scale=140e3)
both_modes = pytest.mark.parametrize("mode", ["batch", "stream"])


def noisy(scans: int, taxels: int = 28) -> Floats:
    drawn: Floats = np.random.default_rng(0).normal(0, 100, (scans, taxels))
    return drawn


def creeping(scans: int, to_pa: float, taxels: int = 28) -> Floats:
    return np.linspace(0, to_pa, scans)[:, np.newaxis] * np.ones(taxels)  # type: ignore[no-any-return]


def tared_at_start(values: Floats, mode: str, **more: str) -> Floats:
    return conditioned(values, PALM, mode=mode, tare="start", **more)[0].pressure


@pytest.mark.parametrize("mode", mostly_long(["batch", "stream"], "batch"))
def test_an_idle_pads_drift_is_followed(mode: str) -> None:
    values = noisy(6000) + creeping(6000, 1500.0)
    kept, followed = (tared_at_start(values, mode, drift=how) for how in ("keep", "follow"))
    assert kept[-500:].mean() > 1300
    assert abs(followed[-500:].mean()) < 80  # as far behind as a spell and what it takes up
    scans, _ = conditioned(values, PALM, mode=mode, tare="start", drift="follow")
    assert not scans.contact.any()


@both_modes
def test_taxels_may_drift_apart(mode: str) -> None:
    ends = np.random.default_rng(3).normal(0, 300, 28)
    values = noisy(6000) + np.linspace(0, 1, 6000)[:, np.newaxis] * ends
    assert np.abs(tared_at_start(values, mode, drift="follow")[-500:].mean(axis=0)).max() < 120


@pytest.mark.long
@both_modes
def test_an_hours_contact_stays(mode: str) -> None:
    """At 10 Hz, with a pad that drifts under it by as much as a light contact weighs."""
    hour = 36_000
    values = noisy(hour + 200)
    values[100:-100] += dome(PALM, peak=3000.0)
    followed, _ = conditioned(values, PALM, mode=mode, drift="follow")
    kept, _ = conditioned(values, PALM, mode=mode)
    assert followed.contact[150:-150].all()
    last = slice(hour - 1000, hour)
    np.testing.assert_allclose(followed.pressure[last].mean(axis=0), kept.pressure[last].mean(axis=0), atol=70)


@pytest.mark.parametrize("mode", mostly_long(["batch", "stream"], "batch"))
@pytest.mark.parametrize("peak", mostly_long([300.0, 500.0], 300.0))
def test_a_contact_too_light_to_count_is_not_taken_for_a_drift(mode: str, peak: float) -> None:
    values = noisy(8000)
    values[500:] += dome(PALM, peak=peak)
    kept, followed = (tared_at_start(values, mode, drift=how)[-1000:].mean(axis=0) for how in ("keep", "follow"))
    assert np.abs(kept - followed).max() < 90  # of which the tare, from 12 scans with a noise of 100, explains most


@both_modes
def test_a_contact_that_grows_slowly_is_not_taken_for_a_drift(mode: str) -> None:
    values = noisy(8000) + np.linspace(0, 1, 8000)[:, np.newaxis] * dome(PALM, peak=2000.0)
    followed = tared_at_start(values, mode, drift="follow")
    assert followed[-500:].mean(axis=0).max() > 1500


def test_a_pad_never_tared_keeps_its_readings() -> None:
    values = noisy(3000) + dome(PALM, peak=40e3)
    scans, session = conditioned(values, PALM, drift="follow")
    assert session.baseline is not None
    assert not session.baseline.tared.any()
    np.testing.assert_array_equal(scans.pressure, values)


@both_modes
def test_what_comes_suddenly_is_no_drift(mode: str) -> None:
    values = noisy(3000)
    values[1000:] += 250.0  # on all taxels alike, and too little for a contact
    scans = tared_at_start(values, mode, drift="follow")
    assert scans[-500:].mean() > 200


def test_one_pads_contact_does_not_stop_another_from_following() -> None:
    values = noisy(6000, 56) + np.concatenate([np.zeros((6000, 28)), creeping(6000, 1500.0)], axis=1)
    values[200:, :28] += dome(PALM)
    scans, _ = conditioned(values, TWO, tare="start", drift="follow")
    assert abs(scans.pressure[-500:, 28:].mean()) < 80
    assert scans.contact[300:, 0].all()


def test_a_group_in_contact_stops_only_the_pads_it_takes_taxels_from() -> None:
    whole = Group("both", (Patch("pad0"), Patch("pad1")))
    for patches, followed in (((whole,), False), ((Group("left", (Patch("pad0"),)),), True)):
        sensor = grid_sensor(4, 7, pads=2, full_scale=140e3, groups=patches)
        values = noisy(6000, 56) + np.concatenate([np.zeros((6000, 28)), creeping(6000, 1500.0)], axis=1)
        values[200:, :28] += dome(PALM)
        scans, _ = conditioned(values, sensor, tare="start", drift="follow")
        assert bool(abs(scans.pressure[-500:, 28:56].mean()) < 80) == followed


def test_a_stream_does_not_depend_on_how_it_is_cut() -> None:
    values = noisy(700) + creeping(700, 500.0)
    one, _ = conditioned(values, PALM, mode="stream", drift="follow")
    other, _ = conditioned(values, PALM, mode="stream", drift="follow", cuts=range(0, 700, 13))
    np.testing.assert_array_equal(one.pressure, other.pressure)
    np.testing.assert_array_equal(one.contact, other.contact)


def test_batches_do_not_depend_on_blocks() -> None:
    values = noisy(700) + creeping(700, 500.0)
    one, _ = conditioned(values, PALM, drift="follow")
    other, _ = conditioned(values, PALM, drift="follow", cuts=[64, 65, 300])
    assert_same(one, other)


def test_the_ceiling_drifts_with_the_offset() -> None:
    values = noisy(6000) + creeping(6000, 1500.0)
    session = Conditioner(tare="start", drift="follow").start(PALM, np.zeros(28, bool), [raw_scans(values)])
    blocks = list(session.step(raw_scans(values)))
    assert blocks[0].ceiling.mean() - blocks[-1].ceiling.mean() == pytest.approx(1430, abs=60)
