from __future__ import annotations

from dataclasses import replace
from unittest.mock import MagicMock

import numpy as np

from taxelflow.messages import Event
from taxelflow.publish.view.player import Player
from taxelflow.publish.view.strip import Strip, bars_of, strip_svg

EVENTS = [
    Event(1.0, "palm", "contact"),
    Event(2.05, "palm", "slip_start", 2.0),
    Event(2.5, "palm", "slip_stop", 2.45),
    Event(2.7, "thumb", "slip_suspected", 2.6, duration_s=0.2),
    Event(3.0, "palm", "release"),
    Event(4.0, "thumb", "contact"),
]


def test_contacts_and_slips_are_bars_from_begin_to_end() -> None:
    found = [(bar.lane, bar.from_s, round(bar.to_s, 6)) for bar in bars_of(EVENTS, 5.0)]
    assert found == [("palm", 1.0, 3.0), ("thumb", 4.0, 5.0), ("palm", 2.0, 2.45), ("thumb", 2.6, 2.8)]


def test_a_slip_that_is_suspected_again_is_listed_once() -> None:
    gui = MagicMock()
    strip = Strip(gui, Player(0.0, 5.0))
    strip.list([*EVENTS, replace(EVENTS[3], t_s=2.9)])
    assert gui.add_dropdown.return_value.options == ("2.000 s palm", "2.600 s thumb?")
    strip.show(0.0)
    assert gui.add_button_group.return_value.options == ("previous", "next", "2.000 s palm", "2.600 s thumb?")


def test_the_strip_marks_the_time_that_is_shown() -> None:
    early, late = strip_svg(EVENTS, 0.0, 5.0, 0.0), strip_svg(EVENTS, 0.0, 5.0, 5.0)
    assert early.count("<rect") == 5  # four bars, and what is pressed
    assert early != late
    assert strip_svg([], 0.0, 5.0, 0.0) == ""


def test_names_are_escaped_and_of_many_pads_those_near_in_time_are_shown() -> None:
    many = [Event(float(second), f"<{second}>", "slip_start", float(second), duration_s=0.1) for second in range(30)]
    stops = [Event(event.t_s + 0.1, event.pad, "slip_stop", event.t_s + 0.1) for event in many]
    drawn = strip_svg(sorted([*many, *stops], key=lambda event: event.t_s), 0.0, 30.0, 29.0)
    assert "&lt;29&gt;" in drawn
    assert "&lt;1&gt;" not in drawn
    assert "20 more pads" in drawn
    assert np.all([mark not in drawn for mark in ("<29>", "<25>")])
