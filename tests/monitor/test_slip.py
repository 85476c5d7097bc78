from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synthetic import pieces
from taxelflow.errors import ParameterInvalid
from taxelflow.messages import Bools, Event, Slips
from taxelflow.monitor.slip import SlipMonitor


def slips_of(sizes: Any, *, contact: Any = None, direction: tuple[float, float] = (1.0, 0.0)) -> Slips:
    """Slips (scans, pads) whose displacement is so many standard deviations of 1 mm along a direction; NaN unknown."""
    size = np.asarray(sizes, dtype=float)
    size = size[:, np.newaxis] if size.ndim == 1 else size
    scans, pads = size.shape
    displacement = np.full((scans, pads, 3), np.nan)
    displacement[..., :2] = 1e-3 * size[..., np.newaxis] * direction
    covariance = np.full((scans, pads, 3, 3), np.nan)
    covariance[..., :2, :2] = 1e-6 * np.eye(2)
    unknown = np.full((scans, pads), np.nan)
    touched = np.ones((scans, pads), bool) if contact is None else np.asarray(contact, bool).reshape(scans, pads)
    return Slips(
        t_s=np.arange(scans) / 10,
        contact=touched,
        border=np.zeros((scans, pads, 2), bool),
        displacement=displacement,
        pose=np.full((scans, pads, 3), np.nan),
        covariance=covariance.copy(),
        displacement_covariance=covariance,
        span_s=np.full((scans, pads), 0.1),
        lag_s=unknown,
        load=unknown,
        disturbance=unknown.copy(),
        quality=np.ones((scans, pads), np.uint8),
    )


def watched(*blocks: Slips, monitor: SlipMonitor | None = None) -> tuple[Bools, list[Event]]:
    session = (monitor or SlipMonitor()).begin(tuple(f"pad{k}" for k in range(blocks[0].contact.shape[1])))
    found = [session.step(block) for block in blocks]
    return np.concatenate([slipping for slipping, _ in found]), [event for _, events in found for event in events]


def slipping(sizes: Any, **more: Any) -> list[bool]:
    flags: list[bool] = watched(slips_of(sizes, **more))[0][:, 0].tolist()
    return flags


def test_slip_starts_above_one_multiple_and_stops_below_another() -> None:
    sizes = [0, 2.6, 4.9, 5.1, 4.9, 2.6, 2.4, 2.6, 4.9, 5.1, 0]
    assert slipping(sizes) == [False, False, False, True, True, True, False, False, False, True, False]


def test_the_multiples_are_parameters() -> None:
    flags, _ = watched(slips_of([2, 4, 2, 0.5]), monitor=SlipMonitor(start=3, stop=1))
    assert flags[:, 0].tolist() == [False, True, True, False]


@pytest.mark.parametrize("direction", [(1, 0), (0, 1), (-1, 0), (0, -1), (0.6, -0.8)])
def test_the_direction_does_not_matter(direction: tuple[float, float]) -> None:
    assert slipping([4.9, 5.1], direction=direction) == [False, True]


def test_the_deviation_counts_along_the_displacement() -> None:
    slips = slips_of([6.0, 6.0], direction=(0.0, 1.0))
    slips.displacement_covariance[1, :, 1, 1] *= 4  # twice the deviation along y: only 3 of them now
    slips.displacement_covariance[:, :, 0, 0] *= 1e-4
    flags, _ = watched(slips, monitor=SlipMonitor(start=5, stop=4))
    assert flags[:, 0].tolist() == [True, False]


def test_an_unknown_displacement_is_no_slip_and_ends_one() -> None:
    nan = float("nan")
    assert slipping([nan, 6, 6, nan, nan, 4]) == [False, True, True, False, False, False]


def test_no_displacement_at_all_is_no_slip_even_without_noise() -> None:
    slips = slips_of([0, 0])
    slips.displacement_covariance[..., :2, :2] = 0
    assert not watched(slips)[0].any()


def test_any_displacement_is_slip_where_noise_makes_none() -> None:
    slips = slips_of([0, 1e-3, 0])
    slips.displacement_covariance[..., :2, :2] = 0
    assert watched(slips)[0][:, 0].tolist() == [False, True, False]


def test_a_known_rotation_counts_as_well() -> None:
    slips = slips_of([0, 0, 0])
    slips.displacement[1, 0, 2] = -0.06
    slips.displacement[[0, 2], 0, 2] = 0.0
    slips.displacement_covariance[..., 2, 2] = 0.01**2
    assert watched(slips)[0][:, 0].tolist() == [False, True, False]


def test_a_disturbance_counts_where_there_is_no_displacement() -> None:
    slips = slips_of([np.nan, np.nan, np.nan, 0.0, 6.0])
    slips.disturbance[:, 0] = [np.nan, 5.1, 2.4, 5.1, np.nan]
    assert watched(slips)[0][:, 0].tolist() == [False, True, False, True, True]


def test_events_tell_of_contact_slip_and_release() -> None:
    slips = slips_of([np.nan, 0, 9, 9, 0, np.nan], contact=[0, 1, 1, 1, 1, 0])
    _, events = watched(slips)
    assert [(event.t_s, event.pad, event.event) for event in events] == [
        (0.1, "pad0", "contact"),
        (0.2, "pad0", "slip_start"),
        (0.4, "pad0", "slip_stop"),
        (0.5, "pad0", "release"),
    ]


def test_a_contact_in_the_first_scan_is_an_event() -> None:
    assert [event.event for event in watched(slips_of([0]))[1]] == ["contact"]


def test_a_slip_that_ends_by_lift_off_stops_before_the_release() -> None:
    _, events = watched(slips_of([0, 9, np.nan], contact=[1, 1, 0]))
    assert [event.event for event in events] == ["contact", "slip_start", "slip_stop", "release"]
    assert events[2].t_s == events[3].t_s


def test_events_of_all_pads_come_in_time_order() -> None:
    random = np.random.default_rng(0)
    sizes = random.uniform(0, 10, (200, 3))
    contact = random.random((200, 3)) < 0.7
    sizes[~contact] = np.nan
    _, events = watched(slips_of(sizes, contact=contact))
    t_s = [event.t_s for event in events]
    assert t_s == sorted(t_s)
    assert {event.pad for event in events} == {"pad0", "pad1", "pad2"}


def test_events_of_a_pad_alternate() -> None:
    random = np.random.default_rng(0)
    _, events = watched(slips_of(random.uniform(0, 10, 300), contact=random.random(300) < 0.8))
    for pair in ({"contact", "release"}, {"slip_start", "slip_stop"}):
        kinds = [event.event for event in events if event.event in pair]
        assert all(one != other for one, other in itertools.pairwise(kinds))


@given(
    sizes=st.lists(st.one_of(st.floats(0, 10), st.just(float("nan"))), min_size=1, max_size=30),
    cuts=st.lists(st.integers(0, 30), max_size=10),
)
def test_what_is_seen_does_not_depend_on_how_slips_are_cut(sizes: list[float], cuts: list[int]) -> None:
    slips = slips_of(sizes, contact=np.arange(len(sizes)) % 5 > 0)
    whole_flags, whole_events = watched(slips)
    flags, events = watched(*pieces(slips, [min(cut, len(sizes)) for cut in cuts]))
    np.testing.assert_array_equal(flags, whole_flags)
    assert events == whole_events


@pytest.mark.parametrize(
    "parameters",
    [
        {"start": 2.0},
        {"stop": 0.0},
        {"stop": -1.0},
        {"start": 0.0, "stop": 0.0},
        {"start": float("nan")},
        {"stop": float("nan")},
    ],
    ids=str,
)
def test_multiples_that_cannot_work_are_refused(parameters: dict[str, float]) -> None:
    with pytest.raises(ParameterInvalid, match="stop"):
        SlipMonitor(**parameters)
