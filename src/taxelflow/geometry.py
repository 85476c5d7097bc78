"""Rigid motions: places and directions between frames.

A pose of the plane is (x, y, theta), in m, m, rad: `T_hand_pad` maps places in the pad's frame to the hand's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def rotation(theta: Floats | float) -> Floats:
    """(..., 2, 2) rotation matrices, anticlockwise."""
    cos, sin = np.cos(theta), np.sin(theta)
    matrix: Floats = np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)
    return matrix


def place(pose: Floats, points: Floats) -> Floats:
    """Points (..., 2) mapped by poses (..., 3)."""
    moved: Floats = np.einsum("...ij,...j->...i", rotation(pose[..., 2]), points) + pose[..., :2]
    return moved


def unplace(pose: Floats, points: Floats) -> Floats:
    """The inverse of `place`."""
    back: Floats = np.einsum("...ji,...j->...i", rotation(pose[..., 2]), points - pose[..., :2])
    return back


def swing(quaternion: Floats, vectors: Floats) -> Floats:
    """Vectors (..., 3) turned by a quaternion [x, y, z, w] of any length but 0."""
    axis, scalar = quaternion[:3], quaternion[3]
    norm = float(quaternion @ quaternion)
    twice = 2.0 * np.cross(axis, vectors)
    turned: Floats = vectors + (scalar * twice + np.cross(axis, twice)) / norm
    return turned
