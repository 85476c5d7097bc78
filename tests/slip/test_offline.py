from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sliding import RATE_HZ, STD, kinds, slips_of
from synthetic import pieces
from taxelflow.messages import Bools, Event, Floats, Slips
from taxelflow.slip.offline import OfflineSlipSession
from taxelflow.slip.parameters import SlipMonitor


def slid(*intervals: tuple[float, float], speed_m_s: float = 0.01, scans: int = 400, seed: int = 0) -> Floats:
    """Noisy poses that move along x between the times given, s."""
    t_s = np.arange(scans) / RATE_HZ
    pose = STD * np.random.default_rng(seed).standard_normal((scans, 3))
    for begin, end in intervals:
        pose[:, 0] += speed_m_s * np.clip(t_s - begin, 0, end - begin)
    return pose


def seen(*blocks: Slips) -> tuple[Bools, list[Event]]:
    session = SlipMonitor().look_back(("pad",))
    found = [*(session.step(block) for block in blocks), session.finish()]
    return np.concatenate([one.slipping for one in found]), [event for one in found for event in one.events]


@pytest.mark.parametrize("speed_m_s", [0.003, 0.015])
def test_slips_are_dated_to_a_fraction_of_a_scan(speed_m_s: float) -> None:
    flags, events = seen(slips_of(slid((1.003, 1.402), (1.688, 2.005), speed_m_s=speed_m_s)))
    assert kinds(events) == ["contact", "slip_start", "slip_stop", "slip_start", "slip_stop"]
    fair_s = 3e-5 / speed_m_s
    for event, true_s in zip(events[1:], (1.003, 1.402, 1.688, 2.005), strict=True):
        assert event.onset_s == pytest.approx(true_s, abs=fair_s)
        assert event.t_s == pytest.approx(math.ceil(event.onset_s * RATE_HZ) / RATE_HZ)
    np.testing.assert_array_equal(
        np.diff(flags[:, 0].astype(int)).nonzero()[0], [round(e.t_s * 100) - 1 for e in events[1:]]
    )


def at_1_khz(seed: int) -> Slips:
    """Poses that scatter by 0.1 mm, and move by 1 mm/s from 1.5 to 3 s: found 170 scans later."""
    t_s = np.arange(4000) / 1000.0
    pose = 5.0 * STD * np.random.default_rng(seed).standard_normal((len(t_s), 3))
    pose[:, 0] += 1e-3 * np.clip(t_s - 1.5, 0.0, 1.5)
    slips = slips_of(pose, t_s=t_s)
    slips.displacement_covariance[:] *= 25.0
    return slips


def test_a_slow_slip_of_many_scans_is_one_and_dated_as_far_back_as_a_stream_finds_it() -> None:
    for seed in range(3):
        _, events = seen(at_1_khz(seed))
        assert kinds(events) == ["contact", "slip_start", "slip_stop"]
        assert [event.onset_s for event in events[1:]] == pytest.approx([1.5, 3.0], abs=0.09)


@given(cuts=st.lists(st.integers(0, 300), max_size=8), seed=st.integers(0, 99), lifted=st.integers(60, 290))
@settings(max_examples=25)
def test_the_evidence_does_not_depend_on_how_slips_are_cut(cuts: list[int], seed: int, lifted: int) -> None:
    slips = slips_of(slid((0.5, 0.8), (0.95, 1.2), (2.0, 2.03), scans=300, seed=seed))
    slips.contact[lifted : lifted + 3] = False
    slips.displacement[lifted + 3] = np.nan
    flags, events = seen(*pieces(slips, cuts))
    whole_flags, whole_events = seen(slips)
    np.testing.assert_array_equal(flags, whole_flags)
    assert events == whole_events
    assert len(flags) == 300


def test_events_alternate_agree_with_the_flags_and_come_in_order() -> None:
    random = np.random.default_rng(1)
    steps = random.choice([0.0, 2e-4], (3000, 1), p=[0.6, 0.4]) * [1, 0, 0]
    slips = slips_of(slid(scans=3000) + np.cumsum(steps, axis=0))
    slips.contact[random.random(3000) < 0.01] = False
    flags, events = seen(slips)
    times = [event.t_s for event in events]
    assert times == sorted(times)
    order = [kind for kind in kinds(events) if kind.startswith("slip")]
    assert len(order) > 10
    assert all(one != other for one, other in itertools.pairwise(order))
    told = np.zeros(3001)
    for event in events:
        told[round(event.t_s * RATE_HZ)] += {"slip_start": 1, "slip_stop": -1}.get(event.event, 0)
    np.testing.assert_array_equal(np.cumsum(told)[:-1], flags[:, 0])
    assert not flags[~slips.contact].any()
    assert all(slip_scans(events))


@pytest.mark.parametrize(("dated_s", "scans"), [(1.5, 1), (3.99, 0)], ids=["within", "last scan"])
def test_a_slip_that_begins_and_ends_in_a_scan_has_one_that_slips(
    dated_s: float, scans: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(OfflineSlipSession, "_change_point", lambda *_: dated_s)
    flags, events = seen(slips_of(slid((1.0, 1.2))))
    assert kinds(events)[-2:] == ["slip_start", "slip_stop"]
    assert slip_scans(events) == [scans]
    assert np.count_nonzero(flags) == scans


def slip_scans(events: list[Event]) -> list[int]:
    """Scans of each slip that has ended."""
    of_slips = [round(event.t_s * RATE_HZ) for event in events if event.event in ("slip_start", "slip_stop")]
    return [stop - start for start, stop in zip(of_slips[::2], of_slips[1::2], strict=False)]


def test_it_holds_back_only_so_many_scans() -> None:
    session = SlipMonitor().look_back(("pad",))
    given_back = 0
    for part in pieces(slips_of(slid((1.0, 1.3), scans=800)), list(range(1, 800))):
        given_back += len(session.step(part)[0])
    assert 390 < given_back < 400  # twice 2 s
    assert given_back + len(session.finish()[0]) == 800


def test_a_pose_gone_wrong_for_a_scan_is_an_alarm_live_and_no_slip_in_hindsight() -> None:
    pose = slid()
    pose[150, 0] += 2e-4
    live = SlipMonitor().begin(("pad",)).step(slips_of(pose)).events
    assert kinds(live) == ["contact", "slip_start", "slip_stop"]
    flags, events = seen(slips_of(pose))
    assert kinds(events) == ["contact"]
    assert not flags.any()


def test_a_short_slip_that_leads_somewhere_stays() -> None:
    _, events = seen(slips_of(slid((1.5, 1.52))))
    assert kinds(events) == ["contact", "slip_start", "slip_stop"]


def test_a_pose_that_is_older_than_its_scan_is_dated_by_its_own_time() -> None:
    slips = slips_of(slid((1.0, 1.5)))
    late = replace(slips, lag_s=np.full((400, 1), 0.02))
    (start, _), (later, _) = ([e for e in seen(each)[1] if "slip" in e.event] for each in (slips, late))
    assert later.onset_s == pytest.approx(start.onset_s - 0.02, abs=0.01)


def test_a_slip_without_displacement_is_given_as_it_was_reported() -> None:
    slips = slips_of(slid())
    slips.displacement[...] = np.nan
    slips.disturbance[:, 0] = 0.0
    slips.disturbance[100:103, 0] = 7.0
    flags, events = seen(slips)
    assert flags[:, 0].nonzero()[0].tolist() == [100, 101, 102]
    assert events[1] == Event(1.0, "pad", "slip_start", 1.0)


@pytest.mark.parametrize("seed", range(5))
def test_slips_in_whole_pitches_are_dated_alike_whatever_rounding_does(seed: int) -> None:
    random = np.random.default_rng(seed)
    slips = slips_of(np.round(slid((1.0, 2.0), speed_m_s=0.02, seed=seed) / 0.002) * 0.002)
    rounding = 1.0 + 2e-16 * random.standard_normal(slips.displacement_covariance.shape)
    rounded = replace(slips, displacement_covariance=slips.displacement_covariance * rounding)
    first, second = ([event.onset_s for event in seen(each)[1]] for each in (slips, rounded))
    np.testing.assert_array_equal(first, second)
    assert len(first) > 4


def test_nothing_in_nothing_out() -> None:
    session = SlipMonitor().look_back(("a", "b"))
    flags, events, _ = session.finish()
    assert flags.shape == (0, 2)
    assert events == []
    assert session.scatter.tolist() == [1.0, 1.0]
