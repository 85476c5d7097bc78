from __future__ import annotations

import numpy as np

from taxelflow.publish.view.history import History
from taxelflow.sensors.catalogue import load_sensor
from viewed import RATE_HZ, slips_of, viewed

SENSOR = load_sensor("schunk-sdh2")


def test_a_snapshot_is_of_the_last_scan_up_to_a_time() -> None:
    history = viewed(SENSOR, "finger1_proximal", 0.0)
    found = history.at(11.52)
    assert found is not None
    assert found.t_s == 11.5
    assert found.results is not None
    assert found.results.slipping.any()
    assert history.at(9.9) is None


def test_pressure_is_known_before_results() -> None:
    history = History()
    history.see(np.array([0.0, 0.1]), np.ones((2, SENSOR.layout.taxels)))
    found = history.at(0.1)
    assert found is not None
    assert found.results is None
    assert found.pressure.sum() == SENSOR.layout.taxels


def test_what_is_old_is_forgotten_and_memory_stays_flat() -> None:
    history = History(keep_s=1.0)
    for second in range(30):
        t_s = second + np.arange(20) / RATE_HZ
        history.see(t_s, np.zeros((20, SENSOR.layout.taxels)))
        history.add(slips_of(SENSOR.layout, t_s, 0, 0.0, np.zeros(20)), [])
        assert len(history.times) <= 60
        known = history.within(-np.inf, np.inf)
        assert known is not None
        assert len(known.slips) <= 60
    assert history.at(29.5) is not None


def test_scans_that_come_one_by_one_are_found_as_if_they_came_at_once() -> None:
    whole, single = viewed(SENSOR, "finger1_proximal", 0.0, scans=600), History()
    known = whole.within(-np.inf, np.inf)
    assert known is not None
    for scan, at_s in enumerate(whole.times):
        found = whole.at(float(at_s))
        assert found is not None
        assert found.results is not None
        single.see(np.array([at_s]), found.pressure[np.newaxis])
        single.add(found.results, [])
        if scan % 7 == 0:  # it is read while it grows
            assert single.at(float(at_s)) is not None
    again = single.within(12.0, 30.0)
    part = whole.within(12.0, 30.0)
    assert again is not None
    assert part is not None
    assert np.array_equal(again.slips.t_s, part.slips.t_s)
    assert np.array_equal(again.slipping, part.slipping)
    assert np.array_equal(single.times, whole.times)
    assert np.isclose(single.strongest(), whole.strongest())
