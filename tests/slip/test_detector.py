from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sliding import NAN, RATE_HZ, STD, kinds, noise, slid, slips_of, watched
from taxelflow.messages import AMBIGUOUS, LOST, OK, UNRESOLVED, Event, Floats, Slips
from taxelflow.slip.parameters import SlipMonitor


@pytest.mark.parametrize("speed_m_s", [0.003, 0.015, 0.1])
@pytest.mark.parametrize("direction", [0.0, 2.0, -1.2])
def test_a_slip_is_found_with_its_time_direction_and_speed(speed_m_s: float, direction: float) -> None:
    velocity = (speed_m_s * np.cos(direction), speed_m_s * np.sin(direction), 0.0)
    flags, events, _ = watched(slips_of(slid(velocity)))
    assert kinds(events) == ["contact", "slip_start", "slip_stop"]
    start, stop = events[1:]
    late = 8 if speed_m_s < 0.01 else 3
    assert 1.0 < start.t_s <= 1.0 + late / RATE_HZ
    assert start.onset_s == pytest.approx(1.0, abs=late / RATE_HZ)
    assert start.onset_s < start.t_s
    assert 2.0 < stop.t_s <= 2.0 + late / RATE_HZ
    assert stop.onset_s == pytest.approx(2.0, abs=late / RATE_HZ)
    assert stop.speed_m_s == pytest.approx(speed_m_s, rel=0.05)
    assert math.remainder(stop.direction_rad - direction, math.tau) == pytest.approx(0, abs=0.05)
    assert abs(stop.turn_rad_s) < 0.02
    assert flags[110:200].all()
    assert not flags[:101].any()
    assert not flags[210:].any()


def test_a_turn_in_place_is_a_slip() -> None:
    _, events, _ = watched(slips_of(slid((0.0, 0.0, -0.5))))
    assert kinds(events) == ["contact", "slip_start", "slip_stop"]
    assert events[2].turn_rad_s == pytest.approx(-0.5, rel=0.05)
    assert events[2].speed_m_s < 5e-4


def test_where_the_turn_is_unknown_it_stays_so_and_translation_is_found() -> None:
    _, events, _ = watched(slips_of(slid((0.01, 0.0, 5.0)), theta=False))
    assert kinds(events) == ["contact", "slip_start", "slip_stop"]
    assert np.isnan(events[1].turn_rad_s)
    assert np.isnan(events[2].turn_rad_s)
    assert kinds(watched(slips_of(slid((0.0, 0.0, 5.0)), theta=False))[1]) == ["contact"]


def on_a_line(along_m: Floats, load: Any = 1.0) -> Slips:
    """Slips of a pad that is one column: what is across is unknown, and no scan is ok."""
    pose = np.stack([np.zeros(len(along_m)), along_m + noise(len(along_m))[:, 1], np.full(len(along_m), NAN)], axis=1)
    slips = slips_of(pose, load=np.broadcast_to(load, len(along_m)), theta=False)
    slips.covariance[..., 0, 0], slips.displacement_covariance[..., 0, 0] = 0.05**2, 2 * 0.05**2
    slips.quality[:] = AMBIGUOUS
    return slips


@pytest.mark.parametrize("speed_m_s", [0.003, -0.05])
def test_a_line_of_taxels_finds_the_slip_along_it(speed_m_s: float) -> None:
    way_m = np.clip(np.arange(300) - 100, 0, 100) / RATE_HZ * speed_m_s
    _, events, _ = watched(on_a_line(way_m))
    assert kinds(events) == ["contact", "slip_start", "slip_stop"]
    start, stop = events[1:]
    assert (start.onset_s, stop.onset_s) == pytest.approx((1.0, 2.0), abs=0.08)
    assert stop.speed_m_s == pytest.approx(abs(speed_m_s), rel=0.05)
    assert stop.direction_rad == pytest.approx(math.copysign(math.pi / 2, speed_m_s), abs=1e-6)


def test_what_is_known_exactly_across_does_not_hide_what_is_along() -> None:
    slips = on_a_line(np.clip(np.arange(300) - 100, 0, 100) / RATE_HZ * 0.01)
    slips.covariance[..., 0, 0] = slips.displacement_covariance[..., 0, 0] = 0.0
    slips.covariance[..., 1, 1] *= 100.0
    slips.displacement_covariance[..., 1, 1] *= 100.0
    assert kinds(watched(slips)[1]) == ["contact", "slip_start", "slip_stop"]


def test_a_line_of_taxels_takes_no_load_for_slip() -> None:
    load = np.exp(0.5 * np.sin(math.pi * np.arange(3000) / RATE_HZ))
    assert kinds(watched(on_a_line(5e-4 * np.log(load), load))[1]) == ["contact"]


def test_a_line_of_taxels_is_watched_after_its_load_has_fallen() -> None:
    scan = np.arange(800)
    _, events, _ = watched(on_a_line(0.02 * np.clip(scan - 400, 0, 50) / RATE_HZ, np.where(scan < 200, 10.0, 4.0)))
    assert kinds(events) == ["contact", "slip_start", "slip_stop"]


def test_a_turn_that_is_known_only_now_and_then_does_not_alarm() -> None:
    slips = slips_of(noise(2000))
    gaps = np.arange(2000) % 7 == 5
    slips.displacement[np.roll(gaps, 1), :, 2] += 0.05  # found again, but elsewhere
    slips.displacement[gaps, :, 2] = NAN
    slips.displacement_covariance[gaps, :, 2, 2] = NAN
    assert kinds(watched(slips)[1]) == ["contact"]


@given(unit_m=st.floats(0.1, 10), clock=st.floats(0.2, 5))
@settings(max_examples=20)
def test_with_nothing_but_noise_neither_unit_nor_clock_matter(unit_m: float, clock: float) -> None:
    slips = slips_of(slid((0.02, 0.0, 0.0)))
    parameters = SlipMonitor(creep_m_s=0.0, load_m=0.0, settle_s=0.0, alarms_per_hour=60 / clock)
    scaled = slips_of(slid((0.02, 0.0, 0.0)), t_s=slips.t_s * clock)
    scaled.displacement[...] *= [unit_m, unit_m, 1]
    scaled.displacement_covariance[...] *= np.outer([unit_m, unit_m, 1], [unit_m, unit_m, 1])
    starts = [
        next(round(e.t_s / each.t_s[1]) for e in watched(each, monitor=monitor)[1] if e.event == "slip_start")
        for each, monitor in ((slips, replace(parameters, alarms_per_hour=60.0)), (scaled, parameters))
    ]
    assert starts[0] == starts[1]


def test_motion_that_follows_the_load_is_no_slip() -> None:
    t_s = np.arange(3000) / RATE_HZ
    load = np.exp(0.8 * np.sin(2 * np.pi * t_s / 2))
    moved = 3e-4 * np.log(load)[:, np.newaxis] * [1.0, -0.5, 10.0]
    assert kinds(watched(slips_of(noise(3000) + moved, load=load))[1]) == ["contact"]
    assert "slip_start" in kinds(watched(slips_of(noise(3000) + moved))[1])  # unless the load is not seen to change


def test_noise_that_load_and_pose_share_is_no_slip_that_the_load_hides() -> None:
    t_s = np.arange(6000) / RATE_HZ
    for seed in range(10):
        shared, pose = np.random.default_rng(100 + seed).standard_normal(6000), noise(6000, seed)
        pose[:, 0] = np.sqrt(0.75) * pose[:, 0] + 0.5 * STD[0] * shared
        load = np.exp(14.0 + 0.8 * np.sin(np.pi * t_s) + 0.012 * shared)
        assert kinds(watched(slips_of(pose, load=load, theta=False))[1]) == ["contact"]


def test_a_covariance_too_large_under_load_does_not_make_the_unloaded_pose_look_surer() -> None:
    t_s = np.arange(6000) / RATE_HZ
    load = np.exp(np.sin(2 * np.pi * t_s / 2))
    pose = noise(6000)
    pose[load > 1] *= 0.3
    alone = np.flatnonzero(load < 0.5)[::50]
    pose[alone, 0] = 5.1 * STD[0]
    changing, steady = (watched(slips_of(pose, load=each, theta=False)) for each in (load, None))
    assert changing[2].scatter[0] == pytest.approx(steady[2].scatter[0], abs=0.05)
    assert steady[2].scatter[0] < 0.9
    assert kinds(changing[1]) == ["contact"]
    assert "slip_start" in kinds(steady[1])


def test_what_is_left_of_a_contact_is_judged_only_where_its_pose_is_ok() -> None:
    load = np.where(np.arange(300) < 50, 1e6, 2e5)
    moved = slid((0.01, 0.0, 0.0))
    for quality, found in ((OK, True), (AMBIGUOUS, False)):
        slips = slips_of(moved, load=load)
        slips.quality[60:] = quality
        assert ("slip_start" in kinds(watched(slips)[1])) == found
    slips = slips_of(moved, load=np.where(np.arange(300) < 70, load, 1e6))  # held again
    slips.quality[60:] = AMBIGUOUS
    assert "slip_start" in kinds(watched(slips)[1])
    slips = slips_of(moved, load=load)
    slips.quality[60:] = AMBIGUOUS
    slips.contact[60:62] = False  # let go and touched anew
    assert "slip_start" in kinds(watched(slips)[1])


def test_a_contact_whose_load_fell_from_the_peak_of_its_impact_is_judged() -> None:
    """A finger that closes fast hits the object: the contact's first scan has several times the load that stays."""
    load = np.full(300, 2e5)
    load[0] = 6.5e5
    slips = slips_of(slid((0.02, 0.0, 0.0)), load=load)
    slips.quality[...] = AMBIGUOUS  # cut by the border
    _, events, _ = watched(slips)
    assert kinds(events) == ["contact", "slip_start", "slip_stop"]


def test_a_pose_that_noise_put_where_it_claims_to_be_sure_is_no_slip() -> None:
    drawn = np.random.default_rng(4).standard_normal(3000)
    steep = 0.5  # the pose is no linear function of the noise, and its covariance belongs to where it came to lie
    pose = noise(3000)
    pose[:, 0] = 2e-5 * np.expm1(steep * drawn) / steep
    slips = slips_of(pose)
    slips.displacement_covariance[:, 0, 0, 0] = 2 * (2e-5 * np.exp(steep * drawn)) ** 2
    assert kinds(watched(slips)[1]) == ["contact"]


def test_what_was_usual_at_another_place_or_once_is_forgotten() -> None:
    moved = slid((0.01, 0.0, 0.0), begin=100, end=130) + slid((0.01, 0.0, 0.0), begin=190, end=230) - noise(300)
    plain = [event.t_s for event in watched(slips_of(moved))[1]]
    slips = slips_of(moved)
    slips.displacement_covariance[:100] *= 25  # less well known where it rested first
    assert [event.t_s for event in watched(slips)[1]][3] == plain[3]
    slips = slips_of(moved)
    slips.displacement_covariance[165:167] *= 1e4
    assert [event.t_s for event in watched(slips)[1]][3] <= plain[3] + 1.1 / RATE_HZ


def test_creep_is_no_slip() -> None:
    creep = np.arange(6000)[:, np.newaxis] / RATE_HZ * [1e-4, 0.0, 0.0]
    assert kinds(watched(slips_of(noise(6000) + creep))[1]) == ["contact"]


def test_a_correction_of_the_map_moves_the_pose_and_is_no_slip() -> None:
    slips = slips_of(noise(300))
    slips.pose[150:, 0, 0] += 1e-3
    assert kinds(watched(slips)[1]) == ["contact"]


def test_a_slip_at_once_after_contact_waits_until_the_contact_has_settled() -> None:
    flags, _, _ = watched(slips_of(slid((0.05, 0.0, 0.0), begin=0, end=60)))
    assert not flags[:11].any()
    assert flags[20:60].all()
    flags, _, _ = watched(slips_of(slid((0.05, 0.0, 0.0), begin=0, end=60)), monitor=SlipMonitor(settle_s=0.3))
    assert not flags[:31].any()


@pytest.mark.parametrize("lost", ["displacement", "quality"])
def test_an_unknown_displacement_ends_a_slip_and_what_follows_begins_anew(lost: str) -> None:
    slips = slips_of(slid((0.01, 0.0, 0.0)))
    if lost == "displacement":
        slips.displacement[150] = NAN
    else:
        slips.quality[150] = LOST
    flags, events, _ = watched(slips)
    assert flags[140:150].all()
    assert not flags[150:160].any()
    assert kinds(events) == ["contact", "slip_start", "slip_stop", "slip_start", "slip_stop"]


@pytest.mark.parametrize(("silent", "slides_on"), [(slice(5, None, 10), True), (slice(140, 165), False)])
def test_a_pad_without_a_reading_for_a_moment_slips_on(silent: slice, slides_on: bool) -> None:
    slips = slips_of(slid((0.02, 0.0, 0.0)), load=np.ones(300))
    slips.load[silent] = 0.0
    for known in (slips.pose, slips.covariance, slips.displacement, slips.displacement_covariance):
        known[silent] = np.nan
    heard = np.flatnonzero(slips.load[:, 0])
    slips.displacement[heard[1:]] = np.diff(slips.pose[heard], axis=0)
    flags, _, _ = watched(slips)
    assert flags[120:140].all()
    assert flags[150, 0] == slides_on  # after 0.1 s it is a new contact


def test_a_pose_that_does_not_fit_counts_less() -> None:
    slips = slips_of(slid((0.004, 0.0, 0.0)))
    sure = watched(slips)[1][1].t_s
    slips.quality[...] = UNRESOLVED
    assert watched(slips)[1][1].t_s > sure


def test_fewer_false_alarms_cost_a_later_onset() -> None:
    slips = slips_of(slid((0.003, 0.0, 0.0)))
    onsets = [watched(slips, monitor=SlipMonitor(alarms_per_hour=rate))[1][1].t_s for rate in (1000.0, 1.0, 1e-6)]
    assert onsets == sorted(onsets)
    assert onsets[0] < onsets[2]


def test_poses_that_share_a_scan_are_not_taken_for_independent() -> None:
    single = noise(40_000)
    mean = 0.5 * (single[1:] + single[:-1])
    slips = slips_of(mean)
    slips.lag_s[...] = 0.5 / RATE_HZ
    slips.displacement_covariance[...] = np.diag(STD**2) / 2
    _, events, session = watched(slips)
    assert kinds(events) == ["contact"]
    assert session.scatter[0] == pytest.approx(1, abs=0.06)


def test_without_noise_a_still_object_is_still_and_any_motion_is_slip() -> None:
    slips = slips_of(np.zeros((100, 3)))
    slips.displacement_covariance[...] = 0
    assert kinds(watched(slips)[1]) == ["contact"]
    slips.displacement[50:60, 0, 0] = 1e-3
    flags, _, _ = watched(slips)
    assert flags[52:60].all()


def test_a_disturbance_counts_where_there_is_no_displacement() -> None:
    slips = slips_of(noise(300))
    slips.displacement[...] = NAN
    slips.disturbance[:, 0] = np.abs(np.random.default_rng(0).standard_normal(300))
    slips.disturbance[100:103, 0] = 7.0
    flags, events, _ = watched(slips)
    assert flags[:, 0].nonzero()[0].tolist() == [100, 101, 102]
    assert events[1] == Event(1.0, "pad0", "slip_start", 1.0)
    assert np.isnan(events[1].speed_m_s)


def test_a_slow_slip_that_seemed_to_stop_goes_on() -> None:
    """A stop that poses refute is withdrawn, though none of them excludes that the object stops just now."""
    for seed in range(4):
        t_s = np.arange(600) / RATE_HZ
        pose = 5.0 * noise(600, seed)
        pose[:, 0] += 1e-3 * np.clip(t_s - 1.5, 0.0, 3.0)
        slips = slips_of(pose)
        slips.displacement_covariance[:] *= 25.0
        flags, events, _ = watched(slips)
        assert flags[200:450, 0].mean() > 0.7
        assert not flags[500:].any()
        starts = [event.onset_s for event in events if event.event == "slip_start"]
        assert len(set(starts)) == 1
