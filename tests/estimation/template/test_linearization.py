"""A scan against a pattern, to first order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taxelflow.estimation.template.linearization import frame_of, linearise, look_up, pack_scan, rows_of
from taxelflow.estimation.template.map import Surface
from taxelflow.numerics.bspline import STATE, evaluate, state_of, states_of

if TYPE_CHECKING:
    from taxelflow.messages import Floats

LATTICE = np.array([0.5, -4.0, -4.0])
HUBER, ERROR = 3.0, 0.1
SHAPE = (18, 17)


def drawn(seed: int, taxels: int, *, delayed: bool) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Coefficients, some of which pull, places (some off the lattice), a bend, a state, and readings."""
    random = np.random.default_rng(seed)
    c, places = random.normal(1.0, 2.0, SHAPE), random.uniform(-4.0, 4.0, (2, taxels))
    bend = random.uniform(-0.2, 0.2, (3, taxels if delayed else 0))
    state = np.array([*random.uniform(-0.5, 0.5, 3), random.uniform(0.5, 2.0), random.uniform(-0.1, 0.1)])
    return c, places, bend, state, np.maximum(random.normal(2.0, 2.0, taxels), 0.0)


def twin(q: Floats, state: Floats, reading: Floats, variance: Floats, ceiling: Floats) -> tuple[Floats, Floats, float]:
    """Normal equations and chi-square, by q and its derivatives (taxels, 5); pressure does not pull."""
    q = np.where(q[:, :1] < 0.0, 0.0, q)
    on = np.isfinite(q[:, 0])
    unexplained = ~on & (reading**2 > 9.0 * (variance + ERROR**2)) & (variance > 0.0)
    gain = state_of(state).gain
    model = gain * np.where(on, q[:, 0], 0.0)
    left = reading - model
    fits = on & (variance > 0) & ~((reading == 0) & (model <= 0)) & ~((reading >= ceiling) & (left < 0))
    v = variance + ERROR**2
    v[variance == 0.0] = 1.0
    z = np.abs(left) / np.sqrt(v)
    jacobian = gain * q[:, [1, 2, 3, 0, 4]]
    states_of(jacobian).gain[:] = q[:, 0]
    jacobian = jacobian[fits]
    weight = (np.minimum(1.0, HUBER / np.maximum(z, 1e-9)) / v)[fits]
    chi = (z[fits] ** 2).sum() + np.minimum(z[unexplained] ** 2, 25.0).sum()
    return jacobian.T @ (weight[:, np.newaxis] * jacobian), jacobian.T @ (weight * left[fits]), float(chi)


@given(seed=st.integers(0, 2**32 - 1), taxels=st.integers(1, 40), delayed=st.booleans())
def test_the_normal_equations_are_those_of_a_plain_sum(seed: int, taxels: int, *, delayed: bool) -> None:
    c, places, bend, state, reading = drawn(seed, taxels, delayed=delayed)
    variance = np.where(np.arange(taxels) % 5 == 2, 0.0, 0.25)
    ceiling = np.full(taxels, 3.0)
    q = np.empty((taxels, 5))
    evaluate(c, LATTICE, places, state, bend, q)
    normal, right = np.zeros((STATE, STATE)), np.zeros(STATE)
    scan = pack_scan(places, bend, reading, variance, ceiling, ERROR)
    _, chi, _ = linearise(Surface(c, np.zeros((0, 0)), LATTICE), scan, HUBER, state, normal, right)
    expected, toward, misfit = twin(q, state, reading, variance, ceiling)
    np.testing.assert_allclose(np.tril(normal), np.tril(expected), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(right, toward, rtol=1e-9, atol=1e-9)
    assert chi == pytest.approx(misfit)


@given(taxels=st.integers(0, 20))
def test_a_scan_is_filled_up_with_taxels_without_weight(taxels: int) -> None:
    ones = np.ones(taxels)
    scan = pack_scan(np.ones((2, taxels)), np.zeros((3, 0)), ones, ones, ones, 1.0)
    assert scan.whole.shape[1] == scan.lanes >= taxels
    assert (rows_of(scan).variance[:taxels] == 2.0).all()
    assert (rows_of(scan).variance[taxels:] == 0.0).all()


def test_a_doubtful_pattern_weighs_less() -> None:
    c, places, bend, state, reading = drawn(0, 24, delayed=False)
    scan = pack_scan(places, bend, reading, np.full(24, 0.25), np.full(24, np.inf), 0.0)
    sums = []
    for doubt in (np.zeros((0, 0)), np.zeros(SHAPE), np.full(SHAPE, 100.0)):
        normal = np.zeros((STATE, STATE))
        linearise(Surface(c, doubt, LATTICE), scan, HUBER, state, normal, np.zeros(STATE))
        sums.append(np.trace(normal))
    assert sums[0] == sums[1]
    assert sums[2] < 0.1 * sums[0]


def test_looking_up_gives_the_value_and_the_nearest_doubt() -> None:
    c, places, bend, state, reading = drawn(1, 24, delayed=True)
    doubt = np.random.default_rng(1).uniform(1.0, 2.0, SHAPE)
    q, taxels = np.empty((24, 5)), pack_scan(places, bend, reading, reading, reading, 0.0)
    evaluate(c, LATTICE, places, state, bend, q)
    look_up(Surface(c, doubt, LATTICE), frame_of(LATTICE, state), taxels)
    np.testing.assert_allclose(rows_of(taxels).q, np.maximum(q[:, 0], 0.0))
    known = np.isfinite(rows_of(taxels).q)
    assert known.any()
    assert np.isin(rows_of(taxels).doubt[known], doubt).all()
    assert (rows_of(taxels).doubt[~known] == 0.0).all()


@given(seed=st.integers(0, 2**32 - 1), side=st.integers(0, 3), doubted=st.booleans())
def test_the_cost_does_not_change_when_an_unloaded_taxel_comes_onto_the_lattice(
    seed: int, side: int, *, doubted: bool
) -> None:
    random = np.random.default_rng(seed)
    c, doubt = np.zeros(SHAPE), np.full(SHAPE, 9.0)
    c[6:12, 6:11] = random.uniform(5.0, 10.0, (6, 5))
    doubt[5:13, 5:12] = 0.01
    room = np.full((SHAPE[0] + 3, SHAPE[1] + 2), np.nan)  # the lattice of another pad may be larger
    room[: SHAPE[0], : SHAPE[1]] = c
    doubts = np.pad(doubt, ((0, 3), (0, 2)), constant_values=np.nan)
    h, left, low = LATTICE
    border = [left + h, left + h * (SHAPE[1] - 2), low + h, low + h * (SHAPE[0] - 2)][side]
    places = random.uniform(-4.0, 4.0, (2, 12))
    places[side // 2, 0] = border
    noise = np.full(12, 0.25)
    reading = np.clip(random.normal(0.0, 0.5, 12), -1.0, 1.0)  # a load is another matter
    scan = pack_scan(places, np.zeros((3, 0)), reading, noise, np.full(12, np.inf), ERROR)
    costs = []
    for off in (-1e-9, 1e-9):
        state = np.array([0.0, 0.0, 0.0, 1.0, 0.0])
        state[side // 2] = off
        normal, right = np.zeros((STATE, STATE)), np.zeros(STATE)
        known = doubts if doubted else np.zeros((0, 0))
        costs.append(linearise(Surface(room, known, LATTICE), scan, HUBER, state, normal, right)[0])
    assert costs[0] == pytest.approx(costs[1], abs=1e-6)


@pytest.mark.parametrize(("reading", "explained"), [(0.3, False), (8.0, True)])
def test_doubt_costs_only_where_it_explains_a_reading(reading: float, *, explained: bool) -> None:
    one = np.array([reading]), np.array([0.25]), np.array([np.inf])
    scan = pack_scan(np.zeros((2, 1)), np.zeros((3, 0)), *one, 0.0)
    state = np.array([0.0, 0.0, 0.0, 1.0, 0.0])

    def cost(doubt: Floats) -> float:
        normal, right = np.zeros((STATE, STATE)), np.zeros(STATE)
        return linearise(Surface(np.zeros(SHAPE), doubt, LATTICE), scan, HUBER, state, normal, right)[0]

    certain, doubted = cost(np.zeros((0, 0))), cost(np.full(SHAPE, 9.0))
    assert (doubted < 0.5 * certain) == explained
    assert doubted <= certain
