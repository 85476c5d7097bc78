from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taxelflow.estimation.centroid.paper_reference import convolution_index, slip_vector
from taxelflow.messages import Floats


def single(rows: int, cols: int, row: int, col: int) -> Floats:
    scan = np.zeros((rows, cols))
    scan[row, col] = 3.0
    return scan


def by_hand(before: Floats, now: Floats) -> tuple[float, float]:
    """Equations (1) to (3) as four nested loops."""
    M, N = now.shape
    C = np.zeros((2 * M - 1, 2 * N - 1))
    for (k, m), (n, o) in itertools.product(np.ndindex(M, N), np.ndindex(M, N)):
        C[k + n, m + o] += before[k, m] * now[n, o]
    i = sum((a + 1) * C[:, a].mean() for a in range(2 * N - 1)) / sum(C[:, a].mean() for a in range(2 * N - 1))
    j = sum((b + 1) * C[b].mean() for b in range(2 * M - 1)) / sum(C[b].mean() for b in range(2 * M - 1))
    return i - N, j - M


@pytest.mark.parametrize("shape", [(1, 1), (1, 4), (3, 1), (2, 3), (4, 4), (4, 7)])
def test_the_index_is_the_papers_sums_to_the_letter(shape: tuple[int, int]) -> None:
    random = np.random.default_rng(0)
    before, now = random.random(shape), random.random(shape)
    np.testing.assert_allclose(convolution_index(before, now), by_hand(before, now), rtol=0, atol=1e-12)


def test_a_centred_still_contact_has_index_zero() -> None:
    scan = np.array([[0, 1, 0], [1, 5, 1], [0, 1, 0]], dtype=float)
    assert convolution_index(scan, scan) == pytest.approx((0.0, 0.0), abs=1e-14)


@given(shape=st.tuples(st.integers(1, 6), st.integers(1, 6)), seed=st.integers(0, 1000))
def test_the_index_of_two_points_is_the_sum_of_their_places(shape: tuple[int, int], seed: int) -> None:
    random = np.random.default_rng(seed)
    (row, col), (new_row, new_col) = (tuple(int(random.integers(size)) for size in shape) for _ in range(2))
    i, j = convolution_index(single(*shape, row, col), single(*shape, new_row, new_col))
    assert i == pytest.approx(col + new_col - (shape[1] - 1), abs=1e-12)
    assert j == pytest.approx(row + new_row - (shape[0] - 1), abs=1e-12)


def test_the_slip_vector_is_the_motion_over_two_scans() -> None:
    scans = [single(5, 6, 1, 1), single(5, 6, 2, 1), single(5, 6, 4, 3)]
    assert slip_vector(*scans) == pytest.approx((2.0, 3.0), abs=1e-12)


def test_an_empty_scan_has_no_index() -> None:
    scan = single(2, 3, 0, 0)
    for before, now in ((0 * scan, scan), (scan, 0 * scan), (0 * scan, 0 * scan)):
        assert all(math.isnan(index) for index in convolution_index(before, now))
    assert all(math.isnan(component) for component in slip_vector(scan, 0 * scan, scan))
