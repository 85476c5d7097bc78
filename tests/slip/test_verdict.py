"""The verdict on slips of groups, which have a part of their pad's contact."""

from __future__ import annotations

import numpy as np
import pytest

from taxelflow.messages import AMBIGUOUS, OK, Event, Slips
from taxelflow.sensors.pads import Group, Pad, Patch
from taxelflow.sensors.sensor import Sensor, with_contacts
from taxelflow.slip.odds import Odds
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


def judged(*, palm: bool, quality: int, sensor: Sensor = HAND) -> tuple[np.ndarray, list[Event]]:
    """Verdict on scans of which the pose of the group slips in 2 to 4, and that of the palm if given."""
    layout = sensor.layout
    pads = len(layout.pads)
    slipping = np.zeros((SCANS, pads), dtype=bool)
    named = ["left", "palm"] if palm else ["left"]
    slipping[2:5, [layout.pads.index(name) for name in named]] = True
    events = [Event(t_s, name, kind) for t_s, kind in ((0.02, "slip_start"), (0.05, "slip_stop")) for name in named]
    posed = Posed(slipping, events, np.zeros_like(slipping))
    odds = Odds(np.full((SCANS, pads), -5.0), np.zeros((SCANS, pads), dtype=bool))
    return Verdict(layout).step(touching(pads, quality), posed, odds)


def touching(pads: int, quality: int) -> Slips:
    """Scans in contact on all pads."""
    one, yes = np.ones((SCANS, pads)), np.ones((SCANS, pads), dtype=bool)
    three, matrix = np.zeros((SCANS, pads, 3)), np.zeros((SCANS, pads, 3, 3))
    border, worth = np.zeros((SCANS, pads, 2), dtype=bool), np.full((SCANS, pads), quality, dtype=np.uint8)
    t_s = 0.01 * np.arange(SCANS)
    return Slips(t_s, yes, border, three, three, matrix, matrix, 0.01 * one, 0 * one, one, np.nan * one, worth)
