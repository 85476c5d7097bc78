from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from taxelflow.numerics.rest_or_slide import Unexplained
from taxelflow.numerics.robust import CLEARLY
from taxelflow.slip.evidence import (
    CHANGE,
    REST_S,
    SLIDE_S,
    UNTOUCHED,
    distance,
    joint_log_likelihood_ratio,
    log_likelihood_ratio,
    looked_back,
    tilt_log_ratio,
    tilt_over_slide,
    updated,
)

if TYPE_CHECKING:
    from taxelflow.messages import Floats

STEP_S = 0.1
RATIOS = st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=1, max_size=6)


def ratio(change: float, rise: float = 0.0, noise: float = 0.0, growth: float = 0.075) -> float:
    power = (np.array([number]) for number in (change**2, noise**2, rise, growth))
    return float(log_likelihood_ratio(*power)[0])


def test_a_change_between_rest_and_slip_is_no_evidence() -> None:
    assert ratio(CHANGE.at_rest * np.sqrt(6)) == pytest.approx(0, abs=1e-9)
    assert ratio(CHANGE.at_rest) < -2
    assert ratio(6 * CHANGE.at_rest) > 2


@given(st.floats(1e-4, 1), st.floats(1e-4, 1), st.floats(0, 2), st.floats(0, 0.5))
def test_more_change_is_more_evidence_and_load_and_noise_make_it_less(
    a: float, b: float, rise: float, noise: float
) -> None:
    low, high = sorted((a, b))
    assert ratio(low, rise, noise) <= ratio(high, rise, noise)
    assert ratio(a, rise, noise) <= ratio(a)
    assert np.isfinite(ratio(0.0))


FAR = st.floats(-6, 6)


@given(FAR, FAR, FAR)
def test_two_witnesses_are_alike_and_each_more_is_more(pattern: float, shear: float, more: float) -> None:
    ratio = float(joint_log_likelihood_ratio(np.array(pattern), np.array(shear)))
    assert ratio == pytest.approx(float(joint_log_likelihood_ratio(np.array(shear), np.array(pattern))))
    low, high = sorted((shear, more))
    one, other = (float(joint_log_likelihood_ratio(np.array(pattern), np.array(far))) for far in (low, high))
    assert one <= other


def test_a_joint_ratio_is_that_of_correlated_normal_numbers() -> None:
    shift, correlation = np.log(6) / 0.6, 0.3
    covariance = np.array([[1, correlation], [correlation, 1]])
    rest, slip = (multivariate_normal(mean * np.ones(2), covariance) for mean in (0, shift))
    for far in ((0.0, 0.0), (2.0, 0.5), (1.0, 3.0)):
        expected = slip.logpdf(far) - rest.logpdf(far)
        assert joint_log_likelihood_ratio(*map(np.array, far)) == pytest.approx(expected)


def test_a_distance_counts_from_what_is_usual() -> None:
    share, rise, growth = np.array([0.02**2]), np.array([0.0]), np.array([0.1])
    assert distance(share, 0.02, np.zeros(1), rise, growth)[0] == pytest.approx(0)
    assert distance(share, 0.01, np.zeros(1), rise, growth)[0] == pytest.approx(np.log(2) / 0.6)


def test_no_change_at_all_is_usual_where_nothing_ever_changes() -> None:
    none = np.zeros(1)
    assert distance(none, 0.0, none, none, none) == [0.0]


def enumerated(ratios: list[tuple[float, float]], judged: int) -> float:
    """Odds that the object slides in a bin, by summing over all courses of rest, tilt and slip; it rests before."""
    begins, ends = -np.expm1(-STEP_S / REST_S), -np.expm1(-STEP_S / SLIDE_S)
    stays = 1 - begins
    chances = [[stays**2, begins * stays, begins], [begins * stays, stays**2, begins], [ends, 0.0, 1 - ends]]
    total = [0.0, 0.0, 0.0]
    for course in product((0, 1, 2), repeat=len(ratios)):
        weight, last = 1.0, 0
        for state, one in zip(course, ratios, strict=True):
            weight *= chances[last][state] * np.exp((0.0, *one)[state])
            last = state
        total[course[judged]] += weight
    return total[2] / (total[0] + total[1])


def odds_of(shares: Floats) -> float:
    return float(shares[2, 0] / (shares[0, 0] + shares[1, 0]))


@given(RATIOS, st.integers(0, 5))
def test_odds_are_those_of_all_courses(ratios: list[tuple[float, float]], judged: int) -> None:
    judged = min(judged, len(ratios) - 1)
    touching = np.ones(1, dtype=np.bool_)
    shares, later = UNTOUCHED, np.ones((3, 1))
    for one in ratios[: judged + 1]:
        shares = updated(shares, np.array([one]).T, touching, STEP_S)
    assert odds_of(shares) == pytest.approx(enumerated(ratios[: judged + 1], judged), rel=1e-6)
    for one in ratios[:judged:-1]:
        later = looked_back(later, np.array([one]).T, touching, STEP_S)
    assert odds_of(shares * later) == pytest.approx(enumerated(ratios, judged), rel=1e-6)


def test_without_contact_nothing_slides_and_nothing_is_known_of_it() -> None:
    apart, ratios = np.zeros(1, dtype=np.bool_), np.full((2, 1), 5.0)
    assert updated(np.array([[0.1], [0.0], [0.9]]), ratios, apart, STEP_S).tolist() == UNTOUCHED.tolist()
    assert looked_back(np.full((3, 1), 9.0), ratios, apart, STEP_S).tolist() == [[1.0], [1.0], [1.0]]


def test_odds_return_to_the_prior_where_there_is_no_evidence() -> None:
    shares, touching = np.array([[0.01], [0.01], [0.98]]), np.ones(1, dtype=np.bool_)
    for _ in range(100):
        shares = updated(shares, np.full((2, 1), np.nan), touching, STEP_S)
    assert odds_of(shares) == pytest.approx(0.7 / 5.0, rel=0.1)
    assert np.isfinite(updated(UNTOUCHED, np.zeros((2, 1)), touching, np.inf)).all()


def left_of(left: float, free: float = 1e9) -> Unexplained:
    """left: logarithm of what a slide leaves over what rest does."""
    return Unexplained(float(np.exp(2.0 * left)), 1.0, 1.0, free_slide=free, free_rest=free)


def course(log_ratio: float, lefts: list[float]) -> list[float]:
    """Odds of a slip after each bin of a change with this ratio. lefts: see `left_of`."""
    shares, found = UNTOUCHED, []
    for left in lefts:
        tilts = tilt_log_ratio(np.array([log_ratio]), np.array([tilt_over_slide(left_of(left))]))
        shares = updated(shares, np.stack([tilts, [log_ratio]]), np.ones(1, dtype=np.bool_), STEP_S)
        found.append(odds_of(shares))
    return found


def test_what_tilts_is_no_slip_though_it_looks_like_one_for_a_moment() -> None:
    clearly = float(np.log(CLEARLY))
    assert max(course(8.0, [clearly] * 4 + [-clearly] + [clearly] * 20)) < 1
    assert min(course(8.0, [-clearly] * 4 + [clearly] + [-clearly] * 4)) > 1


def test_few_taxels_say_little_of_a_tilt() -> None:
    few, many = (tilt_over_slide(left_of(1.0, free)) for free in (1.0, 30.0))
    assert 0 < few < 0.5 * many
    assert np.isnan(tilt_over_slide(Unexplained(1.0, 1.0, 1.0, free_rest=0.5)))


def test_a_change_that_is_not_compared_is_no_tilt() -> None:
    unknown = np.full(2, np.nan)
    assert tilt_log_ratio(np.array([6.0, -3.0]), unknown).tolist() == [0.0, -3.0]
    assert course(6.0, [np.nan, np.nan])[-1] > 20
