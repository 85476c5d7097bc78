from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sliding import NAN, RATE_HZ, kinds, noise, slid, slips_of, watched
from synthetic import pieces
from taxelflow.messages import Event
from taxelflow.slip.parameters import SlipMonitor


@given(
    velocity=st.tuples(*[st.floats(-0.03, 0.03)] * 2, st.floats(-1, 1)),
    seed=st.integers(0, 99),
    cuts=st.lists(st.integers(0, 120), max_size=8),
)
@settings(max_examples=25)
def test_the_evidence_does_not_depend_on_how_slips_are_cut(
    velocity: tuple[float, float, float], seed: int, cuts: list[int]
) -> None:
    slips = slips_of(slid(velocity, scans=120, begin=40, end=80) + noise(120, seed))
    slips.contact[(seed + np.arange(120)) % 50 == 0] = False
    whole_flags, whole_events, whole = watched(slips)
    flags, events, session = watched(*pieces(slips, cuts))
    np.testing.assert_array_equal(flags, whole_flags)
    np.testing.assert_array_equal(session.scatter, whole.scatter)
    assert events == whole_events


def test_a_pads_answer_does_not_depend_on_the_other_pads() -> None:
    one, other = slips_of(slid((0.01, 0.0, 0.0))), slips_of(noise(300, 1))
    names = ("contact", "border", "displacement", "pose", "covariance", "displacement_covariance")
    names += ("span_s", "lag_s", "load", "disturbance", "quality")
    both = replace(one, **{name: np.concatenate([getattr(other, name), getattr(one, name)], axis=1) for name in names})
    flags, events, _ = watched(both)
    np.testing.assert_array_equal(flags[:, 1], watched(one)[0][:, 0])
    assert not flags[:, 0].any()
    assert [event.t_s for event in events] == sorted(event.t_s for event in events)


@pytest.mark.parametrize("scale", [0.6, 1.7, 3.0])
def test_the_scatter_is_learned(scale: float) -> None:
    _, events, session = watched(slips_of(scale * noise(6000)))
    assert session.scatter[0] == pytest.approx(scale, rel=0.06)
    assert kinds(events) == ["contact"]


def test_before_any_pose_the_scatter_is_1() -> None:
    assert SlipMonitor().begin(("a", "b")).scatter.tolist() == [1.0, 1.0]


def test_a_contact_in_the_first_scan_is_an_event_and_no_contact_is_none() -> None:
    slips = slips_of(noise(3))
    assert watched(slips)[1] == [Event(0.0, "pad0", "contact")]
    slips.contact[...] = False
    assert watched(slips)[1] == []


def test_a_slip_that_ends_by_lift_off_stops_before_the_release() -> None:
    slips = slips_of(slid((0.02, 0.0, 0.0)))
    slips.contact[150:] = False
    slips.displacement[150:] = NAN
    _, events, _ = watched(slips)
    assert kinds(events) == ["contact", "slip_start", "slip_stop", "release"]
    assert events[2].t_s == events[2].onset_s == events[3].t_s
    assert np.isnan(events[2].speed_m_s)


def test_events_of_a_pad_alternate_and_agree_with_the_flags() -> None:
    random = np.random.default_rng(0)
    slips = slips_of(noise(3000) + np.cumsum(random.choice([0.0, 2e-4], (3000, 1), p=[0.5, 0.5]) * [1, 0, 0], axis=0))
    slips.contact[random.random(3000) < 0.02] = False
    flags, events, _ = watched(slips)
    for pair in ({"contact", "release"}, {"slip_start", "slip_stop"}):
        order = [kind for kind in kinds(events) if kind in pair]
        assert len(order) > 10
        assert all(one != other for one, other in itertools.pairwise(order))
    told = np.zeros(3001)
    for event in events:
        told[round(event.t_s * RATE_HZ)] += {"slip_start": 1, "slip_stop": -1}.get(event.event, 0)
    np.testing.assert_array_equal(np.cumsum(told)[:-1], flags[:, 0])


def test_the_statistic_exceeds_its_threshold_from_the_scan_that_slips_to_the_one_that_has_stopped() -> None:
    slips = slips_of(slid((0.02, 0.0, 0.0)))
    found = SlipMonitor().begin(("pad0",)).step(slips)
    tested = np.isfinite(found.statistic[:, 0])
    assert tested.mean() > 0.9
    onset = int(np.argmax(found.slipping[:, 0]))
    assert found.statistic[onset, 0] > 1.0  # the test of this scan
    assert (found.statistic[:onset][tested[:onset], 0] <= 1.0).all()
    later = slice(onset + 1, None)
    np.testing.assert_array_equal(found.statistic[later, 0] > 1.0, found.slipping[later, 0])


def test_without_displacement_the_statistic_is_that_of_the_disturbance() -> None:
    slips = slips_of(noise(300))
    slips.displacement[...], slips.pose[...] = NAN, NAN
    slips.disturbance[...] = 0.5
    slips.disturbance[150:200] = 9.0
    found = SlipMonitor().begin(("pad0",)).step(slips)
    assert found.slipping[150:200, 0].all()
    settled = slice(100, 150)
    assert (found.statistic[settled, 0] < 1.0).all()
    assert (found.statistic[150:200, 0] > 1.0).all()
    assert found.statistic[200, 0] < 1.0


def test_nothing_is_held_back() -> None:
    flags, events, _ = SlipMonitor().begin(("a", "b")).finish()
    assert flags.shape == (0, 2)
    assert events == []
