from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synthetic import pieces
from taxelflow.evaluation.slip_scoring import still_slips
from taxelflow.messages import LOST, UNRESOLVED, Event, Floats, Slips
from taxelflow.slip.parameters import SlipMonitor

if TYPE_CHECKING:
    from taxelflow.slip.session import SlipSession

RATE_HZ = 30.0
GONE, BACK = 50, 54
"""Scans at which the object breaks away, and is held again."""
FULL, LEAST = 1e6, 5e4
WAY = np.array([-0.012, 0.009])


def torn(
    *, way: Floats = WAY, back: int = BACK, least: float = LEAST, after: float = FULL, std_m: float = 5e-5
) -> Slips:
    """One pad's slips: an object leaps by `way` while its load falls, and is held again at scan `back`."""
    count, std = 120, np.array([std_m, std_m, 1e-3])
    pose = std * np.random.default_rng(3).standard_normal((count, 3))
    pose[GONE + 1 :, :2] += way
    slips = still_slips(np.arange(count) / RATE_HZ, pose, std, np.full(3, np.nan))
    slips.load[:GONE], slips.load[GONE:back], slips.load[back:] = FULL, least, after
    return slips


def watched(slips: Slips, sizes: list[int] | None = None, monitor: SlipMonitor | None = None) -> list[Event]:
    session: SlipSession = (monitor or SlipMonitor()).begin(("pad",))
    return [event for block in pieces(slips, sizes or [len(slips)]) for event in session.step(block)[1]]


def kinds(slips: Slips, monitor: SlipMonitor | None = None) -> list[str]:
    return [event.event for event in watched(slips, monitor=monitor)]


@pytest.mark.parametrize("known", [True, False])
def test_a_slip_faster_than_the_scans_is_reported_when_the_contact_has_settled(known: bool) -> None:
    slips = torn()
    if not known:  # a method that lost its pattern on the way knows where it is and not how far it went
        slips.quality[GONE + 1] = LOST
        slips.displacement[GONE + 1 : GONE + 3] = np.nan
    start, stop = watched(slips)[1:]
    assert (start.event, stop.event) == ("slip_start", "slip_stop")
    assert start.t_s == pytest.approx((BACK + 3) / RATE_HZ)  # a tenth of a second after it was held again
    assert stop.t_s == pytest.approx((BACK + 4) / RATE_HZ)
    assert start.onset_s == pytest.approx((GONE - 0.75) / RATE_HZ)
    assert GONE / RATE_HZ < stop.onset_s < (GONE + 2) / RATE_HZ
    way = (stop.onset_s - start.onset_s) * stop.speed_m_s
    assert way == pytest.approx(0.015, rel=0.02)
    assert stop.direction_rad == pytest.approx(np.arctan2(WAY[1], WAY[0]), abs=0.02)
    assert np.isnan(stop.turn_rad_s)


def test_a_recording_keeps_its_dates() -> None:
    """There is no way between two scans that it could be dated by."""
    live, session = watched(torn()), SlipMonitor().look_back(("pad",))
    (some, first, _), (rest, last, _) = session.step(torn()), session.finish()
    found = [*first, *last]
    assert np.flatnonzero(np.concatenate([some, rest])).tolist() == [GONE]
    assert [event.event for event in found] == [event.event for event in live]
    for one, other in zip(live[1:], found[1:], strict=True):
        assert (one.onset_s, one.speed_m_s) == (other.onset_s, other.speed_m_s)


@given(sizes=st.lists(st.integers(1, 40), min_size=1, max_size=30))
def test_it_does_not_depend_on_how_slips_are_cut(sizes: list[int]) -> None:
    assert watched(torn(), sizes) == watched(torn())


def test_what_load_may_do_to_a_place_is_no_slip() -> None:
    assert kinds(torn(way=WAY / 3)) == ["contact"]
    assert kinds(torn(way=WAY / 3, least=FULL / 2.5)) == ["contact", "slip_start", "slip_stop"]
    assert kinds(torn(way=WAY / 100, least=FULL / 2.5)) == ["contact"]


def test_a_load_that_rises_is_no_leap() -> None:
    steps = np.clip(np.arange(120) - GONE, 0, 5)
    slips = torn(way=np.zeros(2))
    slips.load[:, 0] = FULL * 3.0**steps
    shift = 1.5e-3 * np.log(3.0) * np.diff(steps, prepend=0)
    slips.displacement[:, 0, 0] += shift
    slips.pose[:, 0, 0] += np.cumsum(shift)
    assert kinds(slips) == ["contact"]
    assert kinds(torn(way=WAY / 2, least=FULL / 2.2, after=FULL * np.exp(5.5))) == ["contact"]


def test_a_pose_that_is_not_sure_counts_less() -> None:
    slips = torn(way=0.75 * WAY, std_m=8e-4, least=FULL / 2.5)
    assert "slip_start" in kinds(slips)
    slips.quality[GONE:] = UNRESOLVED
    assert kinds(slips) == ["contact"]


def test_covariances_too_small_are_found_out_before() -> None:
    slips = torn(way=np.array([6e-4, 0.0]), least=FULL / 2.5, std_m=2e-4)
    slips.displacement_covariance[...] /= 16
    slips.covariance[...] /= 16
    sharp = SlipMonitor(load_m=1e-5)
    assert kinds(slips, sharp) == ["contact"]
    honest = torn(way=np.array([6e-4, 0.0]), least=FULL / 2.5, std_m=5e-5)
    assert kinds(honest, sharp) == ["contact", "slip_start", "slip_stop"]


def test_a_slip_soon_after_a_dip_is_reported_once() -> None:
    slips = torn(way=np.zeros(2))
    ramp = np.clip(np.arange(len(slips)) - BACK - 6, 0, 3)[:, np.newaxis, np.newaxis] * [4e-3, 0.0, 0.0]
    slips.displacement[1:] += np.diff(ramp, axis=0)
    slips.pose[...] += ramp
    found = watched(slips)
    assert [event.event for event in found] == ["contact", "slip_start", "slip_stop"]
    assert found[1].onset_s == pytest.approx((BACK + 6) / RATE_HZ, abs=1.1 / RATE_HZ)
    assert found[2].speed_m_s == pytest.approx(0.12, rel=0.2)


def test_a_hand_that_lets_go_and_holds_again_elsewhere_has_not_slipped() -> None:
    assert kinds(torn(back=GONE + 17)) == ["contact"]


def test_what_is_left_of_a_contact_may_lie_anywhere() -> None:
    assert kinds(torn(after=LEAST)) == ["contact"]


def test_a_contact_that_was_broken_is_another() -> None:
    slips = torn()
    slips.contact[GONE + 1] = False
    assert kinds(slips) == ["contact", "release", "contact"]


def test_a_contact_too_young_to_be_judged_has_no_place_to_slip_from() -> None:
    slips = torn()
    slips.contact[: GONE - 3] = False
    assert kinds(slips) == ["contact"]


def test_a_slip_after_it_is_found_like_any_other() -> None:
    slips = torn()
    ramp = np.clip(np.arange(len(slips)) - 80, 0, 20)[:, np.newaxis, np.newaxis] * [5e-4, 0.0, 0.0]
    slips.displacement[1:] += np.diff(ramp, axis=0)
    slips.pose[...] += ramp
    assert kinds(slips) == ["contact", *["slip_start", "slip_stop"] * 2]
