"""A surface as a cubic B-spline on a square lattice of knots, read by taxels at a pose of the surface on the pad.

Model of one reading:  y_i = g q(u_i) + n_i,  u_i = exp(-s) R(theta)^T (r_i - x),  q(u) = sum_j c_j B3((u - u_j) / h).
The surface q is what a taxel reads, averaged over the taxel's area. If the surface turns, that holds for small taxels
only.

Lengths are in pitches of the pad, angles in rad. A state (5,) is (x, y, theta, g, s): pose, gain, and logarithm of
size. `state_of` and `states_of` give its parts by name.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.messages import Floats
from taxelflow.numerics.banded import WIDTH
from taxelflow.runtime.compiling import inlined, kernel, routine

if TYPE_CHECKING:
    from numpy.typing import NDArray

KNOTS = WIDTH**2
"""Knots that a reading depends on."""
AT_KNOT, SLOPE_AT_KNOT = np.array([1.0, 4.0, 1.0]) / 6.0, np.array([-0.5, 0.0, 0.5])
"""A cubic B-spline's value and slope at a knot, from the coefficients around it."""
_1, _2, _3 = np.uint64(1), np.uint64(2), np.uint64(3)


class State(NamedTuple):
    """The components of one state: x and y, pitches; theta, rad; the gain on the pattern's pressure; log size."""

    x: float
    y: float
    theta: float
    gain: float
    size: float


STATE = len(State._fields)
"""Components of a state."""


class States(NamedTuple):
    """The components of many states, each a view (n,): writing to it changes the states."""

    x: Floats
    y: Floats
    theta: Floats
    gain: Floats
    size: Floats


@inlined
def state_of(vector: Floats) -> State:
    """The components of a state (5,)."""
    return State(vector[0], vector[1], vector[2], vector[3], vector[4])


@inlined
def put(state: State, vector: Floats) -> None:
    """Fill vector (5,) with a state."""
    vector[0], vector[1], vector[2], vector[3], vector[4] = state


def states_of(vectors: Floats) -> States:
    """The parts of states (n, 5)."""
    return States(*vectors.T)


def pose_part(vectors: Floats) -> Floats:
    """(..., 3), a view: x, y and theta of states (..., 5)."""
    return vectors[..., :3]


@inlined
def basis(u: float) -> tuple[float, float, float, float]:
    """The four cubic B-splines that are not 0 at u in [0, 1) after a knot."""
    v = 1.0 - u
    first, last = v * v * v / 6.0, u * u * u / 6.0
    second = 2.0 / 3.0 - u * u + 3.0 * last
    return first, second, 1.0 - first - second - last, last


@inlined
def basis_slopes(u: float) -> tuple[float, float, float, float]:
    """Derivatives of `basis`."""
    v = 1.0 - u
    return -0.5 * v * v, (1.5 * u - 2.0) * u, (2.0 - 1.5 * v) * v, 0.5 * u * u


@inlined
def basis_bends(u: float) -> tuple[float, float, float, float]:
    """Second derivatives of `basis`."""
    return 1.0 - u, 3.0 * u - 2.0, 1.0 - 3.0 * u, u


@inlined
def value_at(c: Floats, x: float, y: float) -> tuple[float, float, float]:
    """The spline with coefficients c (ny, nx), and its slopes, at a place counted in knots; its value is NaN off the
    lattice.

    Written out and without a branch, because a scan's time goes here, and eight taxels go at once. There are at least
    4 x 4 knots.
    """
    ny, nx = c.shape
    on = (x >= 1.0) & (x < nx - 2.0) & (y >= 1.0) & (y < ny - 2.0)
    x, y = x if on else 1.0, y if on else 1.0
    k, j = int(x), int(y)
    u, w = x - k, y - j
    x0, x1, x2, x3 = basis(u)
    y0, y1, y2, y3 = basis(w)
    r0, r1, r2, r3 = basis_slopes(u)
    s0, s1, s2, s3 = basis_slopes(w)
    k0, j0 = np.uint64(k - 1), np.uint64(j - 1)  # unsigned, for no index counts from the end
    k1, k2, k3 = k0 + _1, k0 + _2, k0 + _3
    j1, j2, j3 = j0 + _1, j0 + _2, j0 + _3
    c00, c01, c02, c03 = c[j0, k0], c[j0, k1], c[j0, k2], c[j0, k3]
    c10, c11, c12, c13 = c[j1, k0], c[j1, k1], c[j1, k2], c[j1, k3]
    c20, c21, c22, c23 = c[j2, k0], c[j2, k1], c[j2, k2], c[j2, k3]
    c30, c31, c32, c33 = c[j3, k0], c[j3, k1], c[j3, k2], c[j3, k3]
    a0 = y0 * c00 + y1 * c10 + y2 * c20 + y3 * c30
    a1 = y0 * c01 + y1 * c11 + y2 * c21 + y3 * c31
    a2 = y0 * c02 + y1 * c12 + y2 * c22 + y3 * c32
    a3 = y0 * c03 + y1 * c13 + y2 * c23 + y3 * c33
    b0 = s0 * c00 + s1 * c10 + s2 * c20 + s3 * c30
    b1 = s0 * c01 + s1 * c11 + s2 * c21 + s3 * c31
    b2 = s0 * c02 + s1 * c12 + s2 * c22 + s3 * c32
    b3 = s0 * c03 + s1 * c13 + s2 * c23 + s3 * c33
    return (
        x0 * a0 + x1 * a1 + x2 * a2 + x3 * a3 if on else np.nan,
        r0 * a0 + r1 * a1 + r2 * a2 + r3 * a3,
        x0 * b0 + x1 * b1 + x2 * b2 + x3 * b3,
    )


@inlined
def by_state(u: float, w: float, qu: float, qw: float, cos: float, sin: float) -> tuple[float, float, float, float]:
    """Derivatives of q by x, y, theta, s, from its slopes qu, qw at (u, w) from the object, in knots.

    cos, sin: of theta, times exp(-s) / h.
    """
    return qw * sin - qu * cos, -qw * cos - qu * sin, qu * w - qw * u, -qu * u - qw * w


@kernel
def evaluate(c: Floats, lattice: Floats, places: Floats, state: Floats, bend: Floats, out: Floats) -> None:
    """Fill out (taxels, 5): q and its derivatives by x, y, theta, s at each taxel; q is NaN off the lattice.

    c: (ny, nx) coefficients. lattice: knot spacing h, x and y of knot (0, 0). places: (2, taxels). bend: (3, taxels),
    how far each taxel's own pose is from the scan's (it is read later), or (3, 0).
    """
    h, left, low = lattice
    left, low = left / h, low / h
    at = state_of(state)
    scale = np.exp(-at.size) / h
    cos, sin = scale * np.cos(at.theta), scale * np.sin(at.theta)
    for i in range(places.shape[1]):
        dx, dy = places[0, i] - at.x, places[1, i] - at.y
        if bend.shape[1]:
            dx -= bend[0, i]
            dy -= bend[1, i]
            cos, sin = scale * np.cos(at.theta + bend[2, i]), scale * np.sin(at.theta + bend[2, i])
        u, w = cos * dx + sin * dy, cos * dy - sin * dx
        out[i, 0], qu, qw = value_at(c, u - left, w - low)
        out[i, 1], out[i, 2], out[i, 3], out[i, 4] = by_state(u, w, qu, qw, cos, sin)


@kernel
def spread(
    shape: tuple[int, int],
    lattice: Floats,
    places: Floats,
    state: Floats,
    bend: Floats,
    first: NDArray[np.int64],
    weight: Floats,
) -> None:
    """Fill first (taxels,) and weight (taxels, 16): q = sum of weight x coefficients of 4 x 4 knots from `first` on.

    Knots count row by row. first is -1 off the lattice. Others as for `evaluate`.
    """
    ny, nx = shape
    h, left, low = lattice
    at = state_of(state)
    shrink = np.exp(-at.size)
    cos, sin = shrink * np.cos(at.theta), shrink * np.sin(at.theta)
    for i in range(places.shape[1]):
        dx, dy = places[0, i] - at.x, places[1, i] - at.y
        if bend.shape[1]:
            dx -= bend[0, i]
            dy -= bend[1, i]
            cos = shrink * np.cos(at.theta + bend[2, i])
            sin = shrink * np.sin(at.theta + bend[2, i])
        fx, fy = (cos * dx + sin * dy - left) / h, (cos * dy - sin * dx - low) / h
        ix, iy = int(np.floor(fx)), int(np.floor(fy))
        if ix < 1 or iy < 1 or ix + 2 >= nx or iy + 2 >= ny:
            first[i] = -1
            for a in range(KNOTS):
                weight[i, a] = 0.0
            continue
        first[i] = (iy - 1) * nx + ix - 1
        bx, by = basis(fx - ix), basis(fy - iy)
        for a in range(KNOTS):
            weight[i, a] = by[a // 4] * bx[a % 4]


@inlined
def add_around(pull: float, weight: Floats, first: int, nx: int, out: Floats) -> None:
    """Add pull x weight (16,), as from `spread`, to the 4 x 4 knots from `first` on of out (knots,). nx: knots in a row
    of the lattice. Unsigned indices are not checked for being below 0, which takes as long as the sum.
    """
    side, corner = np.uint64(4), np.uint64(first)
    for row in range(side):
        knot = corner + row * np.uint64(nx)
        for column in range(side):
            out[knot + column] += pull * weight[side * row + column]


@inlined
def sum_around(knots: Floats, weight: Floats, first: int, nx: int) -> float:
    """Sum of knots x weight (16,) over these knots; see `add_around`."""
    side, corner, total = np.uint64(4), np.uint64(first), 0.0
    for row in range(side):
        knot = corner + row * np.uint64(nx)
        for column in range(side):
            total += knots[knot + column] * weight[side * row + column]
    return total


@routine
def gather(first: NDArray[np.int64], weight: Floats, values: Floats, nx: int, out: Floats) -> None:
    """Add values (n, taxels), spread over 4 x 4 knots each, to out (n, knots): the transpose of an evaluation.

    first: (taxels,), weight: (taxels, 16), both from `spread`. nx: see `add_around`.
    """
    for i in range(len(first)):
        if first[i] < 0:
            continue
        for row in range(len(values)):
            add_around(values[row, i], weight[i], first[i], nx, out[row])


def in_object(places: Floats, state: Floats) -> Floats:
    """Places (n, 2) on the pad, in the object's frame at a state (5,)."""
    at = state_of(state)
    cos, sin = np.cos(at.theta), np.sin(at.theta)
    d = places - state[:2]
    inside: Floats = np.exp(-at.size) * np.stack([cos * d[:, 0] + sin * d[:, 1], cos * d[:, 1] - sin * d[:, 0]], 1)
    return inside
