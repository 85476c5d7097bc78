"""Residuals of contacts that are anchored on the object, their weights, and what is kept from scan to scan."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from taxelflow.fusion.misfit import MISFIT
from taxelflow.messages import Floats
from taxelflow.numerics.records import Vector
from taxelflow.numerics.rounding import LEAST_VARIANCE_M2
from taxelflow.numerics.se2 import rotate
from taxelflow.numerics.small_linalg import inverse2
from taxelflow.runtime.compiling import inlined, routine


class _Robust(NamedTuple):
    """Robust weights of the iterations."""

    iterations: int = 8
    """Gauss-Newton steps at most."""
    plain: int = 3
    """First steps without robust weights: there a residual may be the motion since the last scan."""
    far: float = 11.34
    """Chi-square above which a contact weighs less (Huber): the 99 % point of three degrees of freedom."""
    student: float = 4.0
    """Degrees of freedom of the Student t weights, with which a wrong contact hardly affects the misfit."""


ROBUST = _Robust()
OWN_TURN_WEIGHT = 0.5
"""Weight of a pad's own theta: the variance of theta at its anchor, about equal, doubles that of the difference."""


class Anchor:
    """Place of a pad's contact on the object; theta: the pad's own, less the object's, when it was anchored.

    root: a factor of the covariance of the object's pose at that time, along the object's axes; 0 in the first scan.
    """

    anchored: bool
    x: float
    y: float
    theta: float
    covariance: Annotated[Floats, 2, 2]
    root: Annotated[Floats, 3, 3]


class Body:
    """Pose of the object since first contact, and its covariance; all 0 until something touches.

    misfit, freedom: chi-square of the contacts' residuals and its degrees of freedom, over the last scans. turning:
    whether the last fit had a turn. Else the covariance of the place is that at this theta, and the last column its
    covariance with theta. placed: whether any contact has had a place since.
    """

    pose: Vector
    covariance: Annotated[Floats, 3, 3]
    misfit: float
    freedom: float
    turning: bool
    placed: bool


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
        chi2, measured = chi2 + OWN_TURN_WEIGHT * off * off / own_turn[1], 3
    return chi2, measured, (xx, xy, yy), (dx, dy, off)


@inlined
def weight_of(chi2: float, usual: float) -> float:
    """Weight of a contact with this chi-square, where chi-square is usually too large by this factor (Huber)."""
    return np.sqrt(ROBUST.far * usual / chi2) if chi2 > ROBUST.far * usual else 1.0


@inlined
def usual_misfit(body: Body) -> float:
    """Reduced chi-square of the last scans, at least 1."""
    return max(1.0, body.misfit / body.freedom) if body.freedom > MISFIT.least_freedom else 1.0
