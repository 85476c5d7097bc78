"""A pressure pattern as a cubic B-spline on a square lattice of knots, seen by taxels through a pose.

Model of one reading:  y_i = g q(u_i) + n_i,  u_i = exp(-s) R(theta)^T (r_i - x),  q(u) = sum_j c_j B3((u - u_j) / h).
The pattern is what a taxel reads, already averaged over its area. If the object turns, that holds for small taxels
only; then q can be the mean over m x m points of the taxel, whose square does not turn with the object.

Lengths are in pitches of the pad, angles in rad. A state is (x, y, theta, g, s): pose, gain, and logarithm of size.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Floats

X, Y, THETA, GAIN, SIZE, STATE = range(6)
"""Places in a state."""

_BASIS = 4


@kernel
def basis(u: float, value: Floats, slope: Floats) -> None:
    """The four cubic B-splines that are not 0 at u in [0, 1) after a knot, and their derivatives."""
    v = 1.0 - u
    value[0] = v * v * v / 6.0
    value[1] = (4.0 - 6.0 * u * u + 3.0 * u * u * u) / 6.0
    value[2] = (4.0 - 6.0 * v * v + 3.0 * v * v * v) / 6.0
    value[3] = u * u * u / 6.0
    slope[0] = -0.5 * v * v
    slope[1] = -2.0 * u + 1.5 * u * u
    slope[2] = 2.0 * v - 1.5 * v * v
    slope[3] = 0.5 * u * u


@kernel
def evaluate(
    c: Floats,
    lattice: Floats,
    places: Floats,
    state: Floats,
    points: Floats,
    bend: Floats,
    out: Floats,
) -> None:
    """Fill out (taxels, 5): q and its derivatives by x, y, theta, s at each taxel; q is NaN off the lattice.

    c: (ny, nx) coefficients. lattice: knot spacing h, x and y of knot (0, 0). places: (2, taxels). points: (m * m, 2)
    offsets of the taxel's points of quadrature. bend: (3, taxels), how far each taxel's own pose is from the scan's
    (it is read later), or (3, 0).
    """
    ny, nx = c.shape
    h, left, low = lattice
    shrink = np.exp(-state[SIZE])
    cos, sin = shrink * np.cos(state[THETA]), shrink * np.sin(state[THETA])
    share = 1.0 / len(points)
    bx, by, sx, sy = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    for i in range(places.shape[1]):
        px, py = places[0, i] - state[X], places[1, i] - state[Y]
        if bend.shape[1]:
            px -= bend[0, i]
            py -= bend[1, i]
            cos = shrink * np.cos(state[THETA] + bend[2, i])
            sin = shrink * np.sin(state[THETA] + bend[2, i])
        value = slope_x = slope_y = slope_t = slope_s = 0.0
        for point in range(len(points)):
            dx, dy = px + points[point, 0], py + points[point, 1]
            u, w = cos * dx + sin * dy, cos * dy - sin * dx
            fx, fy = (u - left) / h, (w - low) / h
            ix, iy = int(np.floor(fx)), int(np.floor(fy))
            if ix < 1 or iy < 1 or ix + 2 >= nx or iy + 2 >= ny:
                value = np.nan
                continue
            basis(fx - ix, bx, sx)
            basis(fy - iy, by, sy)
            q = qu = qw = 0.0
            for a in range(4):
                along = across = 0.0
                for b in range(4):
                    coefficient = c[iy - 1 + a, ix - 1 + b]
                    along += bx[b] * coefficient
                    across += sx[b] * coefficient
                q += by[a] * along
                qu += by[a] * across
                qw += sy[a] * along
            qu /= h
            qw /= h
            value += q
            slope_x += qw * sin - qu * cos
            slope_y -= qw * cos + qu * sin
            slope_t += qu * w - qw * u
            slope_s -= qu * u + qw * w
        out[i, 0] = share * value
        out[i, 1] = share * slope_x
        out[i, 2] = share * slope_y
        out[i, 3] = share * slope_t
        out[i, 4] = share * slope_s


@kernel
def spread(
    shape: tuple[int, int],
    lattice: Floats,
    places: Floats,
    state: Floats,
    points: Floats,
    bend: Floats,
    width: int,
    first: NDArray[np.int64],
    weight: Floats,
) -> None:
    """Fill first (taxels,) and weight (taxels, width * width): q = sum of weight x coefficients from knot `first` on.

    Knots count row by row; a taxel's are a square of `width` knots. first is -1 off the lattice.
    """
    ny, nx = shape
    h, left, low = lattice
    shrink = np.exp(-state[SIZE])
    cos, sin = shrink * np.cos(state[THETA]), shrink * np.sin(state[THETA])
    share = 1.0 / len(points)
    margin = (width - _BASIS) // 2 + 1
    bx, by, slope = np.empty(4), np.empty(4), np.empty(4)
    for i in range(places.shape[1]):
        px, py = places[0, i] - state[X], places[1, i] - state[Y]
        if bend.shape[1]:
            px -= bend[0, i]
            py -= bend[1, i]
            cos = shrink * np.cos(state[THETA] + bend[2, i])
            sin = shrink * np.sin(state[THETA] + bend[2, i])
        corner_x = int(np.floor((cos * px + sin * py - left) / h)) - margin
        corner_y = int(np.floor((cos * py - sin * px - low) / h)) - margin
        weight[i] = 0.0
        if corner_x < 0 or corner_y < 0 or corner_x + width > nx or corner_y + width > ny:
            first[i] = -1
            continue
        first[i] = corner_y * nx + corner_x
        for point in range(len(points)):
            dx, dy = px + points[point, 0], py + points[point, 1]
            fx, fy = (cos * dx + sin * dy - left) / h, (cos * dy - sin * dx - low) / h
            ix, iy = int(np.floor(fx)), int(np.floor(fy))
            basis(fx - ix, bx, slope)
            basis(fy - iy, by, slope)
            for a in range(4):
                for b in range(4):
                    weight[i, (iy - 1 + a - corner_y) * width + ix - 1 + b - corner_x] += share * by[a] * bx[b]


def in_object(places: Floats, state: Floats) -> Floats:
    """Places (n, 2) on the pad, in the object's frame at a state (5,)."""
    cos, sin = np.cos(state[THETA]), np.sin(state[THETA])
    d = places - state[:2]
    inside: Floats = np.exp(-state[SIZE]) * np.stack([cos * d[:, 0] + sin * d[:, 1], cos * d[:, 1] - sin * d[:, 0]], 1)
    return inside
