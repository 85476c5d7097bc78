from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from sliding import slips_of
from taxelflow.messages import Event, cut
from taxelflow.publish.contact_summary import ContactTotals

PITCH_M = np.array([[0.004, 0.004]])
MOTION = {"path_m": 0.01, "std_path_m": 3e-4, "speed_m_s": 0.02, "std_speed_m_s": 1e-3, "duration_s": 0.5}
START, STOP = Event(0.3, "pad", "slip_start", 0.3, **MOTION), Event(0.8, "pad", "slip_stop", 0.8, **MOTION)
LATER = replace(START, t_s=2.1, onset_s=2.1, path_m=0.02, duration_s=0.5, speed_m_s=0.04)


def totals(*cuts: int, events: tuple[Event, ...] = (START, STOP, LATER)) -> ContactTotals:
    """Two contacts, 0 to 1 s and 2 to 3 s."""
    slips = slips_of(np.linspace(0, 1, 300)[:, np.newaxis] * [0.03, 0.0, 0.0])
    slips.contact[100:200] = False
    slips.displacement[100:201] = np.nan
    found = ContactTotals(("pad",), PITCH_M)
    ends = [0, *cuts, 300]
    for start, stop in itertools.pairwise(ends):
        found.add(cut(slips, start, stop), [])
    found.add(cut(slips, 300, 300), list(events))
    return found


@pytest.mark.parametrize("cuts", [(), (50, 100, 150, 201)], ids=["whole", "cut"])
def test_each_contact_has_its_own_slips(cuts: tuple[int, ...]) -> None:
    first, second = totals(*cuts).contacts()
    assert (first.t_s, first.duration_s, first.slips) == (0.0, 1.0, 1)
    assert (first.path_m, first.speed_m_s, first.std_speed_m_s) == pytest.approx((0.01, 0.02, 1e-3))
    assert (second.t_s, second.slips, second.path_m) == (2.0, 1, 0.02)
    assert second.duration_s == pytest.approx(0.99)
    assert first.net_m[0] == pytest.approx(0.03 * 99 / 299)
    assert first.turn_rad is None


def test_net_displacements_are_the_same_bits_however_the_scans_are_cut() -> None:
    slips = slips_of(np.cumsum(np.random.default_rng(0).normal(0.0, 1e-4, (300, 3)), axis=0))
    whole, parts = ContactTotals(("pad",), PITCH_M), ContactTotals(("pad",), PITCH_M)
    whole.add(slips, [])
    for start, stop in itertools.pairwise([0, 1, 50, 137, 300]):
        parts.add(cut(slips, start, stop), [])
    assert [one.net_m for one in parts.contacts()] == [one.net_m for one in whole.contacts()]


def test_speed_is_the_path_over_the_time_of_all_slips() -> None:
    again = replace(STOP, t_s=0.9, onset_s=0.9, path_m=0.02, duration_s=0.1, speed_m_s=0.2, std_path_m=4e-4)
    (first, _) = totals(events=(START, STOP, replace(START, onset_s=0.8), again)).contacts()
    assert (first.slips, first.slip_s) == (2, pytest.approx(0.6))
    assert (first.path_m, first.std_path_m, first.speed_m_s) == pytest.approx((0.03, 5e-4, 0.05))


def test_a_slip_whose_stop_was_withdrawn_counts_once() -> None:
    on = replace(START, t_s=0.85, onset_s=0.29)  # as of its pose; at first its pattern had not consented
    stop = replace(STOP, t_s=0.95, onset_s=0.95, path_m=0.013, duration_s=0.65)
    (first, _) = totals(events=(START, STOP, on, stop)).contacts()
    assert (first.slips, first.path_m, first.slip_s) == pytest.approx((1, 0.013, 0.65))


def test_a_contact_without_slip_has_gone_no_way() -> None:
    first, second = totals(events=()).contacts()
    assert (first.slips, first.path_m, first.speed_m_s) == (0, 0, None)
    assert second.slip_s == 0


def test_slips_without_a_path_have_no_speed() -> None:
    (first, _) = totals(events=(Event(0.3, "pad", "slip_start", 0.3, duration_s=0.2),)).contacts()
    assert (first.slips, first.path_m, first.speed_m_s) == (1, None, None)
