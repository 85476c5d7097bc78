from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from taxelflow.messages import Floats
from taxelflow.numerics.geometry import adjoint, hat, quaternion_of, se3_exp, se3_inverse, se3_log, se3_of
from taxelflow.numerics.se3 import compose, eigen_symmetric, exponential, invert, planar_rows

number = st.floats(-1.0, 1.0, allow_subnormal=False)
twists = st.tuples(*[number] * 6).map(lambda xi: np.array(xi) * [1, 1, 1, 1.7, 1.7, 1.7])


@given(twists)
def test_log_undoes_exp(xi: Floats) -> None:
    np.testing.assert_allclose(se3_log(se3_exp(xi)), xi, atol=1e-9)


@given(twists)
def test_the_inverse_of_a_motion_is_the_motion_backwards(xi: Floats) -> None:
    np.testing.assert_allclose(se3_exp(xi) @ se3_inverse(se3_exp(xi)), np.eye(4), atol=1e-12)
    np.testing.assert_allclose(se3_inverse(se3_exp(xi)), se3_exp(-xi), atol=1e-12)


@given(twists, twists, twists)
def test_composition_is_associative_and_keeps_rotations(a: Floats, b: Floats, c: Floats) -> None:
    A, B, C = se3_exp(a), se3_exp(b), se3_exp(c)
    np.testing.assert_allclose((A @ B) @ C, A @ (B @ C), atol=1e-12)
    R = (A @ B)[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)


@given(twists, twists)
def test_the_adjoint_carries_a_twist_through_a_pose(a: Floats, xi: Floats) -> None:
    T = se3_exp(a)
    np.testing.assert_allclose(T @ se3_exp(xi) @ se3_inverse(T), se3_exp(adjoint(T) @ xi), atol=1e-9)


@given(twists, twists)
def test_the_adjoint_is_a_homomorphism(a: Floats, b: Floats) -> None:
    A, B = se3_exp(a), se3_exp(b)
    np.testing.assert_allclose(adjoint(A @ B), adjoint(A) @ adjoint(B), atol=1e-12)


@given(twists)
def test_motions_along_one_twist_add_up(xi: Floats) -> None:
    np.testing.assert_allclose(se3_exp(0.3 * xi) @ se3_exp(0.7 * xi), se3_exp(xi), atol=1e-12)


@given(twists)
def test_a_quaternion_gives_its_pose_back(xi: Floats) -> None:
    T = se3_exp(xi)
    np.testing.assert_allclose(se3_of(T[:3, 3], quaternion_of(T[:3, :3])), T, atol=1e-9)


def test_small_angles_and_whole_arrays() -> None:
    xi = np.array([[0.1, 0.2, 0.3, 1e-9, -2e-9, 1e-10], [0.0, 0.0, 0.0, 1e-3, 0.0, 0.0]])
    np.testing.assert_allclose(se3_log(se3_exp(xi)), xi, atol=1e-14)
    np.testing.assert_allclose(hat(np.array([1.0, 2.0, 3.0])) @ [4.0, 5.0, 6.0], np.cross([1, 2, 3], [4, 5, 6]))


@given(twists, twists)
def test_kernels_agree_with_their_twins(a: Floats, b: Floats) -> None:
    A, B, found = se3_exp(a), se3_exp(b), np.empty((4, 4))
    exponential(a, found)
    np.testing.assert_allclose(found, A, atol=1e-12)
    compose(A, B, found)
    np.testing.assert_allclose(found, A @ B, atol=1e-12)
    invert(A, found)
    np.testing.assert_allclose(found, se3_inverse(A), atol=1e-12)
    rows, shift = np.empty((3, 6)), np.eye(4)
    shift[:3, 3] = b[:3]
    planar_rows(A, b[:3], rows)
    np.testing.assert_allclose(rows, (adjoint(se3_inverse(A)) @ adjoint(shift))[[0, 1, 5]], atol=1e-12)


def test_eigenvectors_of_a_symmetric_matrix() -> None:
    random = np.random.default_rng(0)
    half = random.normal(size=(6, 4))
    matrix = half @ half.T  # of rank 4
    values, vectors = np.empty(6), np.empty((6, 6))
    eigen_symmetric(matrix.copy(), values, vectors, 6)
    np.testing.assert_allclose(np.sort(values), np.linalg.eigvalsh(matrix), atol=1e-12)
    np.testing.assert_allclose(vectors @ np.diag(values) @ vectors.T, matrix, atol=1e-12)
