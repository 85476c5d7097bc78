"""Slips by the odds that begin with the slip of their pose."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taxelflow.slip.begun import Begun
from taxelflow.slip.odds import Odds

if TYPE_CHECKING:
    from taxelflow.messages import Bools

SCAN_S = 0.1


def odds_of(text: str, *, restless: bool = True) -> Odds:
    """One pad, a character a scan: `x` where the odds are for a slip."""
    log_odds = np.array([[3.0 if one == "x" else -3.0] for one in text])
    return Odds(log_odds, log_odds, np.full(log_odds.shape, restless))


def flags(text: str) -> Bools:
    return np.array([[one == "x"] for one in text])


def decided(odds: str, posed: str, *, cuts: tuple[int, ...] = (), restless: bool = True) -> str:
    """What slips, a character a scan. cuts: where blocks end."""
    begun, found, ends = Begun(1), [], [*cuts, len(odds)]
    for start, end in zip([0, *cuts], ends, strict=True):
        t_s = SCAN_S * np.arange(start, len(posed))
        part = begun.step(odds_of(odds[start:end], restless=restless), flags(posed[start:]), t_s)
        found.append(part[:, 0] > 0.0)
    return "".join("x" if one else "." for one in np.concatenate(found))


@pytest.mark.parametrize(
    ("odds", "posed", "slips"),
    [
        ("..xxxxx.", "....xxx.", "....xxx."),
        ("..xxxxx.", "..xxxxx.", "..xxxxx."),
        ("..xxxxx.", "......xx", "..xxxxx."),  # a pose that begins later than bins blur is another motion
        ("..xxxxx.", "........", "..xxxxx."),
        ("..xxxxx.", "xxx.xxx.", "..xxxxx."),
        ("..xx..xx", "...x...x", "...x...x"),
        ("..xxxxx.", "...x.xx.", "...xxxx."),
    ],
)
def test_a_slip_by_the_odds_begins_with_that_of_its_pose(odds: str, posed: str, slips: str) -> None:
    assert decided(odds, posed) == slips


def test_where_the_pose_decides_nothing_changes() -> None:
    assert decided("..xxxx", "....xx", restless=False) == "..xxxx"


@given(st.text("x.", min_size=3, max_size=20), st.data())
def test_blocks_do_not_matter(odds: str, data: st.DataObject) -> None:
    posed = data.draw(st.text("x.", min_size=len(odds), max_size=len(odds)))
    cut = data.draw(st.integers(1, len(odds) - 1))
    assert decided(odds, posed, cuts=(cut,)) == decided(odds, posed)
