"""What contacts inherit of the error of the object's pose at the time when they were anchored, in the plane.

Contacts that are anchored later lie on the object no better than the pose is known by then. These errors are common to
all contacts of that time, so they are propagated through the fit and do not average out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.fusion.anchors import OWN_TURN_WEIGHT, Anchor, Body, residual_of, usual_misfit, weight_of
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.rounding import LEAST_VARIANCE_M2, NEGLIGIBLE
from taxelflow.numerics.se2 import rotate, rotate_back
from taxelflow.numerics.se3 import cholesky
from taxelflow.runtime.compiling import routine

if TYPE_CHECKING:
    from taxelflow.numerics.records import Records


@routine
def inherit(
    seen: tuple[Floats, Floats, Floats, Bools], axes: int, anchors: Records, body: Body, weighted: Floats
) -> None:
    """Add to the covariance of a fit, in its first axes, what the anchors inherited.

    seen: places, covariances, own turns and whether places are known, of a scan. weighted: (3, 3), room.
    """
    place, place_cov, own_turn, placed = seen
    cos, sin, usual = np.cos(body.pose[2]), np.sin(body.pose[2]), usual_misfit(body)
    weighted[:] = 0.0
    for pad in range(len(place)):
        anchor: Anchor = anchors[pad]
        if not (placed[pad] and anchor.anchored and anchor.root[0, 0] > 0.0):
            continue
        chi2, measured, (xx, xy, yy), _ = residual_of(place[pad], place_cov[pad], own_turn[pad], anchor, body)
        trust = weight_of(chi2, usual)
        own_weight = trust * OWN_TURN_WEIGHT / own_turn[pad, 1] if measured > 2 else 0.0
        x, y = rotate(cos, sin, anchor.x, anchor.y)
        for c in range(3):
            turn = anchor.root[2, c]
            ex, ey = rotate(cos, sin, anchor.root[0, c], anchor.root[1, c])
            ex, ey = ex - turn * y, ey + turn * x
            wx, wy = trust * (xx * ex + xy * ey), trust * (xy * ex + yy * ey)
            weighted[0, c] += wx
            weighted[1, c] += wy
            weighted[2, c] += x * wy - y * wx + own_weight * turn
    add_square(weighted, axes, body.covariance)


@routine
def add_square(weighted: Floats, axes: int, covariance: Floats) -> None:
    """Add to a covariance C (3, 3), in its first axes, E E^T with E = C weighted, which replaces weighted (3, 3)."""
    for c in range(3):
        x, y, turn = weighted[0, c], weighted[1, c], weighted[2, c]
        for a in range(axes):
            weighted[a, c] = covariance[a, 0] * x + covariance[a, 1] * y
            if axes > 2:
                weighted[a, c] += covariance[a, 2] * turn
    for a in range(axes):
        for b in range(axes):
            for c in range(3):
                covariance[a, b] += weighted[a, c] * weighted[b, c]


@routine
def factor_pose(body: Body, root: Floats) -> None:
    """Fill root (3, 3), a factor of the covariance of the object's pose, along its axes; 0 while it is 0 by definition.

    A turn that has not been known since the first touch counts from now on, and is left out.
    """
    P, cos, sin = body.covariance, np.cos(body.pose[2]), np.sin(body.pose[2])
    own = np.zeros((3, 3))
    root[:] = 0.0
    if not P[0, 0] > 0.0:
        return
    seen = np.isfinite(P[2, 2])
    apart = 1.0 / P[2, 2] if seen and not body.turning and P[2, 2] > 0.0 else 0.0
    x = rotate_back(cos, sin, P[0, 0] + apart * P[0, 2] * P[0, 2], P[1, 0] + apart * P[1, 2] * P[0, 2])
    y = rotate_back(cos, sin, P[0, 1] + apart * P[0, 2] * P[1, 2], P[1, 1] + apart * P[1, 2] * P[1, 2])
    own[0, 0], own[1, 0] = rotate_back(cos, sin, x[0], y[0])
    own[0, 1], own[1, 1] = rotate_back(cos, sin, x[1], y[1])
    if seen:
        own[2, 2] = P[2, 2]
        own[0, 2], own[1, 2] = rotate_back(cos, sin, P[0, 2], P[1, 2])
        own[2, 0], own[2, 1] = own[0, 2], own[1, 2]
    for a in range(3):
        own[a, a] += LEAST_VARIANCE_M2 + NEGLIGIBLE * own[a, a]
    cholesky(own, root, 3)
