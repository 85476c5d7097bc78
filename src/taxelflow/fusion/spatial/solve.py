"""Weighted least squares of six degrees of freedom from contacts, and the directions that they do not determine.

A contact measures y = H xi + G q + n of three planar components: along its x and y, about its z. H: (3, 6), y: (3,),
information W: (3, 3), zero where a component is unknown. q: errors of the joint angles, of known variance, eliminated
by a Schur complement. Rotations are scaled by a length, so that all components of xi are in m or m/s. A direction is
observable where its standard deviation is below a limit; the others are eigenvectors of the information.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taxelflow.fusion.observability import BLIND
from taxelflow.messages import Floats
from taxelflow.numerics.se3 import eigen_symmetric
from taxelflow.numerics.small_linalg import copy_matrix, factor_small, mirror, solve_factored
from taxelflow.runtime.compiling import lean_kernel, routine


class Contacts(NamedTuple):
    """rows: (pads, 3, 6), scaled. y: (pads, 3). W: (pads, 3, 3). G: (pads, 3, joints). sure: (joints,), information on
    the joints' errors. use: (pads,), 1 where the contact counts, 0 where it is unknown, -1 where it is blamed.
    """

    rows: Floats
    y: Floats
    W: Floats
    G: Floats
    sure: Floats
    use: Floats


class Solution(NamedTuple):
    """xi: (6,), covariance: (6, 6), scaled. values: (6,), vectors: (6, 6), eigenvalues of the information and its
    eigenvectors in columns; where all directions are observed, values are infinite and vectors are not filled in.
    residual: (pads, 3), what is left of each contact; chi2: (pads,), of it. joints: (joints,), errors of their angles.

    Work: normal (6, 6), right (6,), D (joints, joints), crossed (6, joints), column (joints,).
    """

    xi: Floats
    covariance: Floats
    values: Floats
    vectors: Floats
    residual: Floats
    chi2: Floats
    joints: Floats
    normal: Floats
    right: Floats
    D: Floats
    crossed: Floats
    column: Floats


@routine
def room(pads: int, joints: int) -> Solution:
    """Arrays for `solve`."""
    return Solution(
        np.zeros(6),
        np.zeros((6, 6)),
        np.zeros(6),
        np.zeros((6, 6)),
        np.zeros((pads, 3)),
        np.zeros(pads),
        np.zeros(joints),
        np.zeros((6, 6)),
        np.zeros(6),
        np.zeros((joints, joints)),
        np.zeros((6, joints)),
        np.zeros(joints),
    )


@routine
def solve(contacts: Contacts, limit: float, out: Solution) -> int:
    """Fill the solution; its rank. Directions whose standard deviation exceeds `limit` are 0, with that of `BLIND`."""
    out.normal[:] = 0.0
    out.right[:] = 0.0
    out.joints[:] = 0.0
    out.crossed[:] = 0.0
    out.D[:] = 0.0
    for pad in range(len(contacts.use)):
        if contacts.use[pad] > 0.0:
            add_contact(contacts, pad, out)
    eliminate_joints(contacts.sure, out)
    if all_observed(limit, out):
        solve_whole(out)
        find_residuals(contacts, out)
        return 6
    eigen_symmetric(out.normal, out.values, out.vectors, 6)
    rank = 0
    out.xi[:] = 0.0
    out.covariance[:] = 0.0
    for d in range(6):
        seen = out.values[d] * limit * limit > 1.0
        variance, along = (BLIND.far * limit) ** 2, 0.0
        if seen:
            rank += 1
            variance = 1.0 / out.values[d]
            for i in range(6):
                along += variance * out.vectors[i, d] * out.right[i]
        for i in range(6):
            out.xi[i] += along * out.vectors[i, d]
            for j in range(6):
                out.covariance[i, j] += variance * out.vectors[i, d] * out.vectors[j, d]
    find_residuals(contacts, out)
    return rank


@lean_kernel
def all_observed(limit: float, out: Solution) -> bool:
    """Whether all standard deviations are below the limit: the information less 1 / limit^2 is positive."""
    copy_matrix(out.normal, out.covariance)
    for i in range(6):
        out.covariance[i, i] -= 1.0 / (limit * limit)
    return factor_small(out.covariance, 6)


@routine
def judge_covariance(out: Solution, limit: float) -> int:
    """Decide by the covariance which directions are observable, where it has grown: values, vectors and rank."""
    for i in range(6):
        for j in range(6):
            out.normal[i, j] = -out.covariance[i, j]
        out.normal[i, i] += limit * limit
    if factor_small(out.normal, 6):
        return 6
    copy_matrix(out.covariance, out.normal)
    eigen_symmetric(out.normal, out.values, out.vectors, 6)
    rank = 0
    for d in range(6):
        out.values[d] = 1.0 / out.values[d]
        rank += out.values[d] * limit * limit > 1.0
    return rank


@lean_kernel
def solve_whole(out: Solution) -> None:
    """Fill xi and its covariance where all directions are observed: a twentieth of the work of eigenvectors."""
    factor_small(out.normal, 6)
    for i in range(6):
        out.xi[i] = out.right[i]
    solve_factored(out.normal, out.xi, 6)
    for j in range(6):
        for i in range(6):
            out.covariance[j, i] = 1.0 if i == j else 0.0
        solve_factored(out.normal, out.covariance[j], 6)
        out.values[j] = np.inf
    mirror(out.covariance)


@lean_kernel
def add_contact(contacts: Contacts, pad: int, out: Solution) -> None:
    """Add one contact to the normal equations of xi and of the joints' errors."""
    W, H, G = contacts.W[pad], contacts.rows[pad], contacts.G[pad]
    add_product(H, W, H, out.normal)
    add_product(H, W, G, out.crossed)
    add_product(G, W, G, out.D)
    y = contacts.y[pad]
    for a in range(3):
        weighted = W[a, 0] * y[0] + W[a, 1] * y[1] + W[a, 2] * y[2]
        for i in range(6):
            out.right[i] += H[a, i] * weighted
        for j in range(len(out.joints)):
            out.joints[j] += G[a, j] * weighted


@lean_kernel
def add_product(A: Floats, W: Floats, B: Floats, total: Floats) -> None:
    """Add A^T W B to total (n, m), of A (3, n), W (3, 3) and B (3, m)."""
    for j in range(B.shape[1]):
        x = W[0, 0] * B[0, j] + W[0, 1] * B[1, j] + W[0, 2] * B[2, j]
        y = W[1, 0] * B[0, j] + W[1, 1] * B[1, j] + W[1, 2] * B[2, j]
        z = W[2, 0] * B[0, j] + W[2, 1] * B[1, j] + W[2, 2] * B[2, j]
        for i in range(A.shape[1]):
            total[i, j] += A[0, i] * x + A[1, i] * y + A[2, i] * z


@lean_kernel
def eliminate_joints(sure: Floats, out: Solution) -> None:
    """Schur complement of the joints' errors; their D becomes its factor."""
    joints = len(sure)
    if joints == 0:
        return
    for j in range(joints):
        out.D[j, j] += sure[j]
    factor_small(out.D, joints)
    for j in range(joints):
        out.column[j] = out.joints[j]
    solve_factored(out.D, out.column, joints)
    for i in range(6):
        for j in range(joints):
            out.right[i] -= out.crossed[i, j] * out.column[j]
    for k in range(6):
        for j in range(joints):
            out.column[j] = out.crossed[k, j]
        solve_factored(out.D, out.column, joints)
        for i in range(6):
            for j in range(joints):
                out.normal[i, k] -= out.crossed[i, j] * out.column[j]


@routine
def find_residuals(contacts: Contacts, out: Solution) -> None:
    """Fill chi2 of every contact, used or not, and the joints' errors."""
    joints = len(out.joints)
    if joints:
        for j in range(joints):
            for i in range(6):
                out.joints[j] -= out.crossed[i, j] * out.xi[i]
        solve_factored(out.D, out.joints, joints)
    for pad in range(len(contacts.use)):
        left = out.residual[pad]
        for a in range(3):
            left[a] = contacts.y[pad, a]
            for i in range(6):
                left[a] -= contacts.rows[pad, a, i] * out.xi[i]
            for j in range(joints):
                left[a] -= contacts.G[pad, a, j] * out.joints[j]
        chi2 = 0.0
        for a in range(3):
            for b in range(3):
                chi2 += left[a] * contacts.W[pad, a, b] * left[b]
        out.chi2[pad] = chi2
