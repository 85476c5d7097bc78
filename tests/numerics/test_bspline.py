from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taxelflow.numerics.bspline import KNOTS, STATE, State, evaluate, spread, state_of

if TYPE_CHECKING:
    from taxelflow.messages import Floats

LATTICE = np.array([0.5, -6.0, -6.0])
PLACES = np.stack([axis.ravel() for axis in np.meshgrid(np.arange(-2.0, 3.0), np.arange(-2.0, 3.0))])

seeds = st.integers(0, 2**32 - 1)


def drawn(seed: int, *, delayed: bool = False) -> tuple[Floats, Floats, Floats]:
    """Coefficients, a state, and bends of a pattern that covers every taxel."""
    random = np.random.default_rng(seed)
    state = np.array(
        State(*random.uniform(-1, 1, 2), theta=random.uniform(-3, 3), gain=1.0, size=random.uniform(-0.1, 0.1))
    )
    bend = random.uniform(-0.2, 0.2, (3, PLACES.shape[1] if delayed else 0))
    return random.normal(size=(24, 25)), state, bend


def seen(c: Floats, state: Floats, bend: Floats, places: Floats = PLACES) -> Floats:
    out = np.empty((places.shape[1], 5))
    evaluate(c, LATTICE, places, state, bend, out)
    return out


@given(seed=seeds, delayed=st.booleans())
def test_derivatives_are_those_of_finite_differences(seed: int, delayed: bool) -> None:
    c, state, bend = drawn(seed, delayed=delayed)
    out = seen(c, state, bend)
    assert np.isfinite(out).all()
    for column, part in ((1, 0), (2, 1), (3, 2), (4, 4)):
        step = np.zeros(STATE)
        step[part] = 1e-5
        there, back = (seen(c, state + sign * step, bend)[:, 0] for sign in (1, -1))
        np.testing.assert_allclose(out[:, column], (there - back) / 2e-5, atol=1e-4)


@given(seed=seeds, delayed=st.booleans())
def test_the_weights_of_the_coefficients_give_the_same_reading(seed: int, delayed: bool) -> None:
    c, state, bend = drawn(seed, delayed=delayed)
    first, weight = np.empty(PLACES.shape[1], np.int64), np.empty((PLACES.shape[1], KNOTS))
    spread(c.shape, LATTICE, PLACES, state, bend, first, weight)
    assert (first >= 0).all()
    knots = first[:, np.newaxis] + (np.arange(4)[:, np.newaxis] * c.shape[1] + np.arange(4)).ravel()
    np.testing.assert_allclose((c.ravel()[knots] * weight).sum(axis=1), seen(c, state, bend)[:, 0])
    np.testing.assert_allclose(weight.sum(axis=1), 1.0)


@given(seed=seeds)
def test_an_object_turned_and_moved_along_with_the_taxels_reads_the_same(seed: int) -> None:
    c, state, bend = drawn(seed)
    home = state.copy()
    home[:3] = 0.0
    at = state_of(state)
    cos, sin = np.cos(at.theta), np.sin(at.theta)
    moved = np.array([[cos, -sin], [sin, cos]]) @ PLACES + state[:2, np.newaxis]
    np.testing.assert_allclose(seen(c, state, bend, moved)[:, 0], seen(c, home, bend)[:, 0], atol=1e-9)


def test_a_taxel_off_the_lattice_reads_nothing() -> None:
    c, state, bend = drawn(0)
    state = np.array(State(0.0, 0.0, 0.0, state_of(state).gain, 0.0))
    far = np.array([[0.0, 20.0, -6.0], [0.0, 0.0, 0.0]])
    out = seen(c, state, bend, far)
    assert np.isnan(out[:, 0]).tolist() == [False, True, True]
    first, weight = np.empty(3, np.int64), np.empty((3, 16))
    spread(c.shape, LATTICE, far, state, bend, first, weight)
    assert (first < 0).tolist() == [False, True, True]
    assert weight[1:].sum() == pytest.approx(0.0)
