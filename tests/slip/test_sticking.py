"""Objects that have not slipped since they were touched."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sheared import IDLE_S, sheared
from taxelflow.messages import OK
from taxelflow.pipeline import api
from taxelflow.slip.sticking import Sticking

if TYPE_CHECKING:
    from taxelflow.estimation.base import Mode
    from taxelflow.messages import Bools

both = pytest.mark.parametrize("mode", ["batch", "stream"])
REST, SLIP, UNKNOWN = -5.0, 2.0, np.nan


def sticks(odds: list[float], *, touching: str = "", slips: str = "", spread: float = 0.01) -> list[bool]:
    """Of a pad with these log odds; touching, slips: one character a scan, `.` for no."""
    sticking, count = Sticking(1), len(odds)
    sticking.see(np.zeros(1), np.full((1, 1), spread))
    touched, slipped = flags(touching or "x" * count), flags(slips or "." * count)
    return sticking.step(np.arange(count), touched, slipped, np.array(odds)[:, None])[:, 0].tolist()


def flags(text: str) -> Bools:
    """(scans, 1)."""
    return np.array([[one != "."] for one in text])


def test_an_object_sticks_until_pattern_and_shear_no_longer_speak_against_a_slip() -> None:
    assert sticks([UNKNOWN, REST, REST, SLIP, REST]) == [False, True, True, False, False]
    assert sticks([REST, REST, -1.0, REST]) == [True, True, False, False]


def test_an_object_that_has_slipped_sticks_no_more_until_it_is_touched_again() -> None:
    assert sticks([REST] * 6, slips=".x....", touching="xxx.xx") == [True, False, False, False, True, True]


def test_without_shear_there_is_no_second_witness() -> None:
    assert not any(sticks([REST] * 5, spread=np.nan))


@given(st.lists(st.sampled_from([REST, -1.5, SLIP, UNKNOWN]), min_size=2, max_size=12), st.data())
def test_blocks_do_not_matter(odds: list[float], data: st.DataObject) -> None:
    touching = flags("".join(data.draw(st.lists(st.sampled_from("x."), min_size=len(odds), max_size=len(odds)))))
    at, whole, parts = data.draw(st.integers(1, len(odds) - 1)), Sticking(1), Sticking(1)
    for one in (whole, parts):
        one.see(np.zeros(1), np.zeros((1, 1)))
    rows, slips, t_s = np.array(odds)[:, None], np.zeros_like(touching), np.arange(len(odds))
    found = [parts.step(t_s[k], touching[k], slips[k], rows[k]) for k in (slice(at), slice(at, None))]
    assert np.array_equal(whole.step(t_s, touching, slips, rows), np.concatenate(found))


@pytest.mark.parametrize(("ahead_s", "first"), [(0.0, 2), (2.0, 1)])
def test_shear_is_a_witness_from_its_first_change_on_and_half_of_the_time_ahead_before_it(
    ahead_s: float, first: int
) -> None:
    sticking, touching = Sticking(1, ahead_s), flags("xxxx")
    sticking.see(np.arange(4.0), np.array([[np.nan], [np.nan], [0.01], [np.nan]]))
    found = sticking.step(np.arange(4.0), touching, ~touching, np.full((4, 1), REST))
    assert found[:, 0].tolist() == [scan >= first for scan in range(4)]


@both
def test_an_object_at_rest_on_a_skin_with_shear_stays_and_is_ok(mode: Mode) -> None:
    slips = api.estimate(sheared(np.zeros(200), np.zeros(200)), "convolution", mode=mode).slips
    ok = slips.quality[:, 0] == OK
    assert ok[slips.contact[:, 0]].mean() > 0.8
    assert np.ptp(slips.pose[ok, 0, :2], axis=0).max() < 1e-3
    assert not np.nan_to_num(slips.displacement[ok, 0, :2]).any()  # the first scan of the contact has none


@both
def test_an_object_that_has_slid_is_where_its_pose_is(mode: Mode) -> None:
    slid = np.clip(np.arange(200) - 100, 0, 20) / 20
    recording = sheared(0.012 * slid, (slid > 0) & (slid < 1))
    slips = api.estimate(recording, "convolution", mode=mode).slips
    after = slips.t_s > slips.t_s[0] + IDLE_S + 14.0
    went = np.nanmedian(slips.pose[after & slips.contact[:, 0], 0, 0])
    assert went == pytest.approx(0.012, rel=0.3)
