"""The object's pose since first contact in the plane: a rigid fit of all contacts, scan by scan."""

from __future__ import annotations

import numpy as np

from taxelflow.fusion.anchors import OWN_TURN_WEIGHT, ROBUST, Anchor, Body, residual_of, usual_misfit, weight_of
from taxelflow.fusion.hand_frame import Carried
from taxelflow.fusion.inheritance import factor_pose, inherit
from taxelflow.fusion.misfit import MISFIT
from taxelflow.fusion.twist import (
    Equations,
    Row,
    add_point,
    clear,
    information_on_turn,
    solve_rigid,
    solve_translation,
    turn_is_observable,
)
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.records import Records
from taxelflow.numerics.rounding import LINEAR_RAD, NEGLIGIBLE
from taxelflow.numerics.se2 import rotate, rotate_back
from taxelflow.numerics.se3 import count_true
from taxelflow.numerics.small_linalg import copy_matrix, inverse2
from taxelflow.runtime.compiling import kernel, routine


@kernel
def follow_pose(
    here: Carried,
    place_cov: Floats,
    turns: bool,
    anchors: Records,
    bodies: Records,
    scratch: Records,
    rows: Records,
) -> None:
    """Fill the pose of rows (scans,) of `Row`, which come in as NaN.

    place_cov: (scans, pads, 2, 2). turns: whether places are known at all. anchors: (pads,) of `Anchor` and bodies:
    (1,) of `Body` are kept from scan to scan. scratch: (1,) of `Equations`.
    A contact is anchored on the object where it first lies there, and stays so while it is kept; it is anchored again
    after a gap without a measured motion. It inherits the error of the pose by then. A turn that no contact has shown
    yet, as with one finger, counts from the time when contacts show it. One that was known, and is not for a time, is
    unknown to contacts that are anchored from then on. While nothing touches, all anchors are cleared; no pose is
    known until a contact has a place again.
    Where the contacts contradict each other more than their covariances allow, the pose's covariance is multiplied by
    their reduced chi-square (Birge 1932).
    """
    place, own_turn, placed, kept = here.place, here.own_turn, here.placed, here.kept
    body: Body = bodies[0]
    equations: Equations = scratch[0]
    for scan in range(place.shape[0]):
        if not count_true(kept[scan]) and not count_true(placed[scan]):
            forget(anchors, body)
            continue
        for pad in range(place.shape[1]):
            anchors[pad].anchored = anchors[pad].anchored and kept[scan, pad]
        observable, count = turns, 0
        for iteration in range(ROBUST.iterations):
            robust = iteration >= ROBUST.plain
            clear(equations)
            count = add_contacts(
                (place[scan], place_cov[scan], own_turn[scan], placed[scan]), robust, anchors, body, equations
            )
            if not count:
                observable = False
                break
            observable = turns and turn_is_certain(equations.normal, body)
            if step_pose(observable, body, equations) < NEGLIGIBLE and robust:
                break
        seen = place[scan], place_cov[scan], own_turn[scan], placed[scan]
        inherit(seen, 3 if observable else 2, anchors, body, equations.inherited)
        judge_misfit(place[scan], place_cov[scan], own_turn[scan], placed[scan], observable, anchors, body)
        if count:
            body.turning = observable
            if not observable:
                lose_turn(equations.normal, body)
        factor_pose(body, equations.inherited)
        for pad in range(place.shape[1]):
            anchor: Anchor = anchors[pad]
            if placed[scan, pad] and not anchor.anchored:
                set_anchor(place[scan, pad], place_cov[scan, pad], own_turn[scan, pad, 0], anchor, body)
                copy_matrix(equations.inherited, anchor.root)
            anchor.anchored = anchor.anchored or placed[scan, pad]
            body.placed = body.placed or placed[scan, pad]
        row: Row = rows[scan]
        at_start = body.pose[2] == 0.0 and body.covariance[2, 2] == 0.0
        certain = observable and usual_misfit(body) * body.covariance[2, 2] < LINEAR_RAD**2
        if body.placed:
            write_pose(body, certain or at_start, row.pose, row.pose_covariance)


@routine
def forget(anchors: Records, body: Body) -> None:
    """The next contact begins at pose 0."""
    body.misfit = body.freedom = 0.0
    body.turning = body.placed = False
    for pad in range(len(anchors)):
        anchors[pad].anchored = False
    for a in range(3):
        body.pose[a] = 0.0
        for b in range(3):
            body.covariance[a, b] = 0.0


@routine
def add_contacts(
    seen: tuple[Floats, Floats, Floats, Bools], robust: bool, anchors: Records, body: Body, equations: Equations
) -> int:
    """Add all anchored contacts to the normal equations of a Gauss-Newton step of the object's pose. Returns how many
    there are.

    seen: places, covariances, own turns and whether places are known, of a scan. robust: less of those far off.
    """
    place, place_cov, own_turn, placed = seen
    count = 0
    for pad in range(len(place)):
        anchor: Anchor = anchors[pad]
        if placed[pad] and anchor.anchored:
            count += 1
            add_contact(place[pad], place_cov[pad], own_turn[pad], robust, anchor, body, equations)
    return count


@routine
def turn_is_certain(normal: Floats, body: Body) -> bool:
    """Whether the turn is observable, and certain enough to be linear: else steps do not converge."""
    return turn_is_observable(normal) and usual_misfit(body) < LINEAR_RAD**2 * information_on_turn(normal)


@routine
def step_pose(with_turn: bool, body: Body, equations: Equations) -> float:
    """One Gauss-Newton step; the largest of its components, in m and rad."""
    step = equations.solution
    if with_turn:
        solve_rigid(equations, step, body.covariance)
    else:
        step[2] = 0.0
        solve_translation(equations, step, body.covariance)
        if body.covariance[2, 2] == 0.0:
            body.covariance[2, 2] = np.inf
    for a in range(3):
        body.pose[a] += step[a]
    return float(max(abs(step[0]), abs(step[1]), abs(step[2])))


@routine
def lose_turn(normal: Floats, body: Body) -> None:
    """Note that the object may have turned about its contacts, unseen, and where it then is.

    A turn that has not been known since the first touch has nothing to lose.
    """
    P = body.covariance
    if P[2, 2] > 0.0 and np.isfinite(P[2, 2]):
        P[2, 2] = max(P[2, 2], np.pi**2 / 3.0)  # that of any angle
        xx, xy, yy = inverse2(normal[0, 0], normal[0, 1], normal[1, 1])
        P[0, 2] = P[2, 0] = -P[2, 2] * (xx * normal[0, 2] + xy * normal[1, 2])
        P[1, 2] = P[2, 1] = -P[2, 2] * (xy * normal[0, 2] + yy * normal[1, 2])


@routine
def add_contact(
    place: Floats,
    place_cov: Floats,
    own_turn: Floats,
    robust: bool,
    anchor: Anchor,
    body: Body,
    equations: Equations,
) -> None:
    """Add an anchored contact at a place (2,) to the normal equations of a step; robust: less if it is far off."""
    chi2, _, (xx, xy, yy), (dx, dy, off) = residual_of(place, place_cov, own_turn, anchor, body)
    trust = weight_of(chi2, usual_misfit(body)) if robust else 1.0
    x, y = rotate(np.cos(body.pose[2]), np.sin(body.pose[2]), anchor.x, anchor.y)
    add_point(equations, (trust * xx, trust * xy, trust * yy), x, y, dx, dy)
    if own_turn[1] > 0.0 and np.isfinite(anchor.theta):
        own_weight = trust * OWN_TURN_WEIGHT / own_turn[1]
        equations.normal[2, 2] += own_weight
        equations.right[2] += own_weight * off


@routine
def judge_misfit(
    place: Floats, place_cov: Floats, own_turn: Floats, placed: Bools, observable: bool, anchors: Records, body: Body
) -> None:
    """Add the weighted residuals of a scan's contacts, if there are more than the pose needs, to the body's misfit."""
    misfit, freedom = 0.0, 0.0
    for pad in range(len(place)):
        anchor: Anchor = anchors[pad]
        if placed[pad] and anchor.anchored:
            chi2, measured, _, _ = residual_of(place[pad], place_cov[pad], own_turn[pad], anchor, body)
            weight = min(1.0, (ROBUST.student + 2.0) / (ROBUST.student + chi2))
            misfit += weight * chi2
            freedom += weight * measured
    freedom -= 3 if observable else 2
    if freedom > 0.0:
        body.misfit = MISFIT.memory * body.misfit + misfit
        body.freedom = MISFIT.memory * body.freedom + freedom


@routine
def set_anchor(place: Floats, place_cov: Floats, theta: float, anchor: Anchor, body: Body) -> None:
    """Note where on the object a new contact lies, given where the object is now."""
    cos, sin = np.cos(body.pose[2]), np.sin(body.pose[2])
    anchor.x, anchor.y = rotate_back(cos, sin, place[0] - body.pose[0], place[1] - body.pose[1])
    anchor.theta = theta - body.pose[2]
    for a in range(2):
        for b in range(2):
            anchor.covariance[a, b] = place_cov[a, b]


@routine
def write_pose(body: Body, with_turn: bool, pose: Floats, covariance: Floats) -> None:
    """Fill pose (3,) and covariance (3, 3); what belongs to the turn stays NaN without it."""
    axes = 3 if with_turn else 2
    factor = usual_misfit(body)
    for a in range(axes):
        pose[a] = body.pose[a]
        for b in range(axes):
            covariance[a, b] = factor * body.covariance[a, b]
