"""Poses and symmetric eigenvalues for kernels, written out; `numerics.geometry` has poses for whole arrays."""

from __future__ import annotations

import numpy as np

from taxelflow.messages import Bools, Floats
from taxelflow.runtime.compiling import lean_kernel

_NEGLIGIBLE = 1e-30
"""Sum of squares off the diagonal, over the squared trace, at which a matrix is diagonal."""
_SMALL_RAD2 = 1e-8
"""Squared angle below which the first terms of the series are exact to rounding."""


@lean_kernel
def compose(a: Floats, b: Floats, out: Floats) -> None:
    """Fill out (4, 4) with the pose a b; out is neither of them."""
    for i in range(3):
        for j in range(4):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
        out[i, 3] += a[i, 3]
        out[3, i] = 0.0
    out[3, 3] = 1.0


@lean_kernel
def invert(a: Floats, out: Floats) -> None:
    """Fill out (4, 4) with the inverse of a pose."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[j, i]
        out[i, 3] = -(a[0, i] * a[0, 3] + a[1, i] * a[1, 3] + a[2, i] * a[2, 3])
        out[3, i] = 0.0
    out[3, 3] = 1.0


@lean_kernel
def exponential(xi: Floats, out: Floats) -> None:
    """Fill out (4, 4) with the pose that the twist (6,) reaches in unit time."""
    x, y, z = xi[3], xi[4], xi[5]
    t2 = x * x + y * y + z * z
    if t2 < _SMALL_RAD2:
        a, b, c = 1.0 - t2 / 6.0, 0.5 - t2 / 24.0, 1.0 / 6.0 - t2 / 120.0
    else:
        t = np.sqrt(t2)
        a, b, c = np.sin(t) / t, (1.0 - np.cos(t)) / t2, (t - np.sin(t)) / (t2 * t)
    w = ((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0))
    for i in range(3):
        out[i, 3] = xi[i]
        out[3, i] = 0.0
        for j in range(3):
            square = w[i][0] * w[0][j] + w[i][1] * w[1][j] + w[i][2] * w[2][j]
            out[i, j] = (1.0 if i == j else 0.0) + a * w[i][j] + b * square
            out[i, 3] += (b * w[i][j] + c * square) * xi[j]
    out[3, 3] = 1.0


@lean_kernel
def planar_rows(K: Floats, centre: Floats, rows: Floats) -> None:
    """Fill rows (3, 6): what a contact frame K (4, 4) sees along its x, y and about its z of a twist at `centre`.

    The twist (vx, vy, vz, wx, wy, wz) is that of the point at `centre` (3,), along the axes of the outer frame.
    """
    dx, dy, dz = K[0, 3] - centre[0], K[1, 3] - centre[1], K[2, 3] - centre[2]
    for a in range(2):
        ex, ey, ez = K[0, a], K[1, a], K[2, a]
        rows[a, 0], rows[a, 1], rows[a, 2] = ex, ey, ez
        rows[a, 3], rows[a, 4], rows[a, 5] = dy * ez - dz * ey, dz * ex - dx * ez, dx * ey - dy * ex
    for i in range(3):
        rows[2, i], rows[2, i + 3] = 0.0, K[i, 2]


@lean_kernel
def eigen_symmetric(a: Floats, values: Floats, vectors: Floats, n: int) -> None:
    """Eigenvalues (n,) and eigenvectors (n, n), in columns, of symmetric a (n, n), by Jacobi's method; a is used up.

    Not sorted. Source: Golub & Van Loan, Matrix Computations, section 8.5.
    """
    for i in range(n):
        for j in range(n):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(30):  # sweeps at most; a few suffice
        off, trace = 0.0, 0.0
        for i in range(n):
            trace += abs(a[i, i])
            for j in range(i):
                off += a[i, j] * a[i, j]
        if not off > _NEGLIGIBLE * trace * trace:
            break
        for p in range(n - 1):
            for q in range(p + 1, n):
                rotate_pair(a, vectors, p, q, n)
    for i in range(n):
        values[i] = a[i, i]


@lean_kernel
def rotate_pair(a: Floats, vectors: Floats, p: int, q: int, n: int) -> None:
    """One Jacobi rotation of a symmetric matrix that makes a[p, q] vanish."""
    if a[p, q] == 0.0:
        return
    half = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
    t = (1.0 if half >= 0.0 else -1.0) / (abs(half) + np.sqrt(half * half + 1.0))
    c = 1.0 / np.sqrt(t * t + 1.0)
    s = t * c
    for k in range(n):
        a[k, p], a[k, q] = c * a[k, p] - s * a[k, q], s * a[k, p] + c * a[k, q]
    for k in range(n):
        a[p, k], a[q, k] = c * a[p, k] - s * a[q, k], s * a[p, k] + c * a[q, k]
    for k in range(n):
        vectors[k, p], vectors[k, q] = c * vectors[k, p] - s * vectors[k, q], s * vectors[k, p] + c * vectors[k, q]


@lean_kernel
def multiply(a: Floats, b: Floats, out: Floats) -> None:
    """Fill out (n, m) with a (n, k) b (k, m); out is neither of them."""
    for i in range(a.shape[0]):
        for j in range(b.shape[1]):
            total = 0.0
            for k in range(b.shape[0]):
                total += a[i, k] * b[k, j]
            out[i, j] = total


@lean_kernel
def product_of(a: Floats, b: Floats) -> float:
    """Scalar product of vectors (n,)."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@lean_kernel
def carried(a: Floats, matrix: Floats, b: Floats) -> float:
    """a^T matrix b of vectors (n,)."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * product_of(matrix[i], b)
    return total


@lean_kernel
def cholesky(a: Floats, root: Floats, n: int) -> None:
    """Fill the lower half of root (n, n) with the Cholesky factor of a positive matrix a (n, n); the rest is 0."""
    for i in range(n):
        for j in range(n):
            root[i, j] = 0.0
        for j in range(i + 1):
            left = a[i, j]
            for k in range(j):
                left -= root[i, k] * root[j, k]
            root[i, j] = np.sqrt(max(left, 0.0)) if i == j else left / root[j, j]


@lean_kernel
def count_true(flags: Bools) -> int:
    """Number of flags (n,) that are set."""
    count = 0
    for flag in flags:
        count += 1 if flag else 0
    return count
