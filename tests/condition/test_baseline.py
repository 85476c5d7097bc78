from __future__ import annotations

import numpy as np
import pytest

from synthetic import dome, grid_sensor
from taxelflow.condition.baseline import Baseline, estimate_baseline, update_baseline, with_masked
from taxelflow.condition.parameters import Conditioner
from taxelflow.condition.sample import Sample
from taxelflow.messages import Bools, Floats
from taxelflow.sensors.sensor import Sensor

PALM = grid_sensor(4, 7)
NONE = np.zeros(28, dtype=np.bool_)


def noisy(scans: int = 240, sigma: float = 100.0) -> Floats:
    drawn: Floats = np.random.default_rng(0).normal(0, sigma, (scans, 28))
    return drawn


def sample_of(values: Floats) -> Sample:
    sample = Sample(values.shape[1])
    sample.add(np.arange(len(values)) / 10, values)
    sample.close()
    return sample


def baseline(
    values: Floats, *, sensor: Sensor = PALM, masked: Bools = NONE, causal: bool = False, **parameters: str
) -> Baseline:
    return estimate_baseline(Conditioner(**parameters), sensor, sample_of(values), masked, causal=causal)  # type: ignore[arg-type]


def test_offset_and_noise_are_those_of_idle_scans() -> None:
    found = baseline(noisy() + np.where(np.arange(240) < 120, 0.0, 1.0)[:, np.newaxis] * dome(PALM) + 1000.0)
    assert found.tared.all()
    np.testing.assert_allclose(found.offset, 1000.0, atol=50)
    np.testing.assert_allclose(found.noise, 100.0, rtol=0.4)


def test_without_idle_scans_there_is_no_offset() -> None:
    found = baseline(noisy() + dome(PALM))
    assert not found.tared.any()
    assert not found.offset.any()


def test_a_stream_is_tared_whether_or_not_a_full_scale_is_declared() -> None:
    values = noisy() + 1000.0
    values[120:] += dome(PALM)
    assert baseline(values).tared.all()
    for sensor in (PALM, grid_sensor(4, 7, full_scale=140e3)):
        found = baseline(values[:12], sensor=sensor, causal=True)
        assert found.known.all()
        np.testing.assert_allclose(found.offset, 1000.0, atol=6 * 100 / 12**0.5)


def test_a_stream_against_a_full_scale_takes_no_large_offset_away() -> None:
    values = noisy()[:12] + 20e3
    assert baseline(values, causal=True).tared.all()
    assert not baseline(values, sensor=grid_sensor(4, 7, full_scale=140e3), causal=True).tared.any()


@pytest.mark.parametrize(("tare", "offset"), [("none", 0.0), ("start", 5000.0)])
def test_the_tare_may_be_declared(tare: str, offset: float) -> None:
    values = noisy(sigma=10.0)
    values[:12] += 5000.0
    np.testing.assert_allclose(baseline(values, tare=tare).offset, offset, atol=15)


def test_taxels_declared_off_or_without_readings_are_masked() -> None:
    values = noisy()
    values[:, 7] = np.nan
    found = baseline(values, masked=with_masked(NONE, [3]))
    assert np.flatnonzero(found.masked).tolist() == [3, 7]
    assert not found.noise[[3, 7]].any()
    assert [(finding.taxel, finding.fault) for finding in found.findings] == [(7, "silent")]


def test_with_more_scans_noise_and_faults_are_updated_and_the_tare_stays() -> None:
    first = baseline(noisy(12) + 100.0, tare="start")
    later = update_baseline(Conditioner(), PALM, sample_of(noisy(600, sigma=300.0) + 900.0), first)
    assert later.offset is first.offset
    assert later.tared is first.tared
    np.testing.assert_allclose(later.noise, 300.0, rtol=0.4)


def test_a_mask_is_a_copy() -> None:
    more = with_masked(NONE, [1])
    assert more.sum() == 1
    assert not NONE.any()


def test_a_silent_taxel_of_a_stream_has_one_finding_however_often_it_is_judged() -> None:
    values = noisy()
    values[:, 3] = np.nan
    found = baseline(values[:12], causal=True)
    for scans in (24, 48, 96):
        found = update_baseline(Conditioner(), PALM, sample_of(values[:scans]), found)
    assert [(one.taxel, one.fault, one.scans) for one in found.findings] == [(3, "silent", 96)]
