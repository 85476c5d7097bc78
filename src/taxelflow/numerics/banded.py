"""Normal equations of spline coefficients on a lattice: sums over readings, smoothness prior, banded Cholesky solver.

A coefficient is coupled only with those fewer than WIDTH knots away, so the symmetric matrix is kept as a stencil
(knots, WIDTH, 2 WIDTH - 1): entry (j, dy, dx + WIDTH - 1) couples knot j with the knot dy rows and dx columns on.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg.lapack import dpbtrf, dpbtrs, dtbtrs

from taxelflow.runtime.compiling import inlined, long_kernel, routine

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Floats

WIDTH = 4
"""Knots along each axis that a reading depends on: those of a cubic B-spline."""


@long_kernel
def add_square(
    first: int, weight: Floats, factor: float, reading: float, nx: int, stencil: Floats, right: Floats
) -> None:
    """Add factor x (weight weight^T) to the stencil and factor x weight x reading to the right-hand side.

    weight: (WIDTH * WIDTH,) on the square of knots from `first`.
    """
    for qy in range(WIDTH):
        for qx in range(WIDTH):
            wq = factor * weight[qy * WIDTH + qx]
            knot = np.uint64(first + qy * nx + qx)
            right[knot] += wq * reading
            _add_knot(qy, qx, wq, weight, stencil[knot])


@inlined
def _add_knot(qy: int, qx: int, wq: float, weight: Floats, coupled: Floats) -> None:
    """Add wq x weight to what a knot is coupled with (WIDTH, 2 WIDTH - 1): itself and those after it, in its row of
    knots and, WIDTH at once, in those that follow.
    """
    for ax in range(qx, WIDTH):
        coupled[0, ax - qx + WIDTH - 1] += wq * weight[qy * WIDTH + ax]
    for ay in range(qy + 1, WIDTH):
        for ax in range(WIDTH):
            coupled[ay - qy, ax - qx + WIDTH - 1] += wq * weight[ay * WIDTH + ax]


@long_kernel
def multiply(stencil: Floats, nx: int, vector: Floats, out: Floats) -> None:
    """Fill out (knots,) with the symmetric matrix times vector."""
    out[:] = 0.0
    for j in range(len(stencil)):
        _multiply_knot(stencil[j], j, nx, vector, out)


@routine
def _multiply_knot(coupled: Floats, j: int, nx: int, vector: Floats, out: Floats) -> None:
    """Add to out (knots,) the products of knot j with those that it is coupled with (WIDTH, 2 WIDTH - 1)."""
    for dy, row in enumerate(coupled):
        for k, v in enumerate(row):
            if v == 0.0:
                continue
            i = j + dy * nx + k - WIDTH + 1
            out[i] += v * vector[j]
            if i != j:
                out[j] += v * vector[i]


@long_kernel
def to_band(stencil: Floats, shape: tuple[int, int], columnwise: bool, band: Floats) -> None:
    """Fill the lower band by columns, (knots, offsets): transposed, it is what LAPACK takes.

    shape: (ny, nx) of the lattice. columnwise: whether knots are numbered column by column, not row by row.
    """
    ny, nx = shape
    by_y, by_x = (1, ny) if columnwise else (nx, 1)
    band[:] = 0.0
    for y in range(ny):
        for x in range(nx):
            _knot_to_band(stencil[y * nx + x], y * by_y + x * by_x, by_y, by_x, band)


@routine
def _knot_to_band(coupled: Floats, knot: int, by_y: int, by_x: int, band: Floats) -> None:
    """Add to the band what a knot is coupled with. by_y, by_x: from a knot's number to the next."""
    for dy in range(WIDTH):
        for k in range(2 * WIDTH - 1):
            if coupled[dy, k] != 0.0:
                offset = dy * by_y + (k - WIDTH + 1) * by_x
                band[knot + min(offset, 0), abs(offset)] += coupled[dy, k]


@lru_cache(maxsize=16)
def smoothness(shape: tuple[int, int]) -> Floats:
    """Stencil of the sum of squared second differences along x, along y, and twice across. It is shared."""
    ny, nx = shape
    stencil = np.zeros((ny * nx, WIDTH, 2 * WIDTH - 1))
    knots: NDArray[np.int64] = np.arange(ny * nx).reshape(ny, nx)
    _add_differences(stencil, nx, [knots[:, :-2], knots[:, 1:-1], knots[:, 2:]], (1.0, -2.0, 1.0), 1.0)
    _add_differences(stencil, nx, [knots[:-2], knots[1:-1], knots[2:]], (1.0, -2.0, 1.0), 1.0)
    corners = [knots[:-1, :-1], knots[1:, :-1], knots[:-1, 1:], knots[1:, 1:]]
    _add_differences(stencil, nx, corners, (1.0, -1.0, -1.0, 1.0), 2.0)
    return stencil


def _add_differences(
    stencil: Floats, nx: int, knots: list[NDArray[np.int64]], signs: tuple[float, ...], factor: float
) -> None:
    for one, sign in zip(knots, signs, strict=True):
        for other, against in zip(knots, signs, strict=True):
            low, high = one.ravel(), other.ravel()
            ahead = high >= low
            low, high = low[ahead], high[ahead]
            dx = high % nx - low % nx
            np.add.at(stencil, (low, (high - low - dx) // nx, dx + WIDTH - 1), factor * sign * against)


def add_diagonal(stencil: Floats, value: float) -> None:
    """Add a value to the diagonal of a stencil."""
    stencil[:, 0, WIDTH - 1] += value


def lower_factor(stencil: Floats, shape: tuple[int, int], *, columnwise: bool = False) -> Floats:
    """(band, knots), the lower Cholesky factor of a positive matrix, as LAPACK keeps it. Arguments as for `to_band`."""
    band = np.empty((len(stencil), (WIDTH - 1) * (shape[0 if columnwise else 1] + 1) + 1))
    to_band(stencil, shape, columnwise, band)
    lower, not_positive = dpbtrf(band.T, lower=1, overwrite_ab=1)  # without what `scipy.linalg` checks each time
    if not_positive:
        raise np.linalg.LinAlgError(f"the normal equations of {len(band)} knots are not positive definite")
    return np.asarray(lower)


class Factor:
    """Cholesky factor of a positive matrix that is given as a stencil.

    Its time grows with the square of the band, so knots are numbered along the shorter side of the lattice.
    """

    def __init__(self, stencil: Floats, nx: int) -> None:
        ny = len(stencil) // nx
        self._shape, self._columnwise = (ny, nx), ny < nx
        self._lower = lower_factor(stencil, self._shape, columnwise=self._columnwise)

    def solve(self, right: Floats) -> Floats:
        """The solution for one right-hand side (knots,) or several (knots, n)."""
        return self._by_rows(dpbtrs(self._lower, self._as_factored(right), lower=1)[0])

    def whitened(self, vectors: Floats) -> Floats:
        """(knots, n), the inverse of the factor times vectors (knots, n); its rows are numbered as in the factor."""
        return np.asarray(dtbtrs(self._lower, self._as_factored(vectors), uplo="L")[0])

    def drawn(self, white: Floats) -> Floats:
        """(knots, n), draws of what the matrix is the information on, from white noise (knots, n)."""
        return self._by_rows(dtbtrs(self._lower, white, uplo="L", trans="T")[0])

    def _as_factored(self, vectors: Floats) -> Floats:
        """Vectors (knots, ...) that are numbered row by row, numbered as in the factor."""
        return _renumbered(vectors, self._shape) if self._columnwise else vectors

    def _by_rows(self, vectors: Floats) -> Floats:
        """The reverse of `_as_factored`."""
        return _renumbered(vectors, self._shape[::-1]) if self._columnwise else vectors


def _renumbered(vectors: Floats, shape: tuple[int, int]) -> Floats:
    """Vectors (knots, ...) numbered row by row on a lattice of this shape, numbered column by column."""
    return np.swapaxes(vectors.reshape(*shape, *vectors.shape[1:]), 0, 1).reshape(vectors.shape)


@routine
def solve_band(factor: Floats, right: Floats) -> None:
    """Solve in place for right-hand sides (n, knots), which may be mostly 0.

    factor: (knots, band), the lower Cholesky factor by columns: `lower_factor` transposed, contiguous.
    """
    knots, band = factor.shape
    for row in range(len(right)):
        x = right[row]
        for j in range(knots):
            if x[j] == 0.0:
                continue
            value = x[j] / factor[j, 0]
            x[j] = value
            for k in range(1, min(band, knots - j)):
                x[j + k] -= factor[j, k] * value
        for j in range(knots - 1, -1, -1):
            value = x[j]
            for k in range(1, min(band, knots - j)):
                value -= factor[j, k] * x[j + k]
            x[j] = value / factor[j, 0]
