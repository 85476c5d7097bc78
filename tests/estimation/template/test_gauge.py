"""The gauge of a stream's map: what was reported stays where it was on average when the map is adjusted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimation.template.test_map_update import keyframes_of
from estimation.template.test_taxel_gains import sliding
from taxelflow.estimation.template.hypotheses import solve
from taxelflow.estimation.template.online.gauge import Reported, align_gauge, hold, turn_of_frame
from taxelflow.estimation.template.online.keyframes import Keyframes
from taxelflow.estimation.template.online.local_map import LocalMap
from taxelflow.estimation.template.online.track_state import Track
from taxelflow.estimation.template.online.witness import anchor, arm_on_map, find_centre, reported_place
from taxelflow.numerics.geometry import turned
from taxelflow.numerics.records import record, records
from taxelflow.numerics.rounding import BLURRED

PITCH_M = 3e-3
seeds = st.integers(0, 2**32 - 1)


def track() -> Track:
    m = record(Track, records(Track, 1), 0)
    m.state[:] = [1.0, 2.0, 0.5, 1.0, 0.0]
    m.theta_0, m.arm_load, m.arm[:], m.centroid[:] = 0.2, 1.0, [0.3, -0.1], [1.2, 2.1]
    return m


def turning(seed: int, scatter: float = 0.5) -> tuple[LocalMap, Reported, np.ndarray, np.ndarray]:
    """A map of an object that turns, and where each of its keyframes was reported (n, 2), with its variance (n,).

    scatter: of the places, standard deviation.
    """
    random = np.random.default_rng(seed)
    scanned, at, _ = sliding(0.0)
    learned = keyframes_of(scanned, at, np.ones(scanned.readings.shape[1]))
    states = learned.keyframes.states
    states[:, 2] = random.uniform(-2.0, 2.0, len(states))
    places, reported = states[:, :2] + random.normal(0.0, scatter, (len(states), 2)), Reported()
    variances = random.uniform(0.01, 1.0, len(states))
    for t_s, place, variance in zip(scanned.t_s.tolist(), places, variances.tolist(), strict=True):
        reported.add(t_s, place, variance)
    return replace(learned, turns=True), reported, places, variances


def left(m: Track, keyframes: Keyframes, places: np.ndarray) -> np.ndarray:
    """(n, 2), how far keyframes were reported from where they are now, in the object's frame."""
    return np.array(
        [
            turned(place - reported_place(m, state), m.theta_0 - state[2])
            for place, state in zip(places, keyframes.states, strict=True)
        ]
    )


def held(seed: int, times: int = 1, scatter: float = 0.5) -> tuple[Track, np.ndarray, np.ndarray, np.ndarray]:
    """A frame that is held this often; how far its keyframes were reported from it (n, 2), their weights, variances."""
    learned, reported, places, variances = turning(seed, scatter)
    m = track()
    t_s = learned.keyframes.scanned.t_s
    m.last_t = t_s[-1] + 0.7
    for _ in range(times):
        hold(m, learned, reported, PITCH_M)
    weights = np.diff(np.append(t_s, m.last_t)) / (2.0 * BLURRED**2 + variances)
    return m, left(m, learned.keyframes, places), weights, variances


@given(seeds)
def test_keyframes_stay_where_they_were_on_average_by_their_time_and_precision(seed: int) -> None:
    _, gaps, weights, _ = held(seed)
    np.testing.assert_allclose(weights @ gaps, 0.0, atol=1e-9)


@given(seeds)
def test_the_frame_is_as_uncertain_as_keyframes_were_reported_apart_beyond_their_variance(seed: int) -> None:
    """However often the map is adjusted: a frame that is held does not add up its steps."""
    m, gaps, weights, variances = held(seed, times=3, scatter=2.0)
    excess = np.average(np.sum(gaps**2, axis=1) - variances, weights=weights)
    np.testing.assert_allclose(m.wander, 0.5 * max(excess, 0.0))


def test_keyframes_reported_apart_by_less_than_their_deviations_do_not_doubt_the_frame() -> None:
    assert held(0, scatter=0.01)[0].wander == 0.0


def test_the_frame_of_an_object_that_was_known_before_is_not_held() -> None:
    learned, reported, _, _ = turning(0)
    m = track()
    m.arm_load = np.inf
    hold(m, learned, reported, PITCH_M)
    assert not m.gauge.any()
    assert m.wander == 0.0


@given(seeds)
def test_a_map_that_has_not_changed_moves_nothing(seed: int) -> None:
    learned, reported, _, _ = turning(seed)
    m = track()
    hold(m, learned, reported, PITCH_M)
    before = m.gauge.copy()
    hold(m, learned, reported, PITCH_M)
    np.testing.assert_allclose(m.gauge, before, atol=1e-12)


@given(seeds)
def test_the_change_of_the_reported_point_is_no_motion_of_the_centre_of_pressure(seed: int) -> None:
    learned, reported, _, _ = turning(seed)
    m = track()
    before, after = np.zeros(5), np.zeros(5)
    find_centre(PITCH_M, m, before)
    m.before_centre[:] = before
    hold(m, learned, reported, PITCH_M)
    find_centre(PITCH_M, m, after)
    assert np.hypot(*m.gauge) > 0.0
    np.testing.assert_allclose(m.before_centre, after, atol=1e-12)


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_an_object_that_comes_again_is_reported_by_the_same_point(theta: float, theta_0: float) -> None:
    m = track()
    m.gauge[:] = 0.2, -0.4
    known, middle = arm_on_map(m), np.array([3.0, 4.0])
    on_map = turned(m.arm + m.gauge, -m.theta_0)  # the point in the map's frame
    m.gauge[:] = 7.0
    m.state[2], m.theta_0 = theta, theta_0
    anchor(m, middle, known)
    np.testing.assert_allclose(reported_place(m, m.state) - m.state[:2], turned(on_map, theta), atol=1e-9)


@pytest.mark.parametrize("case", ["does not turn", "grows", "changes", "known before", "in line"])
def test_the_point_stays_on_the_centre_of_pressure(case: str) -> None:
    learned, reported, _, _ = turning(0)
    m = track()
    learned.turns, learned.grows = case != "does not turn", case == "grows"
    learned.changing = case == "changes"
    m.arm_load = np.inf if case == "known before" else 1.0
    m.across[0] = 3.0 if case == "in line" else 0.0
    hold(m, learned, reported, PITCH_M)
    np.testing.assert_array_equal(m.gauge, 0.0)


def test_an_object_that_was_never_reported_stays_on_the_centre_of_pressure() -> None:
    learned, _, _, _ = turning(0)
    m = track()
    hold(m, learned, Reported(), PITCH_M)
    np.testing.assert_array_equal(m.gauge, 0.0)


@given(seeds, st.integers(1, 12))
def test_keyframes_that_are_left_out_leave_their_time_to_the_nearest(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    times, reported = np.cumsum(random.uniform(0.01, 1.0, 12)), Reported()
    for t_s in times.tolist():
        reported.add(t_s, np.zeros(2), 1.0)
    kept = np.sort(random.choice(times, count, replace=False))
    reported.thin(kept)
    assert reported.places["t_s"].tolist() == [t for t in times.tolist() if t in kept or t > kept[-1]]
    np.testing.assert_allclose(reported.places["span_s"].sum(), times[-1] - times[0])


def test_places_of_a_contact_before_are_left_out() -> None:
    learned, reported, _, _ = turning(0)
    m = track()
    reported.clear()
    reported.add(float(learned.keyframes.scanned.t_s[-1]), reported_place(m, learned.keyframes.states[-1]) + 1.0, 0.1)
    hold(m, learned, reported, PITCH_M)
    assert len(reported.places) == 1
    np.testing.assert_allclose(np.hypot(*m.gauge), np.sqrt(2.0))


@pytest.mark.parametrize("angle", [np.pi, 2.0 * np.pi / 3.0])
def test_a_frame_goes_with_the_newest_contact_where_its_object_is_found_at_another_angle(angle: float) -> None:
    """An object that looks the same after a turn: the map has turned its last eight keyframes by that much."""
    scanned, at, _ = sliding(0.0)
    known = replace(keyframes_of(scanned, at, np.ones(scanned.readings.shape[1])), turns=True)
    before, last, middle = known.keyframes.states, slice(-8, None), np.array([0.8, -0.5])
    before[:, 2] = np.linspace(0.0, 0.7, len(before))
    best = replace(solve(scanned), states=before.copy(), turns=True)
    best.states[last, 2] -= angle
    best.states[last, :2] += turned(middle, before[last, 2]) - turned(middle, best.states[last, 2])
    turn, alike = turn_of_frame(before, best, known, newest=len(before) - 1)
    assert turn == pytest.approx(-angle)
    np.testing.assert_array_equal(np.flatnonzero(alike), np.arange(len(before))[last])
    states, _, off = align_gauge(before, best, scanned, turn, alike)
    np.testing.assert_allclose(states[last, :2], before[last, :2], atol=1e-9)
    np.testing.assert_allclose(off[last], 0.0, atol=1e-9)
