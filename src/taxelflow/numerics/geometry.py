"""Rigid motions: points and directions between frames.

A pose in the plane is (x, y, theta), in m, m, rad: `T_hand_pad` maps points in the pad's frame to the hand frame.
A pose in space is a homogeneous matrix (4, 4), translation in m: T_a_b maps points of frame b to frame a, and `@`
composes. A twist is (vx, vy, vz, wx, wy, wz), m/s and rad/s: v is the velocity of the point at the frame's origin, as
in ROS. Perturbations act on the left: T becomes se3_exp(xi) T.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SMALL_RAD2 = 1e-4
"""Squared angle below which series replace quotients: their error is below 1e-15."""


def rotation(theta: Floats | float) -> Floats:
    """Rotation matrices (..., 2, 2) of angles (...), rad, anticlockwise."""
    cos, sin = np.cos(theta), np.sin(theta)
    matrix: Floats = np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)
    return matrix


def turned(arms: Floats, angles: Floats | float) -> Floats:
    """Arms (..., 2), turned by angles (...), rad, anticlockwise."""
    x, y, cos, sin = arms[..., 0], arms[..., 1], np.cos(angles), np.sin(angles)
    along = cos * x - sin * y
    found: Floats = np.empty((*along.shape, 2))  # `np.stack` takes longer than all else
    found[..., 0], found[..., 1] = along, sin * x + cos * y
    return found


def wrapped(angle: Floats) -> Floats:
    """Angles, rad, from -pi to pi."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def transform(pose: Floats, points: Floats) -> Floats:
    """Points (..., 2) in the frames of poses (..., 3), mapped to the frame that the poses are in."""
    moved: Floats = np.einsum("...ij,...j->...i", rotation(pose[..., 2]), points) + pose[..., :2]
    return moved


def inverse_transform(pose: Floats, points: Floats) -> Floats:
    """The inverse of `transform`: points (..., 2) mapped to the frames of poses (..., 3)."""
    back: Floats = np.einsum("...ji,...j->...i", rotation(pose[..., 2]), points - pose[..., :2])
    return back


def rotate(quaternion: Floats, vectors: Floats) -> Floats:
    """Vectors (..., 3) rotated by quaternions [x, y, z, w] (..., 4) of any length but 0."""
    vector, scalar = quaternion[..., :3], quaternion[..., 3:]
    norm = (quaternion**2).sum(axis=-1, keepdims=True)
    twice = 2.0 * np.cross(vector, vectors)
    rotated: Floats = vectors + (scalar * twice + np.cross(vector, twice)) / norm
    return rotated


def hat(omega: Floats) -> Floats:
    """Matrices (..., 3, 3) of vectors (..., 3): hat(omega) r = omega x r."""
    omega = np.asarray(omega, dtype=np.float64)
    matrix = np.zeros((*omega.shape, 3))
    matrix[..., 2, 1], matrix[..., 0, 2], matrix[..., 1, 0] = omega[..., 0], omega[..., 1], omega[..., 2]
    skew: Floats = matrix - np.swapaxes(matrix, -1, -2)
    return skew


def se3_exp(xi: Floats) -> Floats:
    """Poses (..., 4, 4) reached by twists (..., 6) in unit time (Murray, Li & Sastry 1994, eq. 2.36)."""
    xi = np.asarray(xi, dtype=np.float64)
    T = np.zeros((*xi.shape[:-1], 4, 4))
    a, b, c = _series(np.sum(xi[..., 3:] ** 2, axis=-1))
    W = hat(xi[..., 3:])
    T[..., :3, :3] = np.eye(3) + a * W + b * W @ W
    T[..., :3, 3] = np.einsum("...ij,...j->...i", np.eye(3) + b * W + c * W @ W, xi[..., :3])
    T[..., 3, 3] = 1.0
    return T


def se3_log(T: Floats) -> Floats:
    """Twists (..., 6) of poses (..., 4, 4): the inverse of `se3_exp` for rotations below pi."""
    omega = _rotation_vector(T[..., :3, :3])
    _, b, c = _series(np.sum(omega**2, axis=-1))
    W = hat(omega)
    V = np.eye(3) + b * W + c * W @ W
    xi: Floats = np.concatenate([np.linalg.solve(V, T[..., :3, 3:])[..., 0], omega], axis=-1)
    return xi


def se3_inverse(T: Floats) -> Floats:
    """Inverses (..., 4, 4) of poses (..., 4, 4): T_b_a of T_a_b."""
    back = np.zeros_like(T)
    back[..., :3, :3] = np.swapaxes(T[..., :3, :3], -1, -2)
    back[..., :3, 3] = -np.einsum("...ji,...j->...i", T[..., :3, :3], T[..., :3, 3])
    back[..., 3, 3] = 1.0
    return back


def adjoint(T: Floats) -> Floats:
    """Matrices (..., 6, 6) that map a twist in frame b to frame a, for T_a_b (..., 4, 4)."""
    R = T[..., :3, :3]
    A = np.zeros((*T.shape[:-2], 6, 6))
    A[..., :3, :3] = A[..., 3:, 3:] = R
    A[..., :3, 3:] = hat(T[..., :3, 3]) @ R
    return A


def se3_of(position: Floats, quaternion: Floats) -> Floats:
    """Pose (4, 4) of a position (3,) in m and a quaternion [x, y, z, w] (4,) of any length but 0."""
    T = np.eye(4)
    T[:3, :3] = rotate(quaternion, np.eye(3)).T
    T[:3, 3] = position
    return T


def quaternion_of(R: Floats) -> Floats:
    """Unit quaternions [x, y, z, w] (..., 4) of rotation matrices (..., 3, 3), w >= 0."""
    omega = _rotation_vector(R)
    angle = np.sqrt(np.sum(omega**2, axis=-1))[..., np.newaxis]
    half = 0.5 * np.sinc(angle / (2 * np.pi))
    unit: Floats = np.concatenate([half * omega, np.cos(angle / 2)], axis=-1)
    return unit


def _series(angle2: Floats) -> tuple[Floats, Floats, Floats]:
    """sin t / t, (1 - cos t) / t^2 and (t - sin t) / t^3 (..., 1, 1) of squared angles (...)."""
    t2 = np.asarray(angle2)[..., np.newaxis, np.newaxis]
    small = t2 < _SMALL_RAD2
    t = np.sqrt(np.where(small, 1.0, t2))
    return (
        np.where(small, 1 - t2 / 6 + t2**2 / 120, np.sin(t) / t),
        np.where(small, 0.5 - t2 / 24 + t2**2 / 720, (1 - np.cos(t)) / t**2),
        np.where(small, 1 / 6 - t2 / 120 + t2**2 / 5040, (t - np.sin(t)) / t**3),
    )


def _rotation_vector(R: Floats) -> Floats:
    """Rotation vectors (..., 3), rad, of rotation matrices (..., 3, 3)."""
    from scipy.spatial.transform import Rotation

    vectors: Floats = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec().reshape(R.shape[:-1])
    return vectors
