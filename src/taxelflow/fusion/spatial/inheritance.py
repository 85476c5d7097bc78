"""What contacts inherit of the error of the object's pose at the time when they were anchored."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.fusion.spatial.robust import Verdict
from taxelflow.fusion.spatial.solve import Contacts, Solution, add_product, judge_covariance
from taxelflow.fusion.spatial.twist import Limits, to_origin
from taxelflow.numerics.se3 import carried, multiply
from taxelflow.numerics.small_linalg import solve_factored
from taxelflow.runtime.compiling import routine

if TYPE_CHECKING:
    from taxelflow.fusion.spatial.pose import Body
    from taxelflow.messages import Floats
    from taxelflow.numerics.records import Records


@routine
def inherit(
    contacts: Contacts,
    solution: Solution,
    centre: Floats,
    limits: Limits,
    verdict: Verdict,
    anchors: Records,
    body: Body,
) -> Verdict:
    """Add to the solution's covariance what the anchors inherited: errors of the pose when they were set, in common.

    The verdict with the rank that is left: a direction in which the pose was not known then is not known now.
    """
    old = False
    for pad in range(len(anchors)):
        old = old or (contacts.use[pad] > 0.0 and anchors[pad].root[0, 0] > 0.0)
    if not old:
        return verdict
    total = np.zeros((6, 6))
    A = np.zeros((6, 6))
    for i in range(3):  # from the object's frame to the hand's axes at the centre, scaled
        n, m = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            A[i, j] = body.pose[i, j]
            A[3 + i, 3 + j] = limits.length_m * body.pose[i, j]
            A[i, 3 + j] = (body.pose[n, 3] - centre[n]) * body.pose[m, j] - (body.pose[m, 3] - centre[m]) * body.pose[
                n, j
            ]
    error, projected, weighted = np.zeros((6, 6)), np.zeros((3, 6)), np.zeros((6, 6))
    by_joints = np.zeros((len(contacts.sure), 6))
    for pad in range(len(anchors)):
        if contacts.use[pad] > 0.0 and anchors[pad].root[0, 0] > 0.0:
            multiply(A, anchors[pad].root, error)
            multiply(contacts.rows[pad], error, projected)
            add_product(contacts.rows[pad], contacts.W[pad], projected, weighted)
            add_product(contacts.G[pad], contacts.W[pad], projected, by_joints)
    without_joints(by_joints, solution, weighted)
    solve_observed(solution, weighted, limits.pose_m, error)
    multiply(error, error.T, total)
    for i in range(6):
        for j in range(6):
            solution.covariance[i, j] += total[i, j]
    rank = judge_covariance(solution, limits.pose_m)
    return Verdict(rank, verdict.chi2, verdict.freedom, verdict.contradicted, verdict.blamed)


@routine
def without_joints(by_joints: Floats, solution: Solution, weighted: Floats) -> None:
    """Take from weighted (6, 6) what errors of the joints explain of it, as the solution does. by_joints: (joints, 6),
    the same of the joints' equations.
    """
    joints, column = len(by_joints), solution.column
    for k in range(6):
        for j in range(joints):
            column[j] = by_joints[j, k]
        if joints:
            solve_factored(solution.D, column, joints)
        for i in range(6):
            for j in range(joints):
                weighted[i, k] -= solution.crossed[i, j] * column[j]


@routine
def solve_observed(solution: Solution, weighted: Floats, limit: float, error: Floats) -> None:
    """Fill error (6, 6) with the inverse information on the observed directions times weighted (6, 6)."""
    if not np.isfinite(solution.values[0]):
        multiply(solution.covariance, weighted, error)
        return
    along = np.zeros((6, 6))
    multiply(solution.vectors.T, weighted, along)
    for d in range(6):
        seen = solution.values[d] * limit**2 > 1.0
        for j in range(6):
            along[d, j] = along[d, j] / solution.values[d] if seen else 0.0
    multiply(solution.vectors, along, error)


@routine
def keep_shown(
    solution: Solution, rank: int, centre: Floats, limits: Limits, factor: float, body: Body, inherited: Floats
) -> None:
    """Fill inherited (6, 6), which holds the pose's covariance at the hand's origin, with what later contacts inherit.

    A direction that was never observable since the first touch is left out. One that was, and is no longer, stays in:
    how far the object has moved along it since is not known. factor: by which `widen` has multiplied it.
    """
    if rank < 6 and rank >= body.most:
        shown, root = np.zeros((6, 6)), np.zeros((6, 6))
        for d in range(6):
            direction, std = solution.vectors[:, d], 0.0
            if solution.values[d] * limits.pose_m**2 > 1.0:
                std = np.sqrt(factor * carried(direction, solution.covariance, direction))
            for i in range(6):
                shown[i, d] = std * direction[i]
        multiply(to_origin(centre, limits.length_m), shown, root)
        multiply(root, root.T, inherited)
    body.most = max(body.most, rank)
