"""Symmetric matrices of two to six rows: inverses, solver and eigenvalues, small and quick to compile."""

from __future__ import annotations

import numpy as np

from taxelflow.messages import Floats
from taxelflow.runtime.compiling import inlined, routine


@inlined
def inverse2(xx: float, xy: float, yy: float) -> tuple[float, float, float]:
    """Elements xx, xy, yy of the inverse of a symmetric matrix [[xx, xy], [xy, yy]]."""
    det = xx * yy - xy * xy
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
