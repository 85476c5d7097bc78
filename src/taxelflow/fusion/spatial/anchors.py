"""Where contacts lie on the object: anchors, set when contacts come, which follow what later scans show.

The place of a contact on the object is a constant that nobody knows, and a pad's error that stays is part of it. An
anchor is the mean of the places that a contact had on the object, weighted by information::

    a <- a + g r,   A <- (1 - g)^2 A + g^2 C,   g = w / sum of w,   w = 1 / (Cxx + Cyy)

of a contact that the fit of the pose leaves r of, with the covariance C of its own pose. Residuals of a fit contain no
motion of the object, so that anchors learn from the other pads, and the pose stays where it is.

What they cannot learn is an error that all have in common: of the scan in which the first ones were set, and of the
pose when others came. It does not average out; its root is kept with each anchor.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from taxelflow.fusion.reference import UNOBSERVABLE_M
from taxelflow.fusion.spatial.solve import Contacts, Solution, solve
from taxelflow.fusion.spatial.twist import Limits, centre_of, fill_information, fill_rows, fill_shift
from taxelflow.fusion.spatial.window import Seen, put_under
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.records import Records
from taxelflow.numerics.se3 import carried, cholesky, compose, copy_matrix, invert, multiply, planar_rows
from taxelflow.runtime.compiling import routine

_BLIND = 10.0
"""Variance of the pose at a new contact, over that of the contact's place, from which on it knows far less."""
_LEAST_M2 = 1e-18
"""Added to variances that may be 0: a nanometre, squared."""


class Anchor:
    """Where on the object a contact lies. frame: (4, 4), of the contact in the object's frame, turned by its theta.
    covariance: (3, 3), of that. weight: sum of w, 1/m^2. root: (6, 6), a factor of the covariance, in the object's
    frame, of the error that it has in common with anchors of the same since_s, the time when it was set.
    """

    anchored: bool
    turns: bool
    frame: Annotated[Floats, 4, 4]
    covariance: Annotated[Floats, 3, 3]
    weight: float
    root: Annotated[Floats, 6, 6]
    since_s: float


class Body:
    """The object's pose (4, 4) in the hand; started: whether something touches."""

    started: bool
    pose: Annotated[Floats, 4, 4]


@routine
def start_body(body: Body, anchors: Records) -> None:
    """The object where it is now is the origin of its motion."""
    body.started = False
    for i in range(4):
        for j in range(4):
            body.pose[i, j] = 1.0 if i == j else 0.0
    for pad in range(len(anchors)):
        anchors[pad].anchored = False


@routine
def place_covariance(seen: Seen, scan: int, pad: int, covariance: Floats) -> None:
    """Fill covariance (3, 3) of a contact's pose, with what its pattern does not show."""
    copy_matrix(seen.covariance[scan, pad], covariance)
    for a in range(2):
        for b in range(2):
            covariance[a, b] += UNOBSERVABLE_M**2 * seen.unobservable[scan, pad, a, b]


@routine
def anchor_covariance(seen: Seen, scan: int, pad: int, covariance: Floats) -> None:
    """Fill covariance (3, 3) of a contact that is anchored in a scan."""
    place_covariance(seen, scan, pad, covariance)
    covariance[0, 0] += seen.doubt[scan, pad]
    covariance[1, 1] += seen.doubt[scan, pad]


@routine
def set_anchors(
    seen: Seen,
    scan: int,
    covariance: Floats,
    limits: Limits,
    contacts: Contacts,
    solution: Solution,
    anchors: Records,
    body: Body,
) -> None:
    """Anchor the contacts that are new. covariance: (6, 6), of the body's pose, from the left, at the hand's origin.
    A contact that is blamed keeps its anchor.
    """
    if not some_are_new(seen, scan, anchors):
        return
    together = come_to_blind(seen, scan, covariance, anchors)
    alone = together or not any_anchored(seen.known[scan], anchors)
    inverse, turn, turned_frame = np.empty((4, 4)), np.zeros((4, 4)), np.empty((4, 4))
    invert(body.pose, inverse)
    root, blamed = np.zeros((6, 6)), contacts.use < 0.0
    common = covariance.copy()
    if alone:
        add_of_first(seen, scan, limits, contacts, solution, common)
    factor_in_body(common, inverse, root)
    for pad in range(len(anchors)):
        anchor: Anchor = anchors[pad]
        if not seen.known[scan, pad] or (anchor.anchored and (blamed[pad] or not together)):
            continue
        theta = seen.theta[scan, pad]
        anchor.turns = np.isfinite(theta)
        angle = theta if anchor.turns else 0.0
        turn[0, 0] = turn[1, 1] = np.cos(angle)
        turn[1, 0], turn[0, 1] = np.sin(angle), -np.sin(angle)
        turn[2, 2] = turn[3, 3] = 1.0
        compose(seen.frames[scan, pad], turn, turned_frame)
        compose(inverse, turned_frame, anchor.frame)
        own = anchor.covariance
        anchor_covariance(seen, scan, pad, own)
        anchor.weight = 1.0 / (own[0, 0] + own[1, 1] + _LEAST_M2)
        copy_matrix(root, anchor.root)
        anchor.since_s, anchor.anchored = seen.t_s[scan], True
    body.started = True


@routine
def some_are_new(seen: Seen, scan: int, anchors: Records) -> bool:
    """Whether any contact whose pose is known has no anchor; those that are gone lose theirs."""
    new = False
    for pad in range(len(anchors)):
        anchor: Anchor = anchors[pad]
        anchor.anchored = anchor.anchored and (seen.known[scan, pad] or seen.held[scan, pad])
        new = new or (seen.known[scan, pad] and not anchor.anchored)
    return new


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
            if _BLIND * (own[0, 0] + own[1, 1]) < of_pose:
                return True
    return False


@routine
def follow(seen: Seen, scan: int, contacts: Contacts, solution: Solution, anchors: Records, body: Body) -> None:
    """Move the anchors by their share of what the fit has left of their contacts; those blamed stay, and those that do
    not see a direction, where what is left means nothing.
    """
    own = np.empty((3, 3))
    for pad in range(len(anchors)):
        unobservable = seen.unobservable[scan, pad]
        if not contacts.use[pad] > 0.0 or unobservable[0, 0] + unobservable[1, 1] > 0.0:
            continue
        anchor: Anchor = anchors[pad]
        copy_matrix(seen.covariance[scan, pad], own)
        weight = 1.0 / (own[0, 0] + own[1, 1] + _LEAST_M2)
        anchor.weight += weight
        share = weight / anchor.weight
        turns = anchor.turns and np.isfinite(seen.theta[scan, pad])
        left, axes = solution.residual[pad], 3 if turns else 2
        shift_frame(share * left[0], share * left[1], seen.frames[scan, pad], body.pose, anchor.frame)
        if turns:
            turn_frame(share * left[2], anchor.frame)
        for a in range(axes):
            for b in range(axes):
                kept = (1.0 - share) * (1.0 - share) * anchor.covariance[a, b]
                anchor.covariance[a, b] = kept + share * share * own[a, b]


@routine
def shift_frame(x: float, y: float, K: Floats, pose: Floats, frame: Floats) -> None:
    """Shift a frame (4, 4) of the object along the axes of a contact K (4, 4) in the hand."""
    for i in range(3):
        by = K[i, 0] * x + K[i, 1] * y
        for j in range(3):
            frame[j, 3] += pose[i, j] * by


@routine
def turn_frame(angle: float, frame: Floats) -> None:
    """Turn a frame (4, 4) about its z axis."""
    cos, sin = np.cos(angle), np.sin(angle)
    for i in range(3):
        x, y = frame[i, 0], frame[i, 1]
        frame[i, 0], frame[i, 1] = cos * x + sin * y, cos * y - sin * x


@routine
def any_anchored(known: Bools, anchors: Records) -> bool:
    """Whether any contact whose pose is known (pads,) has an anchor, by which new ones can be judged."""
    found = False
    for pad in range(len(anchors)):
        found = found or (known[pad] and anchors[pad].anchored)
    return found


@routine
def add_of_first(
    seen: Seen, scan: int, limits: Limits, contacts: Contacts, solution: Solution, covariance: Floats
) -> None:
    """Add to covariance (6, 6), at the hand's origin, that of the motion that errors of the contacts look like, which
    are anchored without any other; what none of them observes is none.
    """
    frames, own, A = seen.frames[scan].copy(), np.empty((3, 3)), np.zeros((6, 6))
    for pad in range(len(frames)):
        contacts.use[pad] = 1.0 if seen.known[scan, pad] else 0.0
        contacts.y[pad], contacts.G[pad] = 0.0, 0.0
        anchor_covariance(seen, scan, pad, own)
        fill_information(own, seen.known[scan, pad], contacts.W[pad])
        point = put_under(frames[pad], seen.under[scan, pad])
        for i in range(3):
            frames[pad, i, 3] = point[i]
    contacts.sure[:] = 1.0
    centre = centre_of(frames, seen.known[scan])
    fill_rows(frames, centre, limits.length_m, contacts.rows)
    solve(contacts, limits.pose_m, solution)
    keep_observed(solution, limits.pose_m)
    fill_shift(centre, limits.length_m, A)
    for i in range(6):
        for j in range(6):
            covariance[i, j] += carried(A[i], solution.covariance, A[j])


@routine
def keep_observed(solution: Solution, limit: float) -> None:
    """Take the directions that are not observed out of a solution's covariance."""
    if not np.isfinite(solution.values[0]):
        return
    variance = np.zeros(6)
    for d in range(6):
        variance[d] = 1.0 / solution.values[d] if solution.values[d] * limit**2 > 1.0 else 0.0
    for i in range(6):
        for j in range(6):
            solution.covariance[i, j] = 0.0
            for d in range(6):
                solution.covariance[i, j] += variance[d] * solution.vectors[i, d] * solution.vectors[j, d]


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
        own[i, i] += _LEAST_M2
    cholesky(own, root, 6)
