"""Rigid motions: points and directions between frames.

A pose in the plane is (x, y, theta), in m, m, rad: `T_hand_pad` maps points in the pad's frame to the hand frame.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def rotation(theta: Floats | float) -> Floats:
    """Rotation matrices (..., 2, 2) of angles (...), rad, anticlockwise."""
    cos, sin = np.cos(theta), np.sin(theta)
    matrix: Floats = np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)
    return matrix


def transform(pose: Floats, points: Floats) -> Floats:
    """Points (..., 2) in the frames of poses (..., 3), mapped to the frame that the poses are in."""
    moved: Floats = np.einsum("...ij,...j->...i", rotation(pose[..., 2]), points) + pose[..., :2]
    return moved


def inverse_transform(pose: Floats, points: Floats) -> Floats:
    """The inverse of `transform`: points (..., 2) mapped to the frames of poses (..., 3)."""
    back: Floats = np.einsum("...ji,...j->...i", rotation(pose[..., 2]), points - pose[..., :2])
    return back


def rotate(quaternion: Floats, vectors: Floats) -> Floats:
    """Vectors (..., 3) rotated by a quaternion [x, y, z, w] (4,) of any length but 0."""
    vector, scalar = quaternion[:3], quaternion[3]
    norm = float(quaternion @ quaternion)
    twice = 2.0 * np.cross(vector, vectors)
    rotated: Floats = vectors + (scalar * twice + np.cross(vector, twice)) / norm
    return rotated
