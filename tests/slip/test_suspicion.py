"""Slips that are only suspected and go on: when they are reported again."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from taxelflow.messages import Slips
from taxelflow.slip.suspicion import Suspicion

if TYPE_CHECKING:
    from taxelflow.messages import Floats

PITCH_M = np.array([[0.004, 0.004]])
QUARTER_M = 0.001
SCAN_S = 0.6
"""Longer than the time between two reports."""


def reports(steps_m: Floats, *, block: int = 1000, scan_s: float = SCAN_S) -> list[int]:
    """Scans in which a slip that is suspected all the time is reported again. steps_m: (scans, 2)."""
    suspicion, found = Suspicion(PITCH_M), []
    for start in range(0, len(steps_m), block):
        part = steps_m[start : start + block]
        t_s = scan_s * np.arange(start, start + len(part))
        again = suspicion.step(moving(t_s, part), np.ones((len(part), 1), dtype=np.bool_))
        found += [start + scan for (scan, _), since_s in again.items() if since_s == 0.0]
    return found


def moving(t_s: Floats, steps_m: Floats) -> Slips:
    """Scans (scans,) in contact on one pad, that move by (scans, 2)."""
    one, yes, matrix = np.ones((len(t_s), 1)), np.ones((len(t_s), 1), dtype=np.bool_), np.zeros((len(t_s), 1, 3, 3))
    displacement = np.zeros((len(t_s), 1, 3))
    displacement[:, 0, :2] = steps_m
    border, worth = np.zeros((len(t_s), 1, 2), dtype=np.bool_), np.ones((len(t_s), 1), dtype=np.uint8)
    return Slips(t_s, yes, border, displacement, displacement, matrix, matrix, 0.01 * one, 0 * one, one, one, worth)


def test_each_quarter_of_a_pitch_is_reported() -> None:
    steps_m = np.tile([0.7 * QUARTER_M, 0.0], (10, 1))
    assert reports(steps_m) == [2, 3, 5, 6, 8, 9]


@given(st.floats(0.001, 0.1), st.integers(1, 7))
@settings(max_examples=25, deadline=None)
def test_a_slow_slip_is_reported_as_often_as_a_fast_one(pitches: float, block: int) -> None:
    count = round(2.0 / pitches)
    steps_m = np.tile([pitches * 0.004, 0.0], (count, 1))
    found = reports(steps_m, block=block)
    assert len(found) in (6, 7, 8)
    assert found == reports(steps_m)


def test_a_fast_slip_is_reported_each_half_second() -> None:
    assert reports(np.tile([QUARTER_M, 0.0], (140, 1)), scan_s=0.01) == [50, 100]


def test_an_object_that_rocks_is_not_reported_for_each_swing() -> None:
    place = 0.8 * QUARTER_M * np.sin(np.arange(1000) / 20)
    assert not reports(np.diff(place, prepend=0.0)[:, np.newaxis] * [1.0, 0.0])
    assert len(reports(2.0 * np.diff(place, prepend=0.0)[:, np.newaxis] * [1.0, 0.0])) == 1


def test_a_pose_that_is_lost_for_some_scans_goes_on_where_it_was() -> None:
    steps_m = np.tile([0.0006, 0.0], (5, 1))
    steps_m[1:3] = np.nan
    assert reports(steps_m) == [4]
