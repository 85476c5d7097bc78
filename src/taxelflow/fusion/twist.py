"""Twist, rotor and centre of rotation of a field of displacements: one weighted fit per scan.

Slip vectors S_i at places r_i on the flattened hand (the paper's section on rotation):
    twist         S_i = v + omega x r_i, weighted least squares; v is the velocity at the hand's origin
    (8) rotor     dS_y/dx - dS_x/dy of the affine field that fits the vectors best; 2 omega if rigid
    (9) centre    c with v + omega x c = 0: for a rigid motion the rotor is the same everywhere, so the place without
                  motion is used instead of the paper's place without rotation
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from taxelflow.fusion.hand_frame import Carried
from taxelflow.messages import Floats
from taxelflow.numerics.records import Records, Vector
from taxelflow.numerics.rounding import LEAST_VARIANCE_M2, SIGNIFICANT
from taxelflow.numerics.small_linalg import eigenvalues2, inverse2, inverse3
from taxelflow.runtime.compiling import inlined, kernel, routine

_LEAST_DISTANCE_M = 1e-3
"""Distance of places below which they have no information on a rotation."""


class Row:
    """Motion of the object in one scan, in the hand frame; fields as in `Motions`. NaN is unknown."""

    velocity: Vector
    velocity_covariance: Annotated[Floats, 3, 3]
    rotor: float
    rotor_std: float
    centre: Annotated[Floats, 2]
    centre_std: Annotated[Floats, 2]
    pose: Vector
    pose_covariance: Annotated[Floats, 3, 3]
    pads: float


class Equations:
    """Scratch: normal equations of a scan, of the twist and of the affine field a + b x + c y of each component."""

    normal: Annotated[Floats, 3, 3]
    right: Vector
    affine: Annotated[Floats, 3, 3]
    right_x: Vector
    right_y: Vector
    inverse: Annotated[Floats, 3, 3]
    """Of `affine`."""
    solution: Vector
    """Of the equations of a pose."""
    inherited: Annotated[Floats, 3, 3]
    """See `inheritance`."""


@kernel
def fuse_twists(here: Carried, moved_cov: Floats, span_s: Floats, turns: bool, scratch: Records, rows: Records) -> None:
    """Fill the velocity, rotor, centre and pads of rows (scans,) of `Row`, which come in as NaN.

    moved_cov: (scans, pads, 2, 2). span_s: (scans, pads). turns: whether places are known at all. scratch: (1,) of
    `Equations`.
    """
    place, moved, turn, known = here.place, here.moved, here.turn, here.known
    equations: Equations = scratch[0]
    for scan in range(place.shape[0]):
        row: Row = rows[scan]
        clear(equations)
        count = own_turns = 0
        for pad in range(place.shape[1]):
            if known[scan, pad]:
                count += 1
                add_pad(equations, place[scan, pad], moved[scan, pad], moved_cov[scan, pad], span_s[scan, pad])
                own_turns += add_turn(equations, turn[scan, pad], span_s[scan, pad])
        row.pads = count
        enough = count > 1 or own_turns > 0  # for a singular covariance, rounding may look like information
        if turns and enough and turn_is_observable(equations.normal):
            solve_twist(equations, row)
            if count > 2 and spans_a_plane(equations.affine):
                solve_rotor(equations, row)
                row.rotor_std = np.sqrt(rotor_variance(here, moved_cov[scan], span_s[scan], scan, equations.inverse))
            find_centre(row)
        elif count > 0:
            solve_mean(equations, row)


@routine
def clear(equations: Equations) -> None:
    """Begin again, with no vector."""
    for a in range(3):
        equations.right[a] = equations.right_x[a] = equations.right_y[a] = 0.0
        for b in range(3):
            equations.normal[a, b] = equations.affine[a, b] = 0.0


@routine
def add_pad(equations: Equations, place: Floats, moved: Floats, moved_cov: Floats, span_s: float) -> None:
    """Add a displacement in the time span_s, which ended at a place, to all equations of a scan.

    A rigid motion moves the middle of the way along the displacement, its end by a part of the turn aside.
    """
    least, square = LEAST_VARIANCE_M2, span_s * span_s
    xx, xy, yy = inverse2(moved_cov[0, 0] + least, moved_cov[0, 1], moved_cov[1, 1] + least)
    xx, xy, yy = xx * square, xy * square, yy * square
    x, y, vx, vy = place[0] - 0.5 * moved[0], place[1] - 0.5 * moved[1], moved[0] / span_s, moved[1] / span_s
    add_point(equations, (xx, xy, yy), x, y, vx, vy)
    scalar = weight_in_curl(moved_cov, span_s)
    basis = (1.0, x, y)
    for i in range(3):
        equations.right_x[i] += scalar * basis[i] * vx
        equations.right_y[i] += scalar * basis[i] * vy
        for j in range(3):
            equations.affine[i, j] += scalar * basis[i] * basis[j]


@inlined
def weight_in_curl(moved_cov: Floats, span_s: float) -> float:
    """1 over the mean variance of a velocity: a pad that knows one direction only is worth nothing in the curl."""
    weight: float = 2.0 * span_s * span_s / (moved_cov[0, 0] + moved_cov[1, 1] + 2.0 * LEAST_VARIANCE_M2)
    return weight


@routine
def add_point(
    equations: Equations, weight: tuple[float, float, float], x: float, y: float, vx: float, vy: float
) -> None:
    """Add a vector (vx, vy) at (x, y) with weight (xx, xy, yy) to the equations for (vx, vy, omega) at the origin."""
    normal, right = equations.normal, equations.right
    xx, xy, yy = weight
    by_x, by_y = x * xy - y * xx, x * yy - y * xy  # row of omega in J^T W
    normal[0, 0] += xx
    normal[0, 1] += xy
    normal[1, 0] += xy
    normal[1, 1] += yy
    normal[0, 2] += by_x
    normal[2, 0] += by_x
    normal[1, 2] += by_y
    normal[2, 1] += by_y
    normal[2, 2] += x * by_y - y * by_x
    right[0] += xx * vx + xy * vy
    right[1] += xy * vx + yy * vy
    right[2] += by_x * vx + by_y * vy


@routine
def add_turn(equations: Equations, turn: Floats, span_s: float) -> bool:
    """Add a pad's own turn and its variance (2,), in the time span_s, if it is known; is it?"""
    if not turn[1] > 0.0:
        return False
    equations.normal[2, 2] += span_s * span_s / turn[1]
    equations.right[2] += span_s * turn[0] / turn[1]
    return True


@routine
def turn_is_observable(normal: Floats) -> bool:
    """Whether the turn is determined: information on it that no translation explains, at some distance or itself."""
    return bool(information_on_turn(normal) > _LEAST_DISTANCE_M**2 * 0.5 * (normal[0, 0] + normal[1, 1]))


@routine
def information_on_turn(normal: Floats) -> float:
    """What no translation explains: 1 over the variance of the turn."""
    xx, xy, yy = inverse2(normal[0, 0], normal[0, 1], normal[1, 1])
    a, b = normal[0, 2], normal[1, 2]
    return float(normal[2, 2] - (a * a * xx + 2.0 * a * b * xy + b * b * yy))


@routine
def solve_translation(equations: Equations, solution: Floats, covariance: Floats) -> None:
    """Fill the first two of solution (3,), and the upper left of covariance (3, 3)."""
    normal, right = equations.normal, equations.right
    xx, xy, yy = inverse2(normal[0, 0], normal[0, 1], normal[1, 1])
    solution[0], solution[1] = xx * right[0] + xy * right[1], xy * right[0] + yy * right[1]
    covariance[0, 0], covariance[1, 1] = xx, yy
    covariance[0, 1] = covariance[1, 0] = xy


@routine
def solve_mean(equations: Equations, row: Row) -> None:
    """Fill the velocity of a motion without a turn."""
    solve_translation(equations, row.velocity, row.velocity_covariance)


@routine
def solve_rigid(equations: Equations, solution: Floats, covariance: Floats) -> None:
    """Fill solution (3,) and covariance (3, 3)."""
    inverse3(equations.normal, covariance)
    for a in range(3):
        solution[a] = _product(covariance, a, equations.right)


@routine
def solve_twist(equations: Equations, row: Row) -> None:
    """Fill the velocity of a rigid motion, and its rotor, twice the rate of turn."""
    solve_rigid(equations, row.velocity, row.velocity_covariance)
    row.rotor, row.rotor_std = 2.0 * row.velocity[2], 2.0 * np.sqrt(row.velocity_covariance[2, 2])


@routine
def solve_rotor(equations: Equations, row: Row) -> None:
    """Fill the rotor of equation (8), from the affine field."""
    inverse = equations.inverse
    inverse3(equations.affine, inverse)
    row.rotor = _product(inverse, 1, equations.right_y) - _product(inverse, 2, equations.right_x)


@routine
def rotor_variance(here: Carried, moved_cov: Floats, span_s: Floats, scan: int, inverse: Floats) -> float:
    """That of the rotor of equation (8) by the whole covariances (pads, 2, 2), of which the weights know the mean only.

    inverse: of the affine equations.
    """
    variance, basis = 0.0, np.ones(3)
    for pad in range(len(moved_cov)):
        if here.known[scan, pad]:
            for a in range(2):
                basis[a + 1] = here.place[scan, pad, a] - 0.5 * here.moved[scan, pad, a]
            weight, cov = weight_in_curl(moved_cov[pad], span_s[pad]) / span_s[pad], moved_cov[pad]
            of_y, of_x = weight * _product(inverse, 1, basis), -weight * _product(inverse, 2, basis)
            variance += of_x * of_x * cov[0, 0] + 2.0 * of_x * of_y * cov[0, 1] + of_y * of_y * cov[1, 1]
            variance += (of_x * of_x + of_y * of_y) * LEAST_VARIANCE_M2
    return variance


@routine
def spans_a_plane(affine: Floats) -> bool:
    """Whether the places do not lie on one line. affine: weighted sums of (1, x, y)^T (1, x, y)."""
    weight = affine[0, 0]
    x, y = affine[0, 1] / weight, affine[0, 2] / weight
    least, _ = eigenvalues2(affine[1, 1] / weight - x * x, affine[2, 2] / weight - y * y, affine[1, 2] / weight - x * y)
    return bool(least > _LEAST_DISTANCE_M**2)


@routine
def find_centre(row: Row) -> None:
    """Where the velocity is 0: c = (-v_y, v_x) / omega, and its standard deviations to first order."""
    vx, vy, omega, P = row.velocity[0], row.velocity[1], row.velocity[2], row.velocity_covariance
    if omega * omega <= SIGNIFICANT**2 * P[2, 2]:
        return
    cx, cy = -vy / omega, vx / omega
    row.centre[0], row.centre[1] = cx, cy
    row.centre_std[0] = np.sqrt(P[1, 1] + 2.0 * cx * P[1, 2] + cx * cx * P[2, 2]) / abs(omega)
    row.centre_std[1] = np.sqrt(P[0, 0] - 2.0 * cy * P[0, 2] + cy * cy * P[2, 2]) / abs(omega)


@routine
def _product(matrix: Floats, row: int, vector: Floats) -> float:
    """One row of a (3, 3) matrix times a vector (3,)."""
    product: float = matrix[row, 0] * vector[0] + matrix[row, 1] * vector[1] + matrix[row, 2] * vector[2]
    return product
