"""The verdict on slips: of poses that are not `ok`, and of groups, which have a part of their pad's contact."""

from __future__ import annotations

import numpy as np
import pytest

from taxelflow.messages import AMBIGUOUS, OK, UNRESOLVED, Event, Slips
from taxelflow.sensors.pads import Group, Pad, Patch
from taxelflow.sensors.sensor import Sensor, with_contacts
from taxelflow.slip.decision import find_vague
from taxelflow.slip.odds import AGAINST, Odds
from taxelflow.slip.verdict import Posed, Verdict, pads_of_groups

PALM = Pad("palm", rows=4, cols=4, pitch_m=(0.004, 0.004))
THUMB = Pad("thumb", rows=2, cols=2, pitch_m=(0.004, 0.004))
HAND = Sensor(
    "hand",
    "Pa",
    (PALM, THUMB),
    groups=(
        Group("left", (Patch("palm", cols=(0, 2)),)),
        Group("all", (Patch("palm"),)),
    ),
)
SCANS = 6


def test_a_group_has_a_part_of_one_pad() -> None:
    assert dict(zip(HAND.layout.pads, pads_of_groups(HAND.layout).tolist(), strict=True)) == {
        "palm": -1,
        "thumb": -1,
        "left": 0,
        "all": -1,
    }


def test_a_group_does_not_slip_while_the_whole_contact_surely_rests() -> None:
    slipping, events = judged(palm=False, quality=OK)
    assert not slipping.any()
    assert [(event.pad, event.event) for event in events] == [("left", "slip_suspected")]


@pytest.mark.parametrize(("palm", "quality"), [(True, OK), (False, AMBIGUOUS)])
def test_it_slips_where_its_pad_does_or_is_not_sure(palm: bool, quality: int) -> None:
    slipping, events = judged(palm=palm, quality=quality)
    assert slipping[2:5, HAND.layout.pads.index("left")].all()
    assert ("left", "slip_start") in [(event.pad, event.event) for event in events]


def test_a_pad_with_separate_contacts_is_no_witness() -> None:
    sensor = with_contacts(HAND, {"palm": 2})
    slipping, events = judged(palm=False, quality=OK, sensor=sensor)
    assert slipping[2:5, sensor.layout.pads.index("left")].all()
    assert ("left", "slip_start") in [(event.pad, event.event) for event in events]


@pytest.mark.parametrize("quality", [AMBIGUOUS, UNRESOLVED])
def test_a_slip_that_its_pattern_speaks_against_is_suspected_unless_the_pose_is_ok(quality: int) -> None:
    slipping, events = of_palm([quality] * SCANS, [-9.0] * SCANS)
    assert not slipping.any()
    assert [(event.event, event.onset_s) for event in events] == [("slip_suspected", 0.02)]
    slipping, events = of_palm([OK] * SCANS, [-9.0] * SCANS)
    assert slipping.tolist() == [False, False, True, True, True, False]
    assert [event.event for event in events] == ["slip_start", "slip_stop"]


def test_a_suspected_slip_is_reported_again_while_its_pose_moves_on() -> None:
    _, events = of_palm([AMBIGUOUS] * SCANS, [-9.0] * SCANS, step_m=0.0006, scan_s=1.0)  # a quarter of a pitch in 2 s
    assert [(event.event, event.t_s, event.onset_s) for event in events] == [
        ("slip_suspected", 2.0, 2.0),
        ("slip_suspected", 4.0, 2.0),
    ]


def test_what_is_left_of_a_slip_that_the_odds_have_ended_is_suspected() -> None:
    odds = [9.0, 9.0, 9.0, -9.0, -9.0, -9.0]
    slipping, events = of_palm([OK] * SCANS, odds, step_m=0.0011, restless=True, scan_s=1.0)
    assert slipping.tolist() == [True, True, True, False, False, False]
    last = [(event.event, event.t_s, event.onset_s) for event in events[-2:]]
    assert last == [("slip_stop", 3.0, 3.0), ("slip_suspected", 4.0, 3.0)]


def test_it_begins_when_the_pattern_no_longer_does_and_is_dated_by_its_pose() -> None:
    slipping, events = of_palm([AMBIGUOUS] * SCANS, [-9.0, -9.0, -9.0, AGAINST + 0.1, -9.0, -9.0])
    assert slipping.tolist() == [False, False, False, True, True, False]
    assert [event.event for event in events] == ["slip_suspected", "slip_start", "slip_stop"]
    assert (events[1].t_s, events[1].onset_s) == (0.03, 0.02)


def test_a_stream_does_not_wait_for_the_pattern_of_a_contact_that_the_border_cuts() -> None:
    for quality, slips in ((AMBIGUOUS, True), (UNRESOLVED, False)):
        slipping, _ = of_palm([quality] * SCANS, [-9.0] * SCANS, stream=True, border=True)
        assert slipping.any() == slips
    assert not of_palm([AMBIGUOUS] * SCANS, [-9.0] * SCANS, stream=True)[0].any()


@pytest.mark.parametrize(("ago_s", "slips"), [(0.3, False), (0.1, True)])
def test_there_the_pattern_decides_what_began_long_ago(ago_s: float, slips: bool) -> None:
    slipping, _ = of_palm([AMBIGUOUS] * SCANS, [-9.0] * SCANS, stream=True, border=True, ago_s=ago_s)
    assert slipping.any() == slips


def test_it_waits_for_it_with_a_method_that_weighs_what_a_border_hides() -> None:
    slipping, _ = of_palm([OK, *[AMBIGUOUS] * (SCANS - 1)], [-9.0] * SCANS, stream=True, border=True)
    assert not slipping.any()


@pytest.mark.parametrize("against", [False, True])
def test_at_a_border_a_recording_asks_the_pattern(against: bool) -> None:
    slipping, _ = of_palm([AMBIGUOUS] * SCANS, [AGAINST - 0.1 if against else AGAINST + 0.1] * SCANS, border=True)
    assert slipping.any() != against


def test_a_pattern_that_nobody_has_compared_speaks_against_nothing() -> None:
    slipping, events = of_palm([AMBIGUOUS] * SCANS, [np.nan] * SCANS)
    assert slipping.tolist() == [False, False, True, True, True, False]
    assert [event.event for event in events] == ["slip_start", "slip_stop"]


@pytest.mark.parametrize("quality", [AMBIGUOUS, OK])
def test_a_slip_that_begins_where_another_ends_needs_the_consent_of_its_own_pattern(quality: int) -> None:
    odds = [9.0, 9.0, 9.0, 9.0, -9.0, -9.0]
    slipping, events = of_palm([quality] * SCANS, odds, again=4)
    sure = quality == OK
    assert slipping.tolist() == [False, False, True, True, sure, False]
    kinds = ["slip_start", "slip_stop", "slip_start", "slip_stop"] if sure else ["slip_start", "slip_stop"]
    assert [event.event for event in events] == kinds + ([] if sure else ["slip_suspected"])
    assert [event.onset_s for event in events[1:3]] == [0.035, 0.035]


def test_a_slip_that_its_pattern_dates_late_does_not_end_before_it_begins() -> None:
    _, events = of_palm([OK] * SCANS, [9.0] * SCANS, dated_s=0.03)
    assert [(event.event, event.onset_s) for event in events] == [
        ("slip_suspected", 0.02),
        ("slip_start", 0.03),
        ("slip_stop", 0.03),
    ]


def test_a_slip_on_which_pads_agree_has_nothing_of_a_suspected_one_that_has_ended() -> None:
    slips = touching(len(HAND.layout.pads), OK)
    slipping, agreed = np.zeros((2, *slips.contact.shape), dtype=bool)
    slipping[1:3, 0], agreed[5, 0] = True, True
    consents_s = np.where(slipping, 0.02, -np.inf)
    consents_s[1, 0] = np.inf
    events = [Event(t_s, "palm", kind, t_s) for t_s, kind in ((0.01, "slip_start"), (0.03, "slip_stop"))]
    odds = Odds(np.ones(slipping.shape), np.ones(slipping.shape), np.zeros_like(slipping))
    _, found = Verdict(HAND.layout).step(slips, Posed(slipping, events, agreed, consents_s), odds, odds.log_odds)
    assert [(event.event, event.onset_s) for event in found] == [
        ("slip_suspected", 0.01),
        ("slip_start", 0.02),
        ("slip_stop", 0.03),
        ("slip_start", 0.05),
    ]


def of_palm(
    quality: list[int],
    log_odds: list[float],
    *,
    stream: bool = False,
    border: bool = False,
    ago_s: float = 0.0,
    step_m: float = 0.0,
    restless: bool = False,
    scan_s: float = 0.01,
    again: int | None = None,
    dated_s: float | None = None,
) -> tuple[np.ndarray, list[Event]]:
    """Verdict on the palm, whose pose slips in scans 2 to 4: (scans,), and events. quality, log_odds: per scan.

    ago_s: time from the onset to the scan in which the pose's detector finds the slip. step_m: displacement of a scan.
    again: scan in which one slip of the pose ends and another begins. dated_s: when the pattern consents, in scan 3,
    after the onset of the last stop.
    """
    layout = HAND.layout
    pads = len(layout.pads)
    slipping = np.zeros((SCANS, pads), dtype=bool)
    slipping[2:5, 0] = True
    start_s, stop_s = 2 * scan_s, 5 * scan_s
    ended_s = stop_s if dated_s is None else dated_s - 0.5 * scan_s
    events = [Event(start_s, "palm", "slip_start", start_s - ago_s), Event(stop_s, "palm", "slip_stop", ended_s)]
    if again is not None:
        t_s, onset_s = again * scan_s, (again - 0.5) * scan_s
        events[1:1] = [Event(t_s, "palm", kind, onset_s) for kind in ("slip_stop", "slip_start")]
    slips = touching(pads, OK, scan_s)
    slips.quality[:, 0], slips.border[:, 0, 0] = quality, border
    slips.displacement[:, 0, 0] = step_m
    each = np.tile(np.array(log_odds)[:, np.newaxis], (1, pads))
    odds = Odds(each, each, np.full((SCANS, pads), restless))
    consents_s = np.full(slipping.shape, -np.inf)
    if dated_s is not None:
        consents_s[:3, 0], consents_s[3:, 0] = np.inf, dated_s
    posed = Posed(slipping, events, np.zeros_like(slipping), consents_s)
    final, found = Verdict(layout, stream=stream).step(slips, posed, odds, odds.log_odds)
    return final[:, 0], found


def judged(*, palm: bool, quality: int, sensor: Sensor = HAND) -> tuple[np.ndarray, list[Event]]:
    """Verdict on scans of which the pose of the group slips in 2 to 4, and that of the palm if given."""
    layout = sensor.layout
    pads = len(layout.pads)
    slipping = np.zeros((SCANS, pads), dtype=bool)
    named = ["left", "palm"] if palm else ["left"]
    slipping[2:5, [layout.pads.index(name) for name in named]] = True
    events = [Event(t_s, name, kind) for t_s, kind in ((0.02, "slip_start"), (0.05, "slip_stop")) for name in named]
    posed = Posed(slipping, events, np.zeros_like(slipping), np.full(slipping.shape, -np.inf))
    unknown = np.full((SCANS, pads), -1.0)
    odds = Odds(unknown, unknown, np.zeros((SCANS, pads), dtype=bool))
    return Verdict(layout).step(touching(pads, quality), posed, odds, odds.log_odds)


def touching(pads: int, quality: int, scan_s: float = 0.01) -> Slips:
    """Scans in contact on all pads."""
    one, yes = np.ones((SCANS, pads)), np.ones((SCANS, pads), dtype=bool)
    three, matrix = np.zeros((SCANS, pads, 3)), np.zeros((SCANS, pads, 3, 3))
    border, worth = np.zeros((SCANS, pads, 2), dtype=bool), np.full((SCANS, pads), quality, dtype=np.uint8)
    t_s = scan_s * np.arange(SCANS)
    return Slips(t_s, yes, border, three, three, matrix, matrix, 0.01 * one, 0 * one, one, np.nan * one, worth)


@pytest.mark.parametrize("seed", range(5))
def test_poses_that_need_their_patterns_consent_are_those_of_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    quality, border = rng.integers(0, 4, (20, 3)).astype(np.uint8), rng.random((20, 3, 2)) < 0.3
    contact, in_part, visible = rng.random((20, 3)) < 0.2, np.array([False, False, True]), rng.random((1, 3)) < 0.4
    vague, cut = np.empty((20, 3), dtype=bool), border.any(axis=2)
    judged = np.logical_or.accumulate((cut & contact & (quality == OK)).any(axis=1))
    by_border = cut & (quality == AMBIGUOUS) & ~judged[:, np.newaxis]
    assert find_vague(quality, border, contact, in_part, visible, False, vague) == judged[-1]
    assert np.array_equal(vague, (quality > OK) & (~by_border | in_part | visible))
