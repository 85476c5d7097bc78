"""Where contacts lie on the object in the plane: anchors, which follow what later scans show; see `spatial.anchors`."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from taxelflow.fusion.twist import Equations, add_point, clear, solve_rigid, solve_translation, turn_is_observable
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.records import Records, Vector
from taxelflow.numerics.se2 import rotate, rotate_back
from taxelflow.numerics.small_linalg import inverse2
from taxelflow.runtime.compiling import inlined, routine

LEAST_VARIANCE_M2 = 1e-18
"""Added to the variance of a place, which may be 0: a nanometre, squared."""
_FAR = 11.34
"""Chi-square of three components, 99 % point, beyond which a contact counts less (Huber's weights)."""
_LEAST_FREEDOM = 20.0
"""Degrees of freedom from which the misfit is significant: its relative standard deviation is then below 0.32."""


class Anchor:
    """Where on the object a pad's contact lies; theta: the pad's own, less the object's. Both are means, as in
    `spatial.anchors`, weighted by weight in sum; covariance and turn_variance are theirs. first: the part of its error
    that does not average out is in the body's common one.
    """

    anchored: bool
    first: bool
    x: float
    y: float
    theta: float
    covariance: Annotated[Floats, 2, 2]
    turn_variance: float
    weight: float


class Body:
    """Pose of the object since first contact, and its covariance; all 0 until something touches.

    common: of the first anchors' common error, in the object's frame, over the usual misfit. misfit, freedom:
    chi-square of the contacts' residuals and its degrees of freedom, over the last scans.
    """

    pose: Vector
    covariance: Annotated[Floats, 3, 3]
    common: Annotated[Floats, 3, 3]
    misfit: float
    freedom: float


@routine
def forget(anchors: Records, body: Body) -> None:
    """The next contact begins at pose 0."""
    body.misfit = body.freedom = 0.0
    for pad in range(len(anchors)):
        anchors[pad].anchored = False
    for a in range(3):
        body.pose[a] = 0.0
        for b in range(3):
            body.covariance[a, b] = body.common[a, b] = 0.0


@routine
def set_anchor(place: Floats, place_cov: Floats, own_turn: Floats, first: bool, anchor: Anchor, body: Body) -> None:
    """Note where on the object a new contact lies, given where the object is now.

    own_turn: (2,), with its variance. first: see `Anchor`.
    """
    cos, sin = np.cos(body.pose[2]), np.sin(body.pose[2])
    anchor.x, anchor.y = rotate_back(cos, sin, place[0] - body.pose[0], place[1] - body.pose[1])
    anchor.theta, anchor.turn_variance = own_turn[0] - body.pose[2], own_turn[1]
    anchor.weight, anchor.first = weight_in_mean(place_cov), first
    for a in range(2):
        for b in range(2):
            anchor.covariance[a, b] = place_cov[a, b]


@routine
def residual_of(
    place: Floats, place_cov: Floats, own_turn: Floats, anchor: Anchor, body: Body
) -> tuple[float, int, tuple[float, float, float], tuple[float, float, float]]:
    """Chi-square of an anchored contact, the number of its components, the weight (xx, xy, yy) of its place, and its
    residual along x, y and of the turn.
    """
    cov = anchor.covariance
    xx, xy, yy = inverse2(
        place_cov[0, 0] + cov[0, 0] + LEAST_VARIANCE_M2,
        place_cov[0, 1] + cov[0, 1],
        place_cov[1, 1] + cov[1, 1] + LEAST_VARIANCE_M2,
    )
    x, y = rotate(np.cos(body.pose[2]), np.sin(body.pose[2]), anchor.x, anchor.y)
    dx, dy = place[0] - x - body.pose[0], place[1] - y - body.pose[1]
    off = own_turn[0] - anchor.theta - body.pose[2]
    chi2, measured = dx * (xx * dx + xy * dy) + dy * (xy * dx + yy * dy), 2
    if own_turn[1] > 0.0 and np.isfinite(anchor.theta):
        chi2, measured = chi2 + off * off / (own_turn[1] + anchor.turn_variance), 3
    return chi2, measured, (xx, xy, yy), (dx, dy, off)


@inlined
def weight_of(chi2: float, usual: float) -> float:
    """Weight of a contact with this chi-square, where chi-square is usually too large by this factor (Huber)."""
    return np.sqrt(_FAR * usual / chi2) if chi2 > _FAR * usual else 1.0


@inlined
def usual_misfit(body: Body) -> float:
    """Reduced chi-square of the last scans, at least 1."""
    return max(1.0, body.misfit / body.freedom) if body.freedom > _LEAST_FREEDOM else 1.0


@routine
def follow_contacts(seen: tuple[Floats, Floats, Floats, Bools], observable: bool, anchors: Records, body: Body) -> None:
    """Move the anchors by their share of what the fit has left of their contacts, see `spatial.anchors`; those that are
    far off stay. seen: see `add_contacts`. observable: whether the fit has a turn; without it, what is left may be one.
    """
    place, place_cov, own_turn, placed = seen
    cos, sin = np.cos(body.pose[2]), np.sin(body.pose[2])
    for pad in range(len(place)):
        anchor: Anchor = anchors[pad]
        if not (placed[pad] and anchor.anchored):
            continue
        chi2, measured, _, (dx, dy, off) = residual_of(place[pad], place_cov[pad], own_turn[pad], anchor, body)
        if chi2 > _FAR * usual_misfit(body):
            continue
        weight = weight_in_mean(place_cov[pad])
        anchor.weight += weight
        share = weight / anchor.weight
        kept = (1.0 - share) * (1.0 - share)
        if observable:
            x, y = rotate_back(cos, sin, share * dx, share * dy)
            anchor.x += x
            anchor.y += y
        for a in range(2):
            for b in range(2):
                anchor.covariance[a, b] = kept * anchor.covariance[a, b] + share * share * place_cov[pad, a, b]
        if measured > 2:
            anchor.theta += share * off if observable else 0.0
            anchor.turn_variance = kept * anchor.turn_variance + share * share * own_turn[pad, 1]


@routine
def add_common(
    seen: tuple[Floats, Floats, Floats, Bools], turns: bool, anchors: Records, body: Body, equations: Equations
) -> bool:
    """Add the error of contacts that are anchored now to the common one, if there are no others: of a motion that it
    looks like; whether it was. seen, turns: see `add_contacts` and `follow_pose`.
    """
    place, place_cov, own_turn, placed = seen
    clear(equations)
    count = 0
    for pad in range(len(place)):
        if placed[pad] and anchors[pad].anchored:
            return False
        if placed[pad]:
            count += 1
            cov, least = place_cov[pad], LEAST_VARIANCE_M2
            weights = inverse2(cov[0, 0] + least, cov[0, 1], cov[1, 1] + least)
            add_point(equations, weights, place[pad, 0] - body.pose[0], place[pad, 1] - body.pose[1], 0.0, 0.0)
            if own_turn[pad, 1] > 0.0:
                equations.normal[2, 2] += 1.0 / own_turn[pad, 1]
    if count == 0:
        return False
    own = np.zeros((3, 3))
    if turns and turn_is_observable(equations.normal):
        solve_rigid(equations, equations.solution, own)
    else:
        solve_translation(equations, equations.solution, own)
    add_turned(own, -body.pose[2], body.common)
    return True


@routine
def add_turned(own: Floats, angle: float, total: Floats) -> None:
    """Add a covariance (3, 3) of a place and a turn, in axes turned by an angle, to a total."""
    cos, sin = np.cos(angle), np.sin(angle)
    for a in range(3):
        x, y = rotate(cos, sin, own[a, 0], own[a, 1])
        own[a, 0], own[a, 1] = x, y
    for b in range(3):
        x, y = rotate(cos, sin, own[0, b], own[1, b])
        own[0, b], own[1, b] = x, y
        for a in range(3):
            total[a, b] += own[a, b]


@inlined
def weight_in_mean(place_cov: Floats) -> float:
    """Weight of a place with a covariance (2, 2) in an anchor's mean."""
    weight: float = 1.0 / (place_cov[0, 0] + place_cov[1, 1] + LEAST_VARIANCE_M2)
    return weight
