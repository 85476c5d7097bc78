"""Symmetric matrices of two to six rows: inverses, solver and eigenvalues, small and quick to compile."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taxelflow.messages import Floats
from taxelflow.runtime.compiling import inlined, lean_kernel, routine

_CANCELLED = 4.0 * float(np.finfo(np.float64).eps)
"""Share of its terms that rounding may make of a determinant that is 0."""


@inlined
def inverse2(xx: float, xy: float, yy: float) -> tuple[float, float, float]:
    """Elements xx, xy, yy of the inverse of a symmetric positive matrix [[xx, xy], [xy, yy]].

    That of a matrix that is singular to rounding has no elements below 0 on its diagonal, but large ones.
    """
    det, least = xx * yy - xy * xy, _CANCELLED * xx * yy
    det = least if det < least else det
    return yy / det, -xy / det, xx / det


@routine
def inverse3(m: Floats, inverse: Floats) -> None:
    """Fill inverse with that of a symmetric (3, 3) matrix, by its cofactors: exact enough, and quick to compile."""
    c00 = m[1, 1] * m[2, 2] - m[1, 2] * m[1, 2]
    c01 = m[0, 2] * m[1, 2] - m[0, 1] * m[2, 2]
    c02 = m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1]
    det = m[0, 0] * c00 + m[0, 1] * c01 + m[0, 2] * c02
    c11 = m[0, 0] * m[2, 2] - m[0, 2] * m[0, 2]
    c12 = m[0, 1] * m[0, 2] - m[0, 0] * m[1, 2]
    c22 = m[0, 0] * m[1, 1] - m[0, 1] * m[0, 1]
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = c00 / det, c11 / det, c22 / det
    inverse[0, 1] = inverse[1, 0] = c01 / det
    inverse[0, 2] = inverse[2, 0] = c02 / det
    inverse[1, 2] = inverse[2, 1] = c12 / det


@inlined
def eigenvalues2(xx: float, yy: float, xy: float) -> tuple[float, float]:
    """Smaller and larger eigenvalue of the symmetric matrix [[xx, xy], [xy, yy]]."""
    middle, radius = 0.5 * (xx + yy), np.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
    return middle - radius, middle + radius


@routine
def solve_small(a: Floats, b: Floats, n: int) -> bool:
    """Solve a x = b for symmetric positive a (n, n) in place: a becomes its factor, b the solution."""
    if not factor_small(a, n):
        return False
    solve_factored(a, b, n)
    return True


class Factor5(NamedTuple):
    """L and D of a (5, 5) matrix L D L^T, row by row, and whether it is positive."""

    d0: float
    l10: float
    d1: float
    l20: float
    l21: float
    d2: float
    l30: float
    l31: float
    l32: float
    d3: float
    l40: float
    l41: float
    l42: float
    l43: float
    d4: float
    positive: bool


@inlined
def factor5(a: Floats, damping: float, least: float) -> Factor5:
    """That of a symmetric (5, 5), of which the lower half is read, its diagonal raised by damping times itself and by
    `least`.

    As by `factor_small`, but written out: its loops take three times as long.
    """
    d0 = a[0, 0] + (damping * a[0, 0] + least)
    l10, l20, l30, l40 = a[1, 0] / d0, a[2, 0] / d0, a[3, 0] / d0, a[4, 0] / d0
    d1 = a[1, 1] + (damping * a[1, 1] + least) - l10 * l10 * d0
    l21 = (a[2, 1] - l20 * l10 * d0) / d1
    l31 = (a[3, 1] - l30 * l10 * d0) / d1
    l41 = (a[4, 1] - l40 * l10 * d0) / d1
    d2 = a[2, 2] + (damping * a[2, 2] + least) - l20 * l20 * d0 - l21 * l21 * d1
    l32 = (a[3, 2] - l30 * l20 * d0 - l31 * l21 * d1) / d2
    l42 = (a[4, 2] - l40 * l20 * d0 - l41 * l21 * d1) / d2
    d3 = a[3, 3] + (damping * a[3, 3] + least) - l30 * l30 * d0 - l31 * l31 * d1 - l32 * l32 * d2
    l43 = (a[4, 3] - l40 * l30 * d0 - l41 * l31 * d1 - l42 * l32 * d2) / d3
    d4 = a[4, 4] + (damping * a[4, 4] + least) - l40 * l40 * d0 - l41 * l41 * d1 - l42 * l42 * d2 - l43 * l43 * d3
    positive = d0 > 0.0 and d1 > 0.0 and d2 > 0.0 and d3 > 0.0 and d4 > 0.0
    return Factor5(d0, l10, d1, l20, l21, d2, l30, l31, l32, d3, l40, l41, l42, l43, d4, positive)


@inlined
def solved5(
    f: Factor5, b0: float, b1: float, b2: float, b3: float, b4: float
) -> tuple[float, float, float, float, float]:
    """The solution of a x = b, with f from `factor5`."""
    b1 -= f.l10 * b0
    b2 = b2 - f.l20 * b0 - f.l21 * b1
    b3 = b3 - f.l30 * b0 - f.l31 * b1 - f.l32 * b2
    b4 = b4 - f.l40 * b0 - f.l41 * b1 - f.l42 * b2 - f.l43 * b3
    x4 = b4 / f.d4
    x3 = b3 / f.d3 - f.l43 * x4
    x2 = b2 / f.d2 - f.l32 * x3 - f.l42 * x4
    x1 = b1 / f.d1 - f.l21 * x2 - f.l31 * x3 - f.l41 * x4
    return b0 / f.d0 - f.l10 * x1 - f.l20 * x2 - f.l30 * x3 - f.l40 * x4, x1, x2, x3, x4


@routine
def factor_small(a: Floats, n: int) -> bool:
    """Make symmetric a (n, n) its factor L D L^T, from its lower half; False if it is not positive."""
    for j in range(n):
        d = a[j, j]
        for k in range(j):
            d -= a[j, k] * a[j, k] * a[k, k]
        if not d > 0.0:
            return False
        a[j, j] = d
        for i in range(j + 1, n):
            v = a[i, j]
            for k in range(j):
                v -= a[i, k] * a[j, k] * a[k, k]
            a[i, j] = v / d
    return True


@routine
def solve_factored(a: Floats, b: Floats, n: int) -> None:
    """Make b (n,) the solution of a x = b, with a from `factor_small`."""
    for i in range(n):
        for k in range(i):
            b[i] -= a[i, k] * b[k]
    for i in range(n):
        b[i] /= a[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= a[k, i] * b[k]


@lean_kernel
def copy_matrix(a: Floats, out: Floats) -> None:
    """Fill out (n, m) with a (n, m)."""
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            out[i, j] = a[i, j]


@routine
def mirror(matrix: Floats) -> None:
    """Make a matrix (n, n), of which the lower half is known, symmetric."""
    for a in range(len(matrix)):
        for b in range(a):
            matrix[b, a] = matrix[a, b]


@inlined
def put_lower(rows: tuple[float, ...], matrix: Floats, n: int) -> None:
    """Fill the lower half of a matrix (n, n), given row by row."""
    k = 0
    for a in range(n):
        for b in range(a + 1):
            matrix[a, b] = rows[k]
            k += 1


@inlined
def add_lower(rows: tuple[float, ...], matrix: Floats, n: int) -> None:
    """Add to the lower half of a matrix (n, n), given row by row."""
    k = 0
    for a in range(n):
        for b in range(a + 1):
            matrix[a, b] += rows[k]
            k += 1
