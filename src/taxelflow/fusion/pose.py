"""How far the object has moved and turned since first contact: a rigid fit of all contacts, scan by scan."""

from __future__ import annotations

import numpy as np

from taxelflow.fusion.anchors import (
    LEAST_VARIANCE_M2,
    Anchor,
    Body,
    add_common,
    add_turned,
    follow_contacts,
    forget,
    residual_of,
    set_anchor,
    usual_misfit,
    weight_of,
)
from taxelflow.fusion.in_hand import Carried
from taxelflow.fusion.twist import Equations, Row, add_point, clear, solve_rigid, solve_translation, turn_is_observable
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.records import Records
from taxelflow.numerics.se2 import rotate
from taxelflow.numerics.se3 import count_true
from taxelflow.numerics.small_linalg import inverse2
from taxelflow.runtime.compiling import kernel, routine

_ITERATIONS = 8
_PLAIN = 3
"""Steps without weights: until then a residual may be the motion since the last scan."""
_SMALLEST_STEP = 1e-12
"""In m and rad: rounding."""
_STUDENT = 4.0
"""Degrees of freedom of the Student t distribution whose weights keep a contact that is wrong out of the misfit."""
_MEMORY = 0.98
"""What is left of misfit and freedom after a scan: they reach back over about 50 scans."""


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
    after a gap that its method does not measure across. While nothing touches everything is forgotten.
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
        observable = turns
        for iteration in range(_ITERATIONS):
            robust = iteration >= _PLAIN
            clear(equations)
            if not add_contacts(
                (place[scan], place_cov[scan], own_turn[scan], placed[scan]), robust, anchors, body, equations
            ):
                observable = False
                break
            observable = turns and turn_is_observable(equations.normal)
            if step_pose(observable, body, equations) < _SMALLEST_STEP and robust:
                break
        seen = place[scan], place_cov[scan], own_turn[scan], placed[scan]
        judge_misfit(place[scan], place_cov[scan], own_turn[scan], placed[scan], observable, anchors, body)
        find_covariance(seen, observable, anchors, body, equations)
        follow_contacts(seen, observable, anchors, body)
        first = add_common(seen, turns, anchors, body, equations)
        for pad in range(place.shape[1]):
            anchor: Anchor = anchors[pad]
            if placed[scan, pad] and not anchor.anchored:
                set_anchor(place[scan, pad], place_cov[scan, pad], own_turn[scan, pad], first, anchor, body)
            anchor.anchored = anchor.anchored or placed[scan, pad]
        row: Row = rows[scan]
        at_start = body.pose[2] == 0.0 and body.covariance[2, 2] == 0.0
        write_pose(body, observable or at_start, row.pose, row.pose_covariance)


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
        own_weight = trust / (own_turn[1] + anchor.turn_variance)
        equations.normal[2, 2] += own_weight
        equations.right[2] += own_weight * off


@routine
def find_covariance(
    seen: tuple[Floats, Floats, Floats, Bools], observable: bool, anchors: Records, body: Body, equations: Equations
) -> None:
    """Fill the body's covariance: by errors of now, and of anchors whose error is not in the common one. seen: see
    `add_contacts`.
    """
    place, place_cov, own_turn, placed = seen
    clear(equations)
    count = 0
    for pad in range(len(place)):
        anchor: Anchor = anchors[pad]
        if not (placed[pad] and anchor.anchored):
            continue
        count += 1
        chi2, _, _, _ = residual_of(place[pad], place_cov[pad], own_turn[pad], anchor, body)
        trust, late = weight_of(chi2, usual_misfit(body)), 0.0 if anchor.first else 1.0
        xx, xy, yy = inverse2(
            place_cov[pad, 0, 0] + late * anchor.covariance[0, 0] + LEAST_VARIANCE_M2,
            place_cov[pad, 0, 1] + late * anchor.covariance[0, 1],
            place_cov[pad, 1, 1] + late * anchor.covariance[1, 1] + LEAST_VARIANCE_M2,
        )
        x, y = rotate(np.cos(body.pose[2]), np.sin(body.pose[2]), anchor.x, anchor.y)
        add_point(equations, (trust * xx, trust * xy, trust * yy), x, y, 0.0, 0.0)
        if own_turn[pad, 1] > 0.0 and np.isfinite(anchor.theta):
            equations.normal[2, 2] += trust / (own_turn[pad, 1] + late * anchor.turn_variance)
    if count and observable:
        solve_rigid(equations, equations.solution, body.covariance)
    elif count:
        solve_translation(equations, equations.solution, body.covariance)


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
            weight = min(1.0, (_STUDENT + 2.0) / (_STUDENT + chi2))
            misfit += weight * chi2
            freedom += weight * measured
    freedom -= 3 if observable else 2
    if freedom > 0.0:
        body.misfit = _MEMORY * body.misfit + misfit
        body.freedom = _MEMORY * body.freedom + freedom


@routine
def write_pose(body: Body, with_turn: bool, pose: Floats, covariance: Floats) -> None:
    """Fill pose (3,) and covariance (3, 3); what belongs to the turn stays NaN without it."""
    axes = 3 if with_turn else 2
    factor = usual_misfit(body)
    own = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            own[a, b] = body.common[a, b]
    common = np.zeros((3, 3))
    add_turned(own, body.pose[2], common)
    at_start = body.covariance[0, 0] == 0.0
    for a in range(axes):
        pose[a] = body.pose[a]
        for b in range(axes):
            covariance[a, b] = 0.0 if at_start else factor * (body.covariance[a, b] + common[a, b])
