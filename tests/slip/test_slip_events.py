from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sliding import RATE_HZ, kinds, slid, slips_of
from synthetic import pieces
from taxelflow.messages import LOST, Event
from taxelflow.pipeline import api
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import simulate
from taxelflow.slip.slip_events import SlipEvents

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Slips

VELOCITY = (0.02, 0.0, 0.3)
START = Event(1.01, "pad", "slip_start", 1.0, speed_m_s=0.015)
STOP = Event(2.01, "pad", "slip_stop", 2.0)


def slipping(slips: Slips, begin: int = 101, end: int = 201) -> Bools:
    """(scans, 1)."""
    scan = np.round(slips.t_s * RATE_HZ)
    return ((scan >= begin) & (scan < end))[:, np.newaxis]


def completed(*blocks: Slips, events: tuple[Event, ...] = (START, STOP), stream: bool = False) -> list[list[Event]]:
    """Events that are given with each block, and at the end."""
    session = SlipEvents(("pad",), stream=stream)
    found = []
    for block in blocks:
        own = [event for event in events if (np.abs(block.t_s - event.t_s) < 1e-9).any()]
        found.append(session.step(block, slipping(block), own))
    return [*found, session.finish()]


def test_begin_and_end_carry_the_motion_of_the_whole_slip() -> None:
    start, stop = completed(slips_of(slid(VELOCITY)))[0]
    for event in (start, stop):
        assert event.speed_m_s == pytest.approx(0.02, abs=4 * event.std_speed_m_s)
        assert event.turn_rad_s == pytest.approx(0.3, rel=0.02)
        assert event.path_m == pytest.approx(0.02, abs=4 * event.std_path_m)
        assert event.turn_rad == pytest.approx(0.3, rel=0.02)
        assert event.duration_s == pytest.approx(1.0)
        assert 0 < event.std_duration_s < 0.02
    assert start.speed_m_s == stop.speed_m_s
    assert (start.t_s, start.onset_s, stop.t_s, stop.onset_s) == (1.01, 1.0, 2.01, 2.0)


def test_events_wait_for_the_end_of_a_slip_that_began_before() -> None:
    touch = Event(1.5, "pad", "contact")
    whole = slips_of(slid(VELOCITY))
    first, second, last = completed(*pieces(whole, [160]), events=(START, touch, STOP))
    assert (kinds(first), kinds(second), kinds(last)) == ([], ["slip_start", "contact", "slip_stop"], [])


def test_a_stream_gives_each_event_at_once() -> None:
    first, second, last = completed(*pieces(slips_of(slid(VELOCITY)), [160]), stream=True)
    assert (first, last) == ([START], [])
    assert second[0].path_m == pytest.approx(0.02, rel=0.02)


@pytest.mark.parametrize("report_s", [1.02, 1.03])
def test_a_brief_slip_that_a_stream_reports_late_has_the_motion_that_the_detector_saw(report_s: float) -> None:
    """A jump of one scan is reported when it is over: the scans since then show nothing of it."""
    pose = np.zeros((300, 3))
    pose[101:, 1] = 0.003
    start = Event(report_s, "pad", "slip_start", 1.0, np.pi / 2, 0.0029 / (report_s - 1.0))
    events = start, Event(report_s + 0.01, "pad", "slip_stop", 1.02)
    found = [event for given in completed(slips_of(pose), events=events, stream=True) for event in given]
    stop = found[-1]
    assert stop.path_m == pytest.approx(0.003, rel=0.4)
    assert stop.std_path_m == pytest.approx(stop.path_m, rel=0.1)
    assert stop.direction_rad == pytest.approx(np.pi / 2)


def test_a_slip_whose_stop_was_withdrawn_ends_with_its_whole_path() -> None:
    pose = slid(VELOCITY)
    pose[170:, 0] += np.minimum(np.arange(130), 30) / RATE_HZ * 0.04  # the last 0.3 s are three times as fast
    events = START, Event(1.71, "pad", "slip_stop", 1.7), replace(START, t_s=1.73), STOP
    found = [event for given in completed(slips_of(pose), events=events, stream=True) for event in given]
    assert kinds(found) == ["slip_start", "slip_stop"] * 2
    assert found[1].path_m == pytest.approx(0.014, rel=0.02)
    assert (found[-1].path_m, found[-1].duration_s) == pytest.approx((0.032, 1.0), rel=0.02)


def test_a_slip_that_goes_on_ends_with_the_recording() -> None:
    (_, (start,)) = completed(slips_of(slid(VELOCITY)), events=(START,))
    assert start.duration_s == pytest.approx(1.0)
    assert start.path_m == pytest.approx(0.02, rel=0.03)


@given(cuts=st.lists(st.integers(0, 2500), max_size=6))
@settings(max_examples=15)
def test_a_long_slip_does_not_depend_on_how_scans_are_cut(cuts: list[int]) -> None:
    slips = slips_of(slid((0.002, 0.001, 0.0), scans=2600, end=2400))
    flags = slipping(slips, 101, 2401)
    stop = Event(24.01, "pad", "slip_stop", 24.0)
    found = []
    for cutting in (cuts, []):
        session = SlipEvents(("pad",), stream=False)
        events: list[Event] = []
        done = 0
        for block in pieces(slips, cutting):
            own = [event for event in (START, stop) if (np.abs(block.t_s - event.t_s) < 1e-9).any()]
            events += session.step(block, flags[done : done + len(block)], own)
            done += len(block)
        found.append(events)
    assert found[0] == found[1]
    assert found[0][0].speed_m_s == pytest.approx(np.hypot(0.002, 0.001), rel=0.01)


def test_a_method_that_lost_its_pose_sums_displacements() -> None:
    slips = slips_of(slid(VELOCITY))
    slips.pose[150:] += 1.0
    slips.displacement[150] = np.nan
    slips.quality[150] = LOST
    start, _ = completed(slips)[0]
    assert start.path_m < 0.1


def test_a_method_without_displacement_gives_the_duration() -> None:
    slips = slips_of(slid(VELOCITY))
    slips.pose[:] = slips.displacement[:] = np.nan
    start, stop = completed(slips)[0]
    assert start.duration_s == stop.duration_s == 1.0
    assert (start.speed_m_s, np.isnan(start.path_m)) == (0.015, True)


@pytest.mark.long
def test_the_demos_slips_have_the_speed_of_the_truth_and_are_counted_once() -> None:
    result = api.estimate(simulate(SCENARIOS["stroke"]), "template")
    own = [event for event in result.events if event.event in ("slip_start", "slip_stop") and event.pad == "palm"]
    assert kinds(own) == ["slip_start", "slip_stop"] * 2
    for start, stop in zip(own[::2], own[1::2], strict=True):
        assert start.speed_m_s == stop.speed_m_s == pytest.approx(0.025, rel=0.05)
        assert abs(stop.speed_m_s - 0.025) < 4 * stop.std_speed_m_s
        assert stop.path_m == pytest.approx(0.025 * (stop.onset_s - start.onset_s), rel=0.01)
    assert result.summary.events["slip_start"] == 2
    on_palm = [contact for contact in result.summary.contacts if contact.pad == "palm"]
    assert [contact.slips for contact in on_palm] == [1, 1]
    assert all(contact.speed_m_s == pytest.approx(0.025, rel=0.05) for contact in on_palm)


@pytest.mark.parametrize("cuts", [[], [150], [151]])
def test_no_slip_is_faster_than_its_displacement_over_a_scan(cuts: list[int]) -> None:
    """Dates of a slip of one scan, however close, do not say how long it took; blocks may end anywhere."""
    slips = slips_of(slid(VELOCITY))
    start, stop = replace(START, t_s=1.5, onset_s=1.4999), replace(STOP, t_s=1.51, onset_s=1.5001)
    session = SlipEvents(("pad",), stream=False)
    found = []
    for block in pieces(slips, cuts) if cuts else [slips]:
        own = [event for event in (start, stop) if (np.abs(block.t_s - event.t_s) < 1e-9).any()]
        found += session.step(block, slipping(block, 150, 151), own)
    events = [*found, *session.finish()]
    assert kinds(events) == ["slip_start", "slip_stop"]
    for event in events:
        assert event.duration_s == pytest.approx(1 / RATE_HZ)
        assert event.speed_m_s < 3 * VELOCITY[0]
