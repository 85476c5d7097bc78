"""Twist, rotor and centre of rotation of a field of displacements: one weighted fit per scan."""

from __future__ import annotations

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.small_linalg import eigenvalues2, inverse2, inverse3

# Columns of a motion's row.
TWIST, COV_TWIST, ROTOR, STD_ROTOR, CENTRE_X, CENTRE_Y, STD_CENTRE_X, STD_CENTRE_Y = 0, 3, 12, 13, 14, 15, 16, 17
POSE, COV_POSE, COUNT, COLUMNS = 18, 21, 30, 31

_APART_M = 1e-3
"""Places closer together than this say nothing of a turn."""
_SURE = 3.0
"""A centre of rotation is given where the rate of turn exceeds so many of its standard deviations."""
_TINY_M2 = 1e-18
"""Variance of a displacement of which noise says nothing: a nanometre."""


@kernel
def fuse_twists(
    place: Floats,
    moved: Floats,
    moved_cov: Floats,
    turn: Floats,
    span: Floats,
    known: Bools,
    turns: bool,
    rows: Floats,
) -> None:
    """Fill the twist's columns of rows (scans, COLUMNS), which come in as NaN.

    place, moved: (scans, pads, 2) in the hand. moved_cov: (scans, pads, 2, 2). turn: (scans, pads, 2), turn and its
    variance where the method knows it, else NaN. span: (scans, pads), s. known: (scans, pads). turns: whether places
    are known at all.
    """
    for scan in range(place.shape[0]):
        normal, right = np.zeros((3, 3)), np.zeros(3)
        affine, rhs_x, rhs_y = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
        count = 0
        rows[scan, COUNT] = 0.0
        weight_sum = mean_x = mean_y = 0.0
        for pad in range(place.shape[1]):
            if not known[scan, pad]:
                continue
            count += 1
            dt = span[scan, pad]
            x, y = place[scan, pad, 0], place[scan, pad, 1]
            vx, vy = moved[scan, pad, 0] / dt, moved[scan, pad, 1] / dt
            w = inverse2(moved_cov[scan, pad], _TINY_M2)
            w *= dt * dt
            add_point(normal, right, w, x, y, vx, vy)
            if turn[scan, pad, 1] > 0.0:
                normal[2, 2] += dt * dt / turn[scan, pad, 1]
                right[2] += dt * turn[scan, pad, 0] / turn[scan, pad, 1]
            # Of the mean variance: a pad that knows one direction only is worth nothing here.
            scalar = 2.0 * (w[0, 0] * w[1, 1] - w[0, 1] * w[0, 1]) / (w[0, 0] + w[1, 1])
            basis = np.array([1.0, x, y])
            for i in range(3):
                rhs_x[i] += scalar * basis[i] * vx
                rhs_y[i] += scalar * basis[i] * vy
                for j in range(3):
                    affine[i, j] += scalar * basis[i] * basis[j]
            weight_sum += scalar
            mean_x += scalar * x
            mean_y += scalar * y
        if count == 0:
            continue
        rows[scan, COUNT] = count
        solvable = turns and turn_is_seen(normal)
        if not solvable:
            cov = inverse2(normal, 0.0)
            rows[scan, TWIST : TWIST + 2] = cov @ right[:2]
            put_matrix(rows[scan], COV_TWIST, cov)
            continue
        covariance = inverse3(normal)
        twist = covariance @ right
        rows[scan, TWIST : TWIST + 3] = twist
        put_matrix(rows[scan], COV_TWIST, covariance)
        rows[scan, ROTOR], rows[scan, STD_ROTOR] = 2.0 * twist[2], 2.0 * np.sqrt(covariance[2, 2])
        if count > 2 and _spans_a_plane(affine, weight_sum, mean_x / weight_sum, mean_y / weight_sum):
            inverse = inverse3(affine)
            rows[scan, ROTOR] = (inverse @ rhs_y)[1] - (inverse @ rhs_x)[2]
            rows[scan, STD_ROTOR] = np.sqrt(inverse[1, 1] + inverse[2, 2])
        _centre(twist, covariance, rows[scan])


@kernel
def put_matrix(row: Floats, start: int, matrix: Floats) -> None:
    """Write a (2, 2) or (3, 3) matrix into the nine numbers of a 3 x 3 one, row by row."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            row[start + 3 * i + j] = matrix[i, j]


@kernel
def add_point(normal: Floats, right: Floats, w: Floats, x: float, y: float, vx: float, vy: float) -> None:
    """Add a vector (vx, vy) at (x, y) with weight w (2, 2) to normal equations for (vx, vy, omega) at the origin."""
    jacobian = np.array([[1.0, 0.0, -y], [0.0, 1.0, x]])
    weighted = jacobian.T @ w
    normal += weighted @ jacobian
    right += weighted @ np.array([vx, vy])


@kernel
def turn_is_seen(normal: Floats) -> bool:
    """Whether the turn is determined: information on it that no translation explains, at some distance or itself."""
    block = inverse2(normal, 0.0)
    a, b = normal[0, 2], normal[1, 2]
    left = normal[2, 2] - (a * a * block[0, 0] + 2.0 * a * b * block[0, 1] + b * b * block[1, 1])
    return bool(left > _APART_M**2 * 0.5 * (normal[0, 0] + normal[1, 1]))


@kernel
def _spans_a_plane(affine: Floats, weight: float, mean_x: float, mean_y: float) -> bool:
    """Whether the places do not lie on one line."""
    xx = affine[1, 1] / weight - mean_x * mean_x
    yy = affine[2, 2] / weight - mean_y * mean_y
    xy = affine[1, 2] / weight - mean_x * mean_y
    least, _ = eigenvalues2(xx, yy, xy)
    return bool(least > _APART_M**2)


@kernel
def _centre(twist: Floats, covariance: Floats, row: Floats) -> None:
    """Where the velocity is 0: c = (-v_y, v_x) / omega, and its standard deviations to first order."""
    vx, vy, omega = twist
    if omega * omega <= _SURE**2 * covariance[2, 2]:
        return
    cx, cy = -vy / omega, vx / omega
    along_x = np.array([0.0, -1.0 / omega, -cx / omega])
    along_y = np.array([1.0 / omega, 0.0, -cy / omega])
    row[CENTRE_X], row[CENTRE_Y] = cx, cy
    row[STD_CENTRE_X] = np.sqrt(along_x @ covariance @ along_x)
    row[STD_CENTRE_Y] = np.sqrt(along_y @ covariance @ along_y)
