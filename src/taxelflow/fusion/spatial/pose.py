"""The object's pose in space since first contact: a robust fit of all contacts to where they lie on the object.

A contact is anchored on the object in its first scan (`anchors`). Later scans measure where that point is, along the
pad and about its normal. Anchors that were set in one scan have an error of the pose in common: such errors are
propagated through the fit and do not average out. While nothing touches, everything is forgotten.
"""

from __future__ import annotations

import numpy as np

from taxelflow.fusion.spatial.anchors import Anchor, Body, place_covariance
from taxelflow.fusion.spatial.robust import Verdict, solve_robustly
from taxelflow.fusion.spatial.solve import Contacts, Solution, add_product
from taxelflow.fusion.spatial.twist import (
    Limits,
    centre_of,
    doubt_all,
    fill_information,
    fill_joints,
    fill_rows,
)
from taxelflow.fusion.spatial.window import Seen, put_under, turned
from taxelflow.messages import Floats
from taxelflow.numerics.records import Records
from taxelflow.numerics.se3 import compose, copy_matrix, exponential, multiply, product_of
from taxelflow.runtime.compiling import routine

_ITERATIONS = 4
"""Steps of Gauss-Newton."""
_SMALLEST_STEP = 1e-7
"""In m and rad: the next would be a thousandth of it, or less."""


@routine
def fit_pose(
    seen: Seen,
    scan: int,
    doubts: tuple[Floats, float, float],
    limits: Limits,
    contacts: Contacts,
    solution: Solution,
    anchors: Records,
    body: Body,
) -> Verdict:
    """Move the body to where its anchored contacts are; the solution holds its covariance, scaled, at `centre_of`.

    doubts: derivatives of the pads' places by the joints (pads, 6, joints), standard deviation of a joint's angle, and
    `usual_misfit`.
    """
    J, joint_std, usual = doubts
    step, centre = np.zeros(6), centre_of(seen.frames[scan], seen.known[scan])
    verdict = Verdict(0, 0.0, 0.0, False, 0)
    for _ in range(_ITERATIONS):
        linearise(seen, scan, centre, limits, contacts, anchors, body)
        fill_joints(J, joint_std, centre, limits.length_m, contacts)
        doubt_all(contacts, usual)
        verdict = solve_robustly(contacts, limits.pose_m, usual, solution)  # blames afresh, the closer the better
        for i in range(3):
            step[i], step[3 + i] = solution.xi[i], solution.xi[3 + i] / limits.length_m
        move_about(centre, step, body.pose)
        largest = 0.0
        for i in range(6):
            largest = max(largest, abs(step[i]))
        if largest < _SMALLEST_STEP:
            break
    return verdict


@routine
def linearise(
    seen: Seen, scan: int, centre: Floats, limits: Limits, contacts: Contacts, anchors: Records, body: Body
) -> None:
    """Fill rows, y and W: how far anchored contacts (points under them) are from where the pose puts them."""
    B, covariance, predicted = np.empty((4, 4)), np.empty((3, 3)), seen.frames[scan].copy()
    for pad in range(len(anchors)):
        anchor: Anchor = anchors[pad]
        counts = anchor.anchored and seen.known[scan, pad]
        contacts.use[pad] = 1.0 if counts else 0.0
        contacts.W[pad] = 0.0
        contacts.y[pad] = 0.0
        if not counts:
            continue
        K = seen.frames[scan, pad]
        compose(body.pose, anchor.frame, B)
        P = put_under(K, seen.under[scan, pad])
        moved = put_under(B, seen.under[scan, pad])
        theta = seen.theta[scan, pad]
        turns = anchor.turns and np.isfinite(theta)
        place_covariance(seen, scan, pad, covariance)
        covariance += anchor.covariance
        if not turns:
            covariance[2, 2] = np.nan
        fill_information(covariance, True, contacts.W[pad])
        for i in range(3):
            contacts.y[pad, 0] += K[i, 0] * (P[i] - moved[i])
            contacts.y[pad, 1] += K[i, 1] * (P[i] - moved[i])
            predicted[pad, i, 3] = moved[i]
        if turns:
            off = theta - turned(K, B)
            contacts.y[pad, 2] = np.arctan2(np.sin(off), np.cos(off))
    fill_rows(predicted, centre, limits.length_m, contacts.rows)


@routine
def move_about(centre: Floats, step: Floats, pose: Floats) -> None:
    """Move a pose (4, 4) by a small motion (6,) whose translation is that of the point at the centre."""
    motion, moved = np.empty((4, 4)), np.empty((4, 4))
    exponential(step, motion)
    for i in range(3):
        motion[i, 3] += centre[i]
        for j in range(3):
            motion[i, 3] -= motion[i, j] * centre[j]
    compose(motion, pose, moved)
    copy_matrix(moved, pose)


@routine
def inherit(
    contacts: Contacts, solution: Solution, centre: Floats, limits: Limits, anchors: Records, body: Body
) -> None:
    """Add to the solution's covariance the errors that anchors have in common since they were set."""
    first, alike = -1, True
    for pad in range(len(anchors)):
        if contacts.use[pad] > 0.0:
            first = pad if first < 0 else first
            alike = alike and anchors[pad].since_s == anchors[first].since_s
    if first < 0:
        return
    A = np.zeros((6, 6))
    for i in range(3):  # from the object's frame to the hand's axes at the centre, scaled
        n, m = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            A[i, j] = body.pose[i, j]
            A[3 + i, 3 + j] = limits.length_m * body.pose[i, j]
            A[i, 3 + j] = (body.pose[n, 3] - centre[n]) * body.pose[m, j] - (body.pose[m, 3] - centre[m]) * body.pose[
                n, j
            ]
    error = np.zeros((6, 6))
    if alike and not np.isfinite(solution.values[0]):  # the object moves as they do
        multiply(A, anchors[first].root, error)
    else:
        share_errors(contacts, solution, A, limits, anchors, error)
    for i in range(6):
        for j in range(6):
            solution.covariance[i, j] += product_of(error[i], error[j])


@routine
def share_errors(
    contacts: Contacts, solution: Solution, A: Floats, limits: Limits, anchors: Records, error: Floats
) -> None:
    """Fill error (6, 6) with what the fit makes of the roots of all anchors, which A (6, 6) takes to its axes."""
    own, projected, weighted = np.zeros((6, 6)), np.zeros((3, 6)), np.zeros((6, 6))
    for pad in range(len(anchors)):
        if contacts.use[pad] > 0.0:
            multiply(A, anchors[pad].root, own)
            multiply(contacts.rows[pad], own, projected)
            add_product(contacts.rows[pad], contacts.W[pad], projected, weighted)
    solve_observed(solution, weighted, limits.pose_m, error)


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
