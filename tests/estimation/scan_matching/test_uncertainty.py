from __future__ import annotations

import numpy as np
import pytest

from taxelflow.estimation.scan_matching.interpolant import SPLINE_NOISE, Interpolant, interpolate
from taxelflow.estimation.scan_matching.matching import DOF, Fit, Points
from taxelflow.estimation.scan_matching.uncertainty import (
    covariance,
    drift,
    earlier_gains,
    gains,
    hidden_shares,
    turn_observability,
    turn_variance,
)
from taxelflow.messages import Floats
from taxelflow.numerics.bspline import evaluate

COUNT = 40


def fit_with(noise_normal: Floats | None = None) -> Fit:
    """A fit of random slopes. noise_normal: (4, 4), none if left out."""
    random = np.random.default_rng(0)
    jacobian, weight = random.normal(0, 1, (COUNT, DOF)), random.uniform(0.5, 2.0, COUNT)
    normal = (jacobian * weight[:, np.newaxis]).T @ jacobian
    return Fit(np.zeros(5), jacobian, weight, normal, np.zeros((DOF, DOF)) if noise_normal is None else noise_normal)


def points_of(reading: Floats, variance: Floats) -> Points:
    taxels = np.arange(len(reading))
    return Points(taxels, np.zeros((2, len(reading))), reading, variance, np.full(len(reading), np.inf))


def test_gains_without_noise_in_the_slopes_are_those_of_least_squares() -> None:
    fit, g = fit_with(), np.empty((3, COUNT))
    gains(fit, True, g)
    expected = np.linalg.solve(fit.normal + 1e-6 * np.eye(DOF), fit.jacobian.T * fit.weight)
    np.testing.assert_allclose(g, expected[:3], rtol=1e-9)


def test_a_turn_that_is_not_observable_has_no_gain_and_mixes_with_nothing() -> None:
    fit, g = fit_with(), np.empty((3, COUNT))
    gains(fit, False, g)
    others = [0, 1, 3]
    normal = fit.normal[np.ix_(others, others)] + 1e-6 * np.eye(3)
    expected = np.linalg.solve(normal, (fit.jacobian.T * fit.weight)[others])
    np.testing.assert_allclose(g[:2], expected[:2], rtol=1e-9)
    assert not g[2].any()


def test_noise_in_the_slopes_raises_the_gains_by_at_most_a_factor_of_2() -> None:
    plain, half, more = np.empty((3, 3, COUNT))
    gains(fit_with(), True, plain)
    gains(fit_with(0.36 * np.diag(np.diagonal(fit_with().normal))), True, half)
    gains(fit_with(0.99 * np.diag(np.diagonal(fit_with().normal))), True, more)
    np.testing.assert_allclose(half, plain / 0.64, rtol=1e-5)
    np.testing.assert_allclose(more, plain / 0.5, rtol=1e-5)


def test_what_errors_hide_is_their_share_of_the_slopes_and_none_without_errors() -> None:
    fit, points = fit_with(), points_of(np.ones(COUNT), np.ones(COUNT))
    none, some, much = (hidden_shares(fit, points, share) for share in (0.0, 0.1, 1e3))
    assert not none.any()
    slopes = SPLINE_NOISE.slope * 0.1**2 * fit.weight.sum()
    held = slopes / np.diagonal(fit.normal)[:2]
    np.testing.assert_allclose(some[:2], held / (1 - held))
    assert some[2] == 0.0  # all taxels are at the object's point
    np.testing.assert_allclose(much[:2], 9.0)


def test_errors_of_readings_drift_with_the_way_and_not_at_rest() -> None:
    g, points = np.ones((3, COUNT)), points_of(np.ones(COUNT), np.ones(COUNT))
    rest, slow, far = np.zeros((3, 3, 3))
    for way, out in ((0.0, rest), (0.1, slow), (50.0, far)):
        drift(g, points, 0.2, np.array([way, 0.0, 0.0, 1.0, 0.0]), out)
    assert not rest.any()
    np.testing.assert_allclose(far, 2 * 0.2**2 * COUNT)
    np.testing.assert_allclose(slow, far * (1 - np.exp(-0.1)))


def test_a_turn_is_as_observable_as_its_information_exceeds_that_of_noise() -> None:
    noise = np.diag([2.0, 2.0, 5.0, 1.0])
    noise[0, 2] = noise[2, 0] = 2.0  # a turn about another place: information on x in disguise
    fit = fit_with(noise)
    information = 1.0 / np.linalg.inv(fit.normal)[2, 2]
    assert turn_observability(fit) == pytest.approx(information / (5.0 - 2.0))
    assert turn_observability(fit_with()) == 0.0


def test_the_covariance_is_that_of_the_readings_noise_and_of_its_excess() -> None:
    random = np.random.default_rng(1)
    g, variance, reading = random.normal(0, 1, (3, COUNT)), random.uniform(1, 2, COUNT), np.ones(COUNT)
    reading[:5] = 0.0  # clipped: no noise
    points = points_of(reading, variance)
    expected = (g[:, 5:] * variance[5:]) @ g[:, 5:].T
    assert turn_variance(g, points) == pytest.approx(expected[2, 2])
    np.testing.assert_allclose(covariance(g.copy(), points, 1.0), expected)
    kept = g.copy()
    np.testing.assert_allclose(covariance(kept, points, 4.0), 4.0 * expected)
    np.testing.assert_allclose(kept, 2.0 * g)


@pytest.mark.long
def test_earlier_gains_are_the_derivative_by_the_earlier_readings() -> None:
    x, y = (axis.ravel().astype(np.float64) for axis in np.meshgrid(np.arange(8), np.arange(8)))
    places = np.stack([x, y])
    spline = Interpolant.of("pad", places, np.ones(64))
    random, state = np.random.default_rng(2), np.array([0.3, -0.2, 0.1, 1.5, 0.0])
    inner = np.flatnonzero((x > 1) & (x < 6) & (y > 1) & (y < 6))
    points = Points(inner, places[:, inner], np.ones(len(inner)), np.ones(len(inner)), np.full(len(inner), np.inf))
    g, out = random.normal(0, 1, (3, len(inner))), np.zeros((3, 64))
    earlier_gains(spline, spline.lattice, points, state, g, out)
    for taxel in (9, 27, 45):
        c, values = np.empty(spline.shape), np.empty((len(inner), 5))
        interpolate(spline, np.where(np.arange(64) == taxel, 1.0, 0.0), c)
        evaluate(c, spline.lattice, points.places, state, np.zeros((3, 0)), values)
        np.testing.assert_allclose(out[:, taxel], state[3] * (g @ values[:, 0]), atol=1e-10)
