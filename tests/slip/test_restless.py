from __future__ import annotations

import numpy as np
import pytest

from taxelflow.slip.evidence import CHANGE
from taxelflow.slip.pattern_change import PatternChanges
from taxelflow.slip.restless import RestlessPads

WINDOW = 5


def watched(slipped: list[bool], stirred: list[float], ratio: float = -5.0, *, rests: bool = True) -> bool:
    pads = RestlessPads(1, WINDOW)
    for slips, one in zip(slipped, stirred, strict=True):
        pads.update(np.array([slips]), changed(stirred=one), 0, np.array([ratio]), np.array([rests]))
    return bool(pads.restless[0])


def changed(*, stirred: float = 0.0, unexplained: float = 0.0, rise: float = 0.0) -> PatternChanges:
    """One bin of one pad."""
    touching = np.ones((1, 1), dtype=np.bool_)
    parts = (np.array([[number]]) for number in (unexplained, 0.0, rise, stirred, *[np.nan] * 3))
    return PatternChanges(np.zeros(1), np.zeros(1), touching, *parts, np.empty((1, 1, 0, 3)))


def learned(slipped: bool, growth: float = 0.6) -> float:
    pads = RestlessPads(1, WINDOW)
    for _ in range(40):
        one = changed(unexplained=(0.3 * growth) ** 2, rise=0.3)
        pads.update(np.array([slipped]), one, 0, np.zeros(1), np.array([False]))
    return float(pads.growth[0])


def test_what_a_load_changes_is_learned_at_rest() -> None:
    assert learned(slipped=False) == pytest.approx(0.6, rel=0.02)
    assert learned(slipped=True) == CHANGE.growth


def test_a_pad_is_calm_until_it_is_observed_not_to_be() -> None:
    assert not watched([], [])
    assert not watched([False] * 100, [0.0] * 100)
    assert not watched([False] * 100, [np.nan] * 100)


def test_a_pattern_that_changes_at_rest_makes_it_restless() -> None:
    assert watched([False] * 20, [1.0] * 20)
    assert watched([False] * 100, [1.0, 0.0] * 50)
    assert not watched([False] * 100, ([1.0] + [0.0] * 9) * 10)


def test_a_slip_of_the_pose_is_no_rest_nor_are_the_bins_that_it_touches() -> None:
    assert not watched([True] * 20, [1.0] * 20)
    assert not watched(([False] * WINDOW + [True]) * 20, [1.0] * (20 * (WINDOW + 1)))


def test_a_slip_that_never_ends_is_in_doubt_where_load_and_tilt_explain_it() -> None:
    assert watched([True] * 100, [1.0] * 100)
    assert not watched([True] * 100, [1.0] * 100, ratio=5.0)
    assert not watched([True] * 45, [1.0] * 45)


def test_a_long_slip_that_rest_does_not_explain_is_no_rest() -> None:
    assert not watched([True] * 100, [1.0] * 100, rests=False)


def test_it_forgets() -> None:
    assert not watched([False] * 6000, [1.0] * 1000 + [0.0] * 5000)
