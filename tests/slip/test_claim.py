"""When the pattern consents to a slip by the pose."""

from __future__ import annotations

import numpy as np
import pytest

from taxelflow.numerics.rest_or_slide import Unexplained
from taxelflow.slip.claim import Claim, Pattern

ONSET_S, NOISE = 1.0, 1.0
UNDECIDED = Unexplained(
    slide=800.0, rest=900.0, rest_of_all=900.0, free_slide=9.0, free_rest=9.0, pressed=5000.0, free_pressed=12.0
)
"""A slide explains more than a change of the load, and no better than sinking and tilting."""
SLID = UNDECIDED._replace(slide=100.0)
RESTED = UNDECIDED._replace(rest=90.0, rest_of_all=90.0)
PRESSED = UNDECIDED._replace(pressed=1000.0)


def judged(
    left: Unexplained, *, still: bool = True, fast: bool = False, is_bin: bool = True, load: float = 1.1
) -> Claim:
    """A claim after one pattern with a load relative to that before."""
    before, way = np.full(9, 100.0), np.zeros(2)
    claim = Claim(ONSET_S, still, Pattern(ONSET_S - 0.1, before, 10, way))
    claim.judge(Pattern(ONSET_S + 0.1, load * before, 10, way), left, NOISE, covers=False, is_bin=is_bin)
    return claim


@pytest.mark.parametrize("still", [False, True])
@pytest.mark.parametrize("is_bin", [False, True])
def test_a_slide_that_is_clearly_better_shows_the_slip(still: bool, is_bin: bool) -> None:
    claim = judged(SLID, still=still, is_bin=is_bin)
    assert claim.shown
    assert claim.since_s < ONSET_S


def test_what_noise_explains_shows_nothing() -> None:
    little = UNDECIDED._replace(slide=0.1, rest=0.2, rest_of_all=0.2, pressed=8.0)
    assert judged(little).since_s == np.inf


@pytest.mark.parametrize(
    ("left", "still", "load", "consents"),
    [
        (UNDECIDED, True, 1.1, True),
        (UNDECIDED, False, 1.1, False),
        (UNDECIDED, True, 0.6, False),
        (UNDECIDED, True, 1.6, False),
        (RESTED, True, 1.1, False),
        (PRESSED, True, 1.1, False),
    ],
)
def test_of_a_contact_that_was_still_the_pose_decides_what_the_pattern_does_not(
    left: Unexplained, still: bool, load: float, consents: bool
) -> None:
    assert (judged(left, still=still, load=load).since_s < ONSET_S) is consents


def test_a_single_scan_consents_at_once() -> None:
    assert judged(UNDECIDED, is_bin=False).since_s < ONSET_S
    assert judged(PRESSED, is_bin=False).since_s == np.inf


def test_later_bins_of_an_undecided_slip_do_not_consent() -> None:
    claim = judged(PRESSED)
    claim.judge(Pattern(ONSET_S + 0.2, np.full(9, 100.0), 10, np.zeros(2)), UNDECIDED, NOISE, covers=False, is_bin=True)
    assert claim.since_s == np.inf


def test_after_a_rest_the_slip_begins_with_the_next_interval() -> None:
    claim = judged(RESTED)
    assert claim.rests
    claim.judge(Pattern(ONSET_S + 0.2, np.full(9, 100.0), 10, np.zeros(2)), SLID, NOISE, covers=False, is_bin=True)
    assert claim.since_s == ONSET_S + 0.1
