from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from taxelflow.slip.evidence import (
    CHANGE,
    distance,
    joint_log_likelihood_ratio,
    log_likelihood_ratio,
    looked_back,
    predicted,
    updated,
)

STEP_S = 0.1
QUIET = np.zeros(1)
RATIOS = st.lists(st.floats(-5, 5), min_size=1, max_size=6)


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


def enumerated(ratios: list[float], judged: int) -> float:
    """Odds that the object slides in a bin, by summing over all courses of rest and slip; it rests before."""
    begins = float(predicted(np.zeros(1), STEP_S)[0])
    begins /= 1 + begins
    stays = float(predicted(np.array([1e12]), STEP_S)[0])
    stays /= 1 + stays
    total = [0.0, 0.0]
    for course in product((0, 1), repeat=len(ratios)):
        weight, last = 1.0, 0
        for state, one in zip(course, ratios, strict=True):
            slides = stays if last else begins
            weight *= slides * np.exp(one) if state else 1 - slides
            last = state
        total[course[judged]] += weight
    return total[1] / total[0]


@given(RATIOS, st.integers(0, 5))
def test_odds_are_those_of_all_courses(ratios: list[float], judged: int) -> None:
    judged = min(judged, len(ratios) - 1)
    touching = np.ones(1, dtype=np.bool_)
    odds, later = np.zeros(1), np.ones(1)
    for one in ratios[: judged + 1]:
        odds = updated(odds, np.array([one]), touching, STEP_S)
    assert odds[0] == pytest.approx(enumerated(ratios[: judged + 1], judged), rel=1e-6)
    for one in ratios[:judged:-1]:
        later = looked_back(later, np.array([one]), touching, STEP_S)
    assert (odds * later)[0] == pytest.approx(enumerated(ratios, judged), rel=1e-6)


def test_without_contact_nothing_slides_and_nothing_is_known_of_it() -> None:
    apart = np.zeros(1, dtype=np.bool_)
    assert updated(np.array([9.0]), np.array([5.0]), apart, STEP_S).tolist() == [0.0]
    assert looked_back(np.array([9.0]), np.array([5.0]), apart, STEP_S).tolist() == [1.0]


def test_odds_return_to_the_prior_where_there_is_no_evidence() -> None:
    odds, touching = np.array([50.0]), np.ones(1, dtype=np.bool_)
    for _ in range(100):
        odds = updated(odds, np.array([np.nan]), touching, STEP_S)
    assert odds[0] == pytest.approx(0.7 / 5.0, rel=0.1)
    assert np.isfinite(updated(QUIET, np.zeros(1), touching, np.inf)).all()
