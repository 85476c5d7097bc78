from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compiled import compiled
from taxelflow.messages import Floats
from taxelflow.numerics.small_linalg import (
    eigenvalues2,
    factor5,
    factor_small,
    inverse2,
    inverse3,
    mirror,
    solve_factored,
    solve_small,
    solved5,
)
from taxelflow.runtime.compiling import kernel

seeds = st.integers(0, 2**32 - 1)


def positive(seed: int, n: int) -> Floats:
    root = np.random.default_rng(seed).normal(0, 1, (n, n + 2))
    matrix: Floats = root @ root.T
    return matrix


@kernel
def eigenvalues(matrix: Floats, out: Floats) -> None:
    out[0], out[1] = eigenvalues2(matrix[0, 0], matrix[1, 1], matrix[0, 1])


@given(seed=seeds)
def test_inverses_are_those_of_numpy(seed: int) -> None:
    two, three = positive(seed, 2), positive(seed, 3)
    of_three = np.empty((3, 3))
    xx, xy, yy = inverse2(two[0, 0], two[0, 1], two[1, 1])
    inverse3(three, of_three)
    np.testing.assert_allclose(np.array([[xx, xy], [xy, yy]]) @ two, np.eye(2), atol=1e-6)
    np.testing.assert_allclose(of_three @ three, np.eye(3), atol=1e-6)


@given(seed=seeds, scale=st.sampled_from([1e-18, 1.0, 1e18]))
def test_the_inverse_of_a_singular_matrix_has_no_variance_below_0(seed: int, scale: float) -> None:
    x, y = np.random.default_rng(seed).normal(0, 1, 2).tolist()
    information = inverse2(scale * x * x, scale * x * y, scale * y * y)
    assert min(information[0], information[2]) > 0.0
    back = inverse2(*information)
    assert min(back[0], back[2]) > 0.0
    assert np.isfinite(back).all()


@given(seed=seeds)
def test_eigenvalues_are_those_of_numpy_smaller_first(seed: int) -> None:
    matrix = np.random.default_rng(seed).normal(0, 1, (2, 2))
    matrix += matrix.T
    found = np.empty(2)
    eigenvalues(matrix, found)
    np.testing.assert_allclose(found, np.linalg.eigvalsh(matrix), atol=1e-12)


@given(seed=seeds, n=st.integers(1, 6))
def test_the_solver_agrees_with_numpy_and_reads_the_lower_half_only(seed: int, n: int) -> None:
    matrix, right = positive(seed, n), np.random.default_rng(seed).normal(0, 1, n)
    expected = np.linalg.solve(matrix, right)
    lower = np.tril(matrix) + np.triu(np.full((n, n), np.nan), 1)
    assert solve_small(lower, right, n)
    np.testing.assert_allclose(right, expected, rtol=1e-6, atol=1e-9)


@kernel
def solve_damped(a: Floats, damping: float, least: float, b: Floats) -> bool:
    factor = factor5(a, damping, least)
    b[0], b[1], b[2], b[3], b[4] = solved5(factor, b[0], b[1], b[2], b[3], b[4])
    return factor.positive


solve = compiled(solve_small)


@given(seed=seeds, damping=st.floats(0.0, 10.0), least=st.floats(0.0, 1.0))
def test_the_solver_of_five_agrees_with_the_other_one(seed: int, damping: float, least: float) -> None:
    matrix, right = positive(seed, 5), np.random.default_rng(seed).normal(0, 1, 5)
    lower = np.tril(matrix) + np.triu(np.full((5, 5), np.nan), 1)
    raised, expected = lower.copy(), right.copy()
    raised[np.diag_indices(5)] += damping * np.diag(matrix) + least
    assert solve_damped(lower, damping, least, right)
    assert solve(raised, expected, 5)
    np.testing.assert_allclose(right, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("part", range(5))
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_a_matrix_of_five_that_is_not_positive_is_refused(part: int, value: float) -> None:
    matrix = np.eye(5)
    matrix[part, part] = value
    assert not solve_damped(matrix, 0.0, 0.0, np.ones(5))


def test_a_factor_serves_several_right_hand_sides() -> None:
    matrix = positive(3, 4)
    factor = matrix.copy()
    assert factor_small(factor, 4)
    inverse = np.eye(4)
    for column in inverse:
        solve_factored(factor, column, 4)
    np.testing.assert_allclose(inverse @ matrix, np.eye(4), atol=1e-10)


@pytest.mark.parametrize("matrix", [[[1.0, 0.0], [2.0, 1.0]], [[0.0, 0.0], [0.0, 1.0]], [[np.nan, 0.0], [0.0, 1.0]]])
def test_a_matrix_that_is_not_positive_is_refused(matrix: list[list[float]]) -> None:
    assert not solve_small(np.array(matrix), np.ones(2), 2)


def test_mirror_copies_the_lower_half() -> None:
    matrix = np.array([[1.0, -1.0], [2.0, 3.0]])
    mirror(matrix)
    assert matrix.tolist() == [[1.0, 2.0], [2.0, 3.0]]
