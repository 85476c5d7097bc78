"""A stream's map, learned from its keyframes as a batch solves a contact."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.template.test_taxel_gains import PEAK, error, sliding
from taxelflow.estimation.template.bundle_adjustment import linearised
from taxelflow.estimation.template.contact_solver import solve_contact
from taxelflow.estimation.template.map import covering
from taxelflow.estimation.template.observations import Scanned
from taxelflow.estimation.template.online import map_update
from taxelflow.estimation.template.online.keyframes import Keyframes
from taxelflow.estimation.template.online.local_map import LocalMap
from taxelflow.estimation.template.online.map_update import _anchor, _tilt, _with_former_gains, learn
from taxelflow.estimation.template.solution import Hidden
from taxelflow.estimation.template.tilt import shift_by_tilt


def keyframes_of(scanned: Scanned, at: np.ndarray, gains: np.ndarray) -> LocalMap:
    """What a stream knows of these scans, each at a place (2,) of `at`, when its hypotheses are to be compared."""
    states = np.zeros((len(scanned), 5))
    states[:, :2], states[:, 3] = at, 1.0
    keyframes = Keyframes(scanned, states, states.copy())
    return LocalMap(covering(scanned, states), keyframes, 2.0, gains, unseen_error=0.05, taken=len(scanned))


def test_a_wrong_motion_is_given_up_though_gains_explain_it() -> None:
    """Gains with which an object that slides seems to move by half as much."""
    scanned, at, _ = sliding(0.1)
    mean = scanned.readings.mean(axis=0)
    wrong = np.clip(1.0 + 0.5 * (mean / mean.max() - 0.5), 0.5, 2.0)
    found = learn(keyframes_of(scanned, 0.5 * at, wrong))
    assert error(found.keyframes.states, at) < 0.05


def test_a_dead_taxel_is_masked_and_the_others_are_not() -> None:
    scanned, at, _ = sliding(0.0)
    dead = int(np.argmin(np.hypot(*scanned.places)))  # the object slides over it
    scanned.readings[:, dead] = 0.0
    found = learn(keyframes_of(scanned, at, np.ones(scanned.readings.shape[1])))
    assert np.flatnonzero(np.isinf(found.gains)).tolist() == [dead]
    assert error(found.keyframes.states, at) < 0.05


def test_a_taxel_that_answers_again_is_dead_no_longer() -> None:
    scanned, at, _ = sliding(0.0)
    gains = np.ones(scanned.readings.shape[1])
    gains[int(np.argmin(np.hypot(*scanned.places)))] = np.inf
    assert np.isfinite(learn(keyframes_of(scanned, at, gains)).gains).all()


def test_the_point_that_is_reported_is_where_the_load_lies_on_average_whatever_the_frame() -> None:
    scanned, at, _ = sliding(0.0)
    gains = np.ones(scanned.readings.shape[1])
    here, there = (learn(keyframes_of(scanned, place, gains)) for place in (at, 0.6 * at + 0.4))
    assert here.anchor is not None
    assert there.anchor is not None
    places = [found.keyframes.states[:, :2] + found.anchor.arm for found in (here, there) if found.anchor]
    np.testing.assert_allclose(places[0], places[1], atol=0.02)
    np.testing.assert_allclose(np.mean(places[0] - scanned.centroids(), axis=0), 0.0, atol=0.02)


def test_what_a_dead_taxel_reads_is_no_part_of_the_load() -> None:
    scanned, at, _ = sliding(0.0)
    gains = np.ones(scanned.readings.shape[1])
    gains[dead := int(np.argmin(np.hypot(*scanned.places)))] = np.inf
    found = []
    solved = solve_contact(replace(scanned, variance=scanned.variance.copy()))
    for stuck in (0.0, 5.0 * PEAK):
        scanned.readings[:, dead] = stuck
        found.append(_anchor(keyframes_of(scanned, at, gains), gains, solved))
    assert found[0] is not None
    assert found[1] is not None
    np.testing.assert_array_equal(found[0].arm, found[1].arm)


def test_a_tilt_of_the_load_moves_places_that_are_fitted_without() -> None:
    scanned, _, _ = sliding(0.0)
    solved = solve_contact(scanned)
    assert solved.error < 0.05
    precision = scanned.precision(turns=solved.turns, gain_std=solved.gain_std)
    upright = linearised(solved.pattern, scanned, solved.states, 0.05, precision).normal.blocks
    shifts = shift_by_tilt(upright, solved.pattern, scanned, solved.states, 0.05, 0.05)[-4:].mean(axis=0)
    np.testing.assert_allclose(_tilt(solved, scanned, 0.05), shifts[[0, 0, 1], [0, 1, 1]], rtol=0.02, atol=1e-6)
    assert np.trace(shifts) > 1e-4


def test_the_shift_by_a_tilt_turns_with_the_object() -> None:
    scanned, _, _ = sliding(0.0)
    solved = solve_contact(scanned)
    here, there = replace(scanned, places=scanned.places.copy()), replace(scanned, places=scanned.places[::-1].copy())
    there.places[0] *= -1.0  # the same readings on a pad that is turned by a quarter
    states = solved.states.copy()
    states[:, 0], states[:, 1], states[:, 2] = (
        -solved.states[:, 1],
        solved.states[:, 0],
        solved.states[:, 2] + np.pi / 2,
    )
    np.testing.assert_allclose(
        _tilt(replace(solved, states=states), there, 0.05), _tilt(solved, here, 0.05), rtol=1e-6, atol=1e-12
    )


def test_on_a_sensor_without_unseen_error_the_map_alone_is_the_frame() -> None:
    scanned, at, _ = sliding(0.0)
    known = keyframes_of(scanned, at, np.ones(scanned.readings.shape[1]))
    assert learn(replace(known, unseen_error=0.0)).anchor is None


def test_an_infinite_gain_masks_readings() -> None:
    scanned, _, _ = sliding(0.0)
    gains = np.full(scanned.readings.shape[1], 2.0)
    gains[3] = np.inf
    divided = replace(scanned, ceiling=np.full(gains.shape, PEAK)).divided(gains)
    assert (divided.variance[:, 3] == 0.0).all()
    np.testing.assert_array_equal(divided.readings[:, 4], 0.5 * scanned.readings[:, 4])
    assert divided.ceiling[4] == pytest.approx(0.5 * PEAK)


def test_gains_from_a_contact_before_are_not_likelier_for_making_readings_smaller() -> None:
    scanned, at, _ = sliding(0.0)
    solved = replace(solve_contact(scanned), gains=np.zeros(0))
    scattered = 1.0 + 0.002 * np.random.default_rng(0).normal(size=scanned.readings.shape[1])
    wrong = keyframes_of(scanned, at, 1.02 * scattered)  # cheaper by 62 if densities of divided readings are compared
    np.testing.assert_array_equal(_with_former_gains(wrong, scanned, solved).gains, 1.0)


def test_a_hidden_direction_is_tested_again_when_half_as_many_keyframes_have_come() -> None:
    scanned, at, _ = sliding(0.0)
    known = replace(keyframes_of(scanned, at, np.ones(scanned.readings.shape[1])), hidden=Hidden(*np.eye(2)))
    kept, again = (learn(replace(known, tested=int(share * len(scanned)))) for share in (0.9, 0.5))
    assert (kept.hidden.direction.tolist(), kept.tested) == ([1.0, 0.0], int(0.9 * len(scanned)))
    assert (again.hidden.direction.tolist(), again.tested) == ([0.0, 0.0], len(scanned))


@pytest.mark.parametrize(("taken", "early", "late", "again"), [(40, 37, 36, 26), (200, 175, 170, 133)])
def test_hypotheses_are_compared_again_sooner_where_a_keyframe_does_not_fit(
    taken: int, early: int, late: int, again: int
) -> None:
    scanned, at, _ = sliding(0.0)
    known = replace(keyframes_of(scanned, at, np.ones(scanned.readings.shape[1])), taken=taken)
    assert [learn(replace(known, looked=looked)).looked for looked in (late, again)] == [late, taken]
    scanned.readings[20] = scanned.readings[20, ::-1]
    assert [learn(replace(known, looked=looked)).looked for looked in (early, late)] == [early, taken]


@pytest.mark.parametrize(("apart_rad", "reported"), [(0.4, True), (0.6, False)])
def test_a_turn_is_reported_once_no_hypothesis_that_fits_as_well_is_far(apart_rad: float, reported: bool) -> None:
    scanned, at, _ = sliding(0.0)
    alike = keyframes_of(scanned, at, np.ones(scanned.readings.shape[1]))
    alike = replace(alike, turns=True, looked=len(scanned), slack=np.zeros(2), rival=np.array([0.0, apart_rad**2]))
    found = learn(alike)
    assert (found.turns, found.reports_turn) == (True, reported)
    assert learn(replace(alike, reports_turn=True)).reports_turn  # its deviation states how far


def test_a_keyframe_that_does_not_fit_turns_no_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    scanned, at, _ = sliding(0.0)
    known = replace(keyframes_of(scanned, at, np.ones(scanned.readings.shape[1])), turns=True)
    best = replace(solve_contact(scanned), turns=True)
    best.states[-1, 2] += 2.0
    monkeypatch.setattr(map_update, "_best", lambda known: (best, known.looked))
    turned = [learn(known).turned]
    best.fit.chi[-1] *= 1e3
    turned.append(learn(known).turned)
    assert turned == pytest.approx([2.0, 0.0], abs=0.01)
