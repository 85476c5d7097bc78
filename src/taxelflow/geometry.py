"""Rigid motions of the plane: places and directions between frames, and the pose that fits points best.

A pose is (x, y, theta), in m, m, rad: `T_hand_pad` maps places in the pad's frame to the hand's.
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


def rigid_fit(before: Floats, now: Floats, information: Floats) -> tuple[Floats, Floats]:
    """The pose (3,) that maps points before (n, 2) closest to now (n, 2), and its covariance (3, 3).

    information: (n, 2, 2), inverse covariances of `now`. Gauss-Newton from the unweighted closed form (Arun et al.,
    1987). With one point, or all in one place, the turn is not observable: its variance is infinite and it is 0.
    """
    spread = before - before.mean(axis=0)
    if len(before) < 2 or np.sum(spread**2) < 1e-12:
        weight = information.sum(axis=0)
        shift = np.linalg.solve(weight, np.einsum("nij,nj->i", information, now - before))
        covariance = np.full((3, 3), 0.0)
        covariance[:2, :2] = np.linalg.inv(weight)
        covariance[2, 2] = np.inf
        return np.array([*shift, 0.0]), covariance
    apart = now - now.mean(axis=0)
    theta = np.arctan2(np.sum(spread[:, 0] * apart[:, 1] - spread[:, 1] * apart[:, 0]), np.sum(spread * apart))
    pose = np.array([0.0, 0.0, theta])
    pose[:2] = (now - place(pose, before)).mean(axis=0)
    normal = np.eye(3)
    for _ in range(8):
        turned = np.einsum("ij,nj->ni", rotation(pose[2]), before)
        jacobian = np.zeros((len(before), 2, 3))
        jacobian[:, 0, 0] = jacobian[:, 1, 1] = 1.0
        jacobian[:, 0, 2], jacobian[:, 1, 2] = -turned[:, 1], turned[:, 0]
        residual = now - turned - pose[:2]
        normal = np.einsum("nki,nkl,nlj->ij", jacobian, information, jacobian)
        step = np.linalg.solve(normal, np.einsum("nki,nkl,nl->i", jacobian, information, residual))
        pose = pose + step
        if np.abs(step).max() < 1e-12:
            break
    fitted: Floats = pose
    return fitted, np.asarray(np.linalg.inv(normal), dtype=np.float64)
