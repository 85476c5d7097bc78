"""The object's pose in space since first contact: a robust fit of all contacts to where they lie on the object.

A contact is anchored on the object in its first scan. Later scans measure the position of that point, along the pad and
about its normal. A later contact inherits the error that the pose has by then. These errors are common to all contacts
of that time, so they are propagated through the fit and do not average out. Motion along a direction that no contact
has shown yet, as with one finger, counts from the time when contacts show it. While nothing touches, all anchors are
cleared.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from taxelflow.fusion.reference import UNOBSERVABLE_M
from taxelflow.fusion.spatial.robust import Verdict, solve_robustly
from taxelflow.fusion.spatial.solve import Contacts, Solution
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
from taxelflow.numerics.rounding import LEAST_VARIANCE_M2, NEGLIGIBLE
from taxelflow.numerics.se3 import carried, cholesky, compose, exponential, invert, multiply, planar_rows
from taxelflow.numerics.small_linalg import copy_matrix
from taxelflow.runtime.compiling import routine

_SMALLEST_STEP = 1e-7
"""In m and rad, at which the fit has converged: the next step would be a thousandth of it, or less."""
_SHARPER = 0.1
"""Variance of a contact's place, over that of its anchor, below which it is anchored again: the first scans of a
contact are often not resolved, and an anchor there would add its error to all later scans."""


class Anchor:
    """Place of a contact on the object. frame: (4, 4), of the contact in the object's frame, turned by its theta.
    covariance: (3, 3), of the pose when it was anchored. root: (6, 6), a factor of the covariance of the object's pose
    at that time, in the object's frame; 0 in the first scan.
    """

    anchored: bool
    turns: bool
    frame: Annotated[Floats, 4, 4]
    covariance: Annotated[Floats, 3, 3]
    root: Annotated[Floats, 6, 6]


class Body:
    """The object's pose (4, 4) in the hand; started: whether something touches. most: the most directions that were
    observable since then.
    """

    started: bool
    most: int
    pose: Annotated[Floats, 4, 4]


@routine
def start_body(body: Body, anchors: Records) -> None:
    """Reset: the object's present pose is the origin of its motion."""
    body.started, body.most = False, 0
    for i in range(4):
        for j in range(4):
            body.pose[i, j] = 1.0 if i == j else 0.0
    for pad in range(len(anchors)):
        anchors[pad].anchored = False


@routine
def pose_centre(seen: Seen, scan: int, anchors: Records) -> Floats:
    """(3,): mean place of the anchored contacts. With those that only begin, blind directions would turn about another
    point than in the scan before, and the pose would jump along them.
    """
    anchored = seen.known[scan].copy()
    for pad in range(len(anchors)):
        anchored[pad] = anchored[pad] and anchors[pad].anchored
    return centre_of(seen.frames[scan], anchored)


@routine
def fit_pose(
    seen: Seen,
    scan: int,
    centre: Floats,
    doubts: tuple[Floats, float, float],
    limits: Limits,
    contacts: Contacts,
    solution: Solution,
    anchors: Records,
    body: Body,
) -> Verdict:
    """Move the body to where its anchored contacts are; the solution holds its covariance, scaled, at the centre.

    centre: (3,), see `pose_centre`. doubts: derivatives of the pads' places by the joints (pads, 6, joints), standard
    deviation of a joint's angle, and `usual_misfit`.
    """
    J, joint_std, usual = doubts
    step = np.zeros(6)
    verdict = Verdict(0, 0.0, 0.0, False, 0)
    for _ in range(4):  # steps of Gauss-Newton
        linearise(seen, scan, centre, limits, contacts, anchors, body)
        fill_joints(J, joint_std, centre, limits.length_m, contacts)
        doubt_all(contacts, usual)
        # The pose has improved: which contacts disagree with it is decided again.
        verdict = solve_robustly(contacts, limits.pose_m, usual, solution)
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
        for a in range(3):
            for b in range(3):
                covariance[a, b] += anchor.covariance[a, b]
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
def place_covariance(seen: Seen, scan: int, pad: int, covariance: Floats) -> None:
    """Fill covariance (3, 3) of a contact's pose, with what its pattern does not show."""
    copy_matrix(seen.covariance[scan, pad], covariance)
    for a in range(2):
        for b in range(2):
            covariance[a, b] += UNOBSERVABLE_M**2 * seen.unobservable[scan, pad, a, b]


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
def set_anchors(
    seen: Seen, scan: int, covariance: Floats, inherited: Floats, use: Floats, anchors: Records, body: Body
) -> None:
    """Anchor the contacts that are new, and those that are far better known than when they were anchored.

    covariance: (6, 6), of the body's pose, from the left, at the hand's origin; inherited: (6, 6), what of it stays,
    see `inheritance.keep_shown`. use: see `Contacts`; who is blamed keeps its anchor.
    """
    together = come_to_blind(seen, scan, covariance, anchors)
    inverse, turn, turned_frame = np.empty((4, 4)), np.zeros((4, 4)), np.empty((4, 4))
    invert(body.pose, inverse)
    root, own = np.zeros((6, 6)), np.empty((3, 3))
    rooted = False
    for pad in range(len(anchors)):
        anchor: Anchor = anchors[pad]
        if not seen.known[scan, pad]:
            anchor.anchored = anchor.anchored and seen.held[scan, pad]
            continue
        place_covariance(seen, scan, pad, own)
        own[0, 0] += seen.doubt[scan, pad]
        own[1, 1] += seen.doubt[scan, pad]
        was = anchor.covariance
        sharper = own[0, 0] + own[1, 1] < _SHARPER * (was[0, 0] + was[1, 1]) and use[pad] > 0.0
        if sharper or (together and use[pad] >= 0.0) or not anchor.anchored:
            if body.started and not rooted:
                factor_in_body(inherited, inverse, root)
                rooted = True
            theta = seen.theta[scan, pad]
            anchor.turns = np.isfinite(theta)
            angle = theta if anchor.turns else 0.0
            turn[0, 0] = turn[1, 1] = np.cos(angle)
            turn[1, 0], turn[0, 1] = np.sin(angle), -np.sin(angle)
            turn[2, 2] = turn[3, 3] = 1.0
            compose(seen.frames[scan, pad], turn, turned_frame)
            compose(inverse, turned_frame, anchor.frame)
            copy_matrix(own, anchor.covariance)
            copy_matrix(root, anchor.root)
            anchor.anchored = True
    body.started = True


@routine
def come_to_blind(seen: Seen, scan: int, covariance: Floats, anchors: Records) -> bool:
    """Whether contacts come to a pose that is known far worse there than their place. All contacts are then anchored
    again, together: the pose's error is common to them, and does not contradict any. Anchored one by one, as fingers
    close, those that came first would hold the new ones to motions that nothing has seen.
    """
    rows, own, origin = np.zeros((3, 6)), np.empty((3, 3)), np.zeros(3)
    for pad in range(len(anchors)):
        if seen.known[scan, pad] and not anchors[pad].anchored:
            planar_rows(seen.frames[scan, pad], origin, rows)
            place_covariance(seen, scan, pad, own)
            of_pose = carried(rows[0], covariance, rows[0]) + carried(rows[1], covariance, rows[1])
            if own[0, 0] + own[1, 1] < _SHARPER * of_pose:
                return True
    return False


@routine
def factor_in_body(covariance: Floats, inverse: Floats, root: Floats) -> None:
    """Fill root (6, 6), a factor of a covariance (6, 6) taken to the object's frame by the inverse of its pose."""
    A = np.zeros((6, 6))
    for i in range(3):
        n, m = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            A[i, j] = A[3 + i, 3 + j] = inverse[i, j]
            A[i, 3 + j] = inverse[n, 3] * inverse[m, j] - inverse[m, 3] * inverse[n, j]
    half, own = np.empty((6, 6)), np.empty((6, 6))
    multiply(A, covariance, half)
    multiply(half, A.T, own)
    for i in range(6):
        own[i, i] += LEAST_VARIANCE_M2 + NEGLIGIBLE * own[i, i]
    cholesky(own, root, 6)
