from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from taxelflow.messages import Floats
from taxelflow.numerics.banded import WIDTH, Factor, add_square, lower_factor, multiply, smoothness, solve_band

NY, NX = 6, 5


def equations(seed: int) -> tuple[Floats, Floats, Floats]:
    """Stencil and right-hand side of some readings, and the same matrix written out."""
    random = np.random.default_rng(seed)
    stencil = 0.1 * smoothness((NY, NX))
    stencil[:, 0, WIDTH - 1] += 0.5
    dense, right = np.zeros((NY * NX, NY * NX)), np.zeros(NY * NX)
    for column in range(NY * NX):
        unit = np.zeros(NY * NX)
        unit[column] = 1.0
        multiply(stencil, NX, unit, dense[column])
    for _ in range(20):
        first = int(random.integers(0, NY - WIDTH + 1) * NX + random.integers(0, NX - WIDTH + 1))
        weight, factor, reading = random.random(WIDTH**2), random.random(), random.normal()
        add_square(first, weight, factor, reading, NX, stencil, right)
        row = np.zeros(NY * NX)
        row[first + NX * np.repeat(np.arange(4), 4) + np.tile(np.arange(4), 4)] = weight
        dense += factor * np.outer(row, row)
    return stencil, right, dense


@settings(max_examples=10)
@given(seed=st.integers(0, 1000))
def test_the_stencil_is_the_dense_matrix(seed: int) -> None:
    stencil, right, dense = equations(seed)
    out = np.empty(NY * NX)
    multiply(stencil, NX, right, out)
    np.testing.assert_allclose(out, dense @ right, atol=1e-12)
    np.testing.assert_allclose(Factor(stencil, NX).solve(right), np.linalg.solve(dense, right), atol=1e-9)


@settings(max_examples=10)
@given(seed=st.integers(0, 1000))
def test_both_solvers_agree(seed: int) -> None:
    stencil, right, _ = equations(seed)
    right[: NX + 1] = 0.0
    rows = np.stack([right, np.zeros(NY * NX)])
    solve_band(np.ascontiguousarray(lower_factor(stencil, (NY, NX)).T), rows)
    np.testing.assert_allclose(rows, [Factor(stencil, NX).solve(right), np.zeros(NY * NX)], atol=1e-12)


def turned(stencil: Floats, nx: int) -> Floats:
    """Stencil of the same matrix on the lattice whose x and y are exchanged."""
    ny = len(stencil) // nx
    other = np.zeros_like(stencil)
    for knot, dy, k in np.argwhere(stencil):
        y, x, dx = knot // nx, knot % nx, k - WIDTH + 1
        first, ahead = (x * ny + y, (dx, dy)) if dx >= 0 else ((x + dx) * ny + y + dy, (-dx, -dy))
        other[first, ahead[0], ahead[1] + WIDTH - 1] += stencil[knot, dy, k]
    return other


@settings(max_examples=10)
@given(seed=st.integers(0, 1000))
def test_a_lattice_wider_than_high_is_solved_like_one_that_is_turned(seed: int) -> None:
    stencil, right, dense = equations(seed)
    number = np.arange(NY * NX).reshape(NY, NX).T.ravel()  # of each knot of the wide lattice on the high one
    wide = Factor(turned(stencil, NX), NY)
    both = np.stack([right[number], np.ones(NY * NX)], axis=1)
    np.testing.assert_allclose(wide.solve(both[:, 0]), np.linalg.solve(dense, right)[number], atol=1e-9)
    np.testing.assert_allclose(wide.solve(both)[:, 0], wide.solve(both[:, 0]), atol=1e-12)
    covariance = wide.drawn(np.eye(NY * NX)) @ wide.drawn(np.eye(NY * NX)).T
    np.testing.assert_allclose(covariance, np.linalg.inv(dense)[np.ix_(number, number)], atol=1e-9)


def test_a_plane_is_perfectly_smooth_and_a_bend_is_not() -> None:
    stencil = smoothness((NY, NX))
    y, x = np.mgrid[:NY, :NX].astype(float)
    out = np.empty(NY * NX)
    multiply(stencil, NX, (2.0 + 3.0 * x - y).ravel(), out)
    np.testing.assert_allclose(out, 0.0, atol=1e-12)
    bent = (0.5 * x * x + 2.0 * x * y).ravel()  # second differences: 1 along x, 2 across x and y
    multiply(stencil, NX, bent, out)
    assert np.isclose(bent @ out, NY * (NX - 2) * 1.0 + 2 * (NY - 1) * (NX - 1) * 4.0)
