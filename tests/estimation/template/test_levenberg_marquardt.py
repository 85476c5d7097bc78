from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taxelflow.estimation.template.levenberg_marquardt import Prior, register
from taxelflow.estimation.template.linearization import pack_scan
from taxelflow.estimation.template.map import Surface
from taxelflow.numerics.bspline import STATE, evaluate, state_of
from taxelflow.numerics.small_linalg import solve_small

if TYPE_CHECKING:
    from taxelflow.messages import Floats

LATTICE = np.array([0.5, -8.0, -8.0])
PLACES = np.stack([axis.ravel() for axis in np.meshgrid(np.arange(-4.0, 5.0), np.arange(-4.0, 5.0))])
TAXELS = PLACES.shape[1]
WHOLE = np.zeros((3, 0))
NOISE = 0.5
LEVEL = 100.0
CLEAR = np.array([0.3, -0.4, 0.2, 1.1, 0.0])


def bumps() -> Floats:
    """Coefficients of two unequal bumps."""
    knots = LATTICE[1] + LATTICE[0] * np.arange(33)
    x, y = np.meshgrid(knots, knots)
    one = np.exp(-((x - 1.5) ** 2 + y**2) / 2)
    other = np.exp(-((x + 1.5) ** 2 + (y - 0.7) ** 2) / 2)
    pattern: Floats = LEVEL * (one + 0.6 * other)
    return pattern


def scan(state: Floats, seed: int | None = None) -> Floats:
    out = np.empty((TAXELS, 5))
    evaluate(bumps(), LATTICE, PLACES, state, WHOLE, out)
    noise = 0.0 if seed is None else np.random.default_rng(seed).normal(0, NOISE, TAXELS)
    reading: Floats = state_of(state).gain * out[:, 0] + noise
    return reading


def fit(reading: Floats, *, variance: Any = NOISE**2, ceiling: float = np.inf, turns: bool = True) -> tuple[Any, ...]:
    """State, information, chi-square and readings used, from a start at rest."""
    state, information = np.array([0.0, 0.0, 0.0, 1.0, 0.0]), np.zeros((STATE, STATE))
    precision = np.array([0.0, 0.0, 0.0 if turns else 1e12, 0.0, 1e12])
    noise = np.broadcast_to(variance, TAXELS).copy()
    taxels = pack_scan(PLACES, WHOLE, reading, noise, np.full(TAXELS, ceiling), 0.0)
    surface = Surface(bumps(), np.zeros((0, 0)), LATTICE)
    _, chi, count = register(surface, taxels, Prior(state.copy(), precision), 3.0, 30, state, information)
    return state, information, chi, count


@given(x=st.floats(-0.8, 0.8), y=st.floats(-0.8, 0.8), theta=st.floats(-0.4, 0.4), gain=st.floats(0.6, 1.6))
def test_a_pose_on_a_known_pattern_is_recovered(x: float, y: float, theta: float, gain: float) -> None:
    truth = np.array([x, y, theta, gain, 0.0])
    state, _, chi, count = fit(scan(truth))
    np.testing.assert_allclose(state, truth, atol=2e-3)
    assert chi < 0.1 * count


def test_the_error_fits_the_information() -> None:
    squared, chi = [], []
    for seed in range(200):
        state, information, misfit, count = fit(scan(CLEAR, seed))
        off = (state - CLEAR)[:4]
        squared.append(off @ information[:4, :4] @ off / 4)
        chi.append(misfit / (count - 4))
    assert np.mean(squared) == pytest.approx(1.0, abs=0.2)
    assert np.mean(chi) == pytest.approx(1.0, abs=0.1)


def test_masked_taxels_count_for_nothing() -> None:
    reading, variance = scan(CLEAR), np.full(TAXELS, NOISE**2)
    reading[40], variance[40] = 1e6, 0.0
    state, _, chi, count = fit(reading, variance=variance)
    np.testing.assert_allclose(state, CLEAR, atol=2e-3)
    assert (chi < 1.0, count) == (True, TAXELS - 1)


def test_an_outlier_is_held_down() -> None:
    reading = scan(CLEAR)
    reading[22] += LEVEL
    state, *_ = fit(reading)
    np.testing.assert_allclose(state[:2], CLEAR[:2], atol=0.03)


def test_a_saturated_reading_pulls_only_upwards() -> None:
    reading = scan(CLEAR)
    ceiling = 0.7 * reading.max()
    clipped = np.minimum(reading, ceiling)
    known, *_ = fit(clipped, ceiling=ceiling)
    unknown, *_ = fit(clipped)
    np.testing.assert_allclose(known, CLEAR, atol=5e-3)
    assert np.abs(unknown - CLEAR).max() > 10 * np.abs(known - CLEAR).max()


def test_a_stiff_part_of_the_state_stays() -> None:
    state, *_ = fit(scan(CLEAR), turns=False)
    assert state_of(state).theta == pytest.approx(0.0, abs=1e-6)


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 5))
def test_small_systems_are_solved(seed: int, n: int) -> None:
    random = np.random.default_rng(seed)
    root, right = random.normal(size=(n, n)), random.normal(size=n)
    matrix = root @ root.T + 0.1 * np.eye(n)
    solution = right.copy()
    assert solve_small(matrix.copy(), solution, n)
    np.testing.assert_allclose(matrix @ solution, right, atol=1e-9)


def test_a_matrix_that_is_not_positive_is_refused() -> None:
    assert not solve_small(np.array([[1.0, 2.0], [2.0, 1.0]]), np.ones(2), 2)


def test_a_pattern_in_doubt_is_no_explanation() -> None:
    """Where little is known of it, chi-square is small at any reading: that alone must not draw a pose there."""
    known = np.full((33, 33), 1.0)
    unknown = known + (10.0 * LEVEL) ** 2
    reading, cost, chi = scan(CLEAR, 0), [], []
    for doubt in (known, unknown):
        state, information = CLEAR.copy(), np.zeros((STATE, STATE))
        taxels = pack_scan(PLACES, WHOLE, reading, np.full(TAXELS, NOISE**2), np.full(TAXELS, np.inf), 0.0)
        prior = Prior(state.copy(), np.array([0.0, 0.0, 0.0, 0.0, 1e12]))
        surface = Surface(bumps(), doubt, LATTICE)
        found, misfit, _ = register(surface, taxels, prior, 3.0, 30, state, information)
        cost.append(found)
        chi.append(misfit)
    assert chi[1] < 0.1 * chi[0]
    assert cost[1] > cost[0]
