from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from taxelflow.numerics.geometry import inverse_transform, rotate, rotation, transform, turned

poses = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-4, 4)).map(np.array)
points = st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=1, max_size=4).map(np.array)


def test_a_pose_turns_anticlockwise_then_shifts() -> None:
    np.testing.assert_allclose(transform(np.array([1.0, 2.0, np.pi / 2]), np.array([3.0, 0.0])), [1.0, 5.0])


@given(poses, points)
def test_the_inverse_undoes_a_transform(pose: np.ndarray, point: np.ndarray) -> None:
    np.testing.assert_allclose(inverse_transform(pose, transform(pose, point)), point, atol=1e-12)


@given(poses, poses, points)
def test_frames_cancel(T_a_b: np.ndarray, T_b_c: np.ndarray, in_c: np.ndarray) -> None:
    T_a_c = np.array([*transform(T_a_b, T_b_c[:2]), T_a_b[2] + T_b_c[2]])
    np.testing.assert_allclose(transform(T_a_c, in_c), transform(T_a_b, transform(T_b_c, in_c)), atol=1e-12)


def test_poses_and_points_broadcast() -> None:
    pose = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, np.pi]])
    np.testing.assert_allclose(transform(pose[:, np.newaxis], np.eye(2)), [np.eye(2), [[0, 0], [1, -1]]], atol=1e-12)


@given(st.floats(-3, 3), st.floats(0.1, 10.0))
def test_a_quaternion_about_z_is_a_rotation_of_the_plane_whatever_its_length(angle: float, length: float) -> None:
    quaternion = length * np.array([0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2)])
    vectors = np.array([[1.0, 0.0, 5.0], [0.3, -2.0, 0.0]])
    turned = rotate(quaternion, vectors)
    np.testing.assert_allclose(turned[:, :2], vectors[:, :2] @ rotation(angle).T, atol=1e-12)
    np.testing.assert_allclose(turned[:, 2], vectors[:, 2], atol=1e-12)


def test_one_arm_or_many_turn_by_one_angle_or_many_as_by_a_rotation() -> None:
    arms, angles = np.arange(8.0).reshape(4, 2), np.linspace(-3.0, 3.0, 4)
    np.testing.assert_allclose(turned(arms, angles), np.einsum("nij,nj->ni", rotation(angles), arms), atol=1e-14)
    np.testing.assert_allclose(turned(arms, 0.5), arms @ rotation(0.5).T, atol=1e-14)
    np.testing.assert_allclose(turned(arms[1], angles), rotation(angles) @ arms[1], atol=1e-14)
