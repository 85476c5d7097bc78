"""How far the object has moved and turned since first contact: a rigid fit of all contacts, scan by scan."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.fusion.twist import Row, add_point, solve_rigid, solve_translation, turn_is_observable
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.records import Records, Vector
from taxelflow.numerics.se2 import rotate, rotate_back
from taxelflow.numerics.small_linalg import inverse2

_ITERATIONS = 4
_SMALLEST_STEP = 1e-12
"""In m and rad: rounding."""
_LEAST_VARIANCE_M2 = 1e-18
"""Added to the variance of a place, which may be 0: a nanometre, squared."""
_OWN_TURN_WEIGHT = 0.5
"""Of a pad's own theta: the variance of the one at which it was anchored counts, too, and is about the same."""


class Anchor:
    """Where on the object a pad's contact lies; theta: the pad's own, less the object's, when it was anchored."""

    anchored: bool
    x: float
    y: float
    theta: float
    covariance: Annotated[Floats, 2, 2]


class Body:
    """Pose of the object since first contact, and its covariance; all 0 until something touches."""

    pose: Vector
    covariance: Annotated[Floats, 3, 3]


@kernel
def follow_pose(
    place: Floats,
    place_cov: Floats,
    own_turn: Floats,
    touching: Bools,
    any_contact: Bools,
    turns: bool,
    anchors: Records,
    bodies: Records,
    rows: Records,
) -> None:
    """Fill the pose of rows (scans,) of `Row`, which come in as NaN.

    place: (scans, pads, 2) in the hand. place_cov: (scans, pads, 2, 2). own_turn: (scans, pads, 2), the pad's theta and
    its variance, NaN where the method has none. touching: (scans, pads), the place is known. any_contact: (scans,).
    anchors: (pads,) of `Anchor` and bodies: (1,) of `Body` are kept from scan to scan.
    A contact is anchored on the object where it first lies there; while nothing touches everything is forgotten.
    """
    body: Body = bodies[0]
    for scan in range(place.shape[0]):
        if not any_contact[scan]:
            forget(anchors, body)
            continue
        observable = fit_pose(place[scan], place_cov[scan], own_turn[scan], touching[scan], turns, anchors, body)
        for pad in range(place.shape[1]):
            anchor: Anchor = anchors[pad]
            if touching[scan, pad] and not anchor.anchored:
                set_anchor(place[scan, pad], place_cov[scan, pad], own_turn[scan, pad, 0], anchor, body)
            anchor.anchored = touching[scan, pad]
        row: Row = rows[scan]
        at_start = body.pose[2] == 0.0 and body.covariance[2, 2] == 0.0
        write_pose(body, observable or at_start, row.pose, row.pose_covariance)


@kernel
def forget(anchors: Records, body: Body) -> None:
    """The next contact begins at pose 0."""
    for pad in range(len(anchors)):
        anchors[pad].anchored = False
    for a in range(3):
        body.pose[a] = 0.0
        for b in range(3):
            body.covariance[a, b] = 0.0


@kernel
def fit_pose(
    place: Floats, place_cov: Floats, own_turn: Floats, touching: Bools, turns: bool, anchors: Records, body: Body
) -> bool:
    """Gauss-Newton for the object's pose from all anchored contacts; whether its turn is observable."""
    observable = False
    for _ in range(_ITERATIONS):
        normal, right, step = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
        count = 0
        for pad in range(len(place)):
            anchor: Anchor = anchors[pad]
            if touching[pad] and anchor.anchored:
                count += 1
                add_contact(normal, right, place[pad], place_cov[pad], own_turn[pad], anchor, body)
        if count == 0:
            return False
        observable = turns and turn_is_observable(normal)
        if observable:
            solve_rigid(normal, right, step, body.covariance)
        else:
            solve_translation(normal, right, step, body.covariance)
            if body.covariance[2, 2] == 0.0:
                body.covariance[2, 2] = np.inf
        for a in range(3):
            body.pose[a] += step[a]
        if max(abs(step[0]), abs(step[1]), abs(step[2])) < _SMALLEST_STEP:
            break
    return observable


@kernel
def add_contact(
    normal: Floats, right: Floats, place: Floats, place_cov: Floats, own_turn: Floats, anchor: Anchor, body: Body
) -> None:
    """Add an anchored contact at a place (2,) to the normal equations of a step of the pose."""
    cov, w = np.empty((2, 2)), np.empty((2, 2))
    for a in range(2):
        for b in range(2):
            cov[a, b] = place_cov[a, b] + anchor.covariance[a, b]
    inverse2(cov, _LEAST_VARIANCE_M2, w)
    x, y = rotate(np.cos(body.pose[2]), np.sin(body.pose[2]), anchor.x, anchor.y)
    add_point(normal, right, w, x, y, place[0] - x - body.pose[0], place[1] - y - body.pose[1])
    if own_turn[1] > 0.0 and np.isfinite(anchor.theta):
        weight = _OWN_TURN_WEIGHT / own_turn[1]
        normal[2, 2] += weight
        right[2] += weight * (own_turn[0] - anchor.theta - body.pose[2])


@kernel
def set_anchor(place: Floats, place_cov: Floats, theta: float, anchor: Anchor, body: Body) -> None:
    """Note where on the object a new contact lies, given where the object is now."""
    cos, sin = np.cos(body.pose[2]), np.sin(body.pose[2])
    anchor.x, anchor.y = rotate_back(cos, sin, place[0] - body.pose[0], place[1] - body.pose[1])
    anchor.theta = theta - body.pose[2]
    for a in range(2):
        for b in range(2):
            anchor.covariance[a, b] = place_cov[a, b]


@kernel
def write_pose(body: Body, with_turn: bool, pose: Floats, covariance: Floats) -> None:
    """Fill pose (3,) and covariance (3, 3); what belongs to the turn stays NaN without it."""
    axes = 3 if with_turn else 2
    for a in range(axes):
        pose[a] = body.pose[a]
        for b in range(axes):
            covariance[a, b] = body.covariance[a, b]
