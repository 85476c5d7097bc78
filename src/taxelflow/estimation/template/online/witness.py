"""The centre of pressure beside the map, scan by scan, see `centre_of_pressure`."""

from __future__ import annotations

import numpy as np

from taxelflow.estimation.template.centre_of_pressure import BORDER_ERROR, combine, transformed
from taxelflow.estimation.template.online.track_state import Track
from taxelflow.messages import Floats
from taxelflow.numerics.bspline import state_of
from taxelflow.runtime.compiling import lean_kernel


def anchor(m: Track, middle: Floats) -> None:
    """Keep which point of the object is reported, the one at its state, as its centre of pressure (2,) shows it.

    For an object at a place that no motion led to.
    """
    m.continues = False
    m.speed[:], m.centroid[:] = 0.0, middle
    place, angle = m.state[:2] + m.origin, float(state_of(m.state).theta) - m.theta_0
    x, y = place - m.centroid
    cos, sin = np.cos(angle), np.sin(angle)
    m.arm[:], m.start[:] = (cos * x + sin * y, cos * y - sin * x), place


@lean_kernel
def find_centre(scale: float, m: Track, centre: Floats) -> None:
    """Fill centre (5,), see `Track.before_centre`. scale: of a pitch, m."""
    angle = m.state[2] - m.theta_0
    cos, sin = np.cos(angle), np.sin(angle)
    centre[0] = scale * (m.centroid[0] + cos * m.arm[0] - sin * m.arm[1])
    centre[1] = scale * (m.centroid[1] + sin * m.arm[0] + cos * m.arm[1])
    for a in range(3):
        centre[2 + a] = scale * scale * m.centroid_covariance[3 + a]


@lean_kernel
def weigh_pose(scale: float, m: Track, centre: Floats, pose: Floats, cov: Floats, weight: Floats) -> None:
    """Fill weight (2, 2), W, and make cov (3, 3) of a pose (3,) on its map that of both witnesses. centre: (5,)."""
    if m.load <= 0.0:
        return
    moved = np.hypot(pose[0] - scale * m.start[0], pose[1] - scale * m.start[1])
    moved = max(moved, np.hypot(centre[0] - scale * m.start[0], centre[1] - scale * m.start[1]))
    own, unit, cut = m.centroid_covariance, scale * scale, (BORDER_ERROR * m.border * moved) ** 2
    xx, xy, yy = unit * (own[0] + own[3]), unit * (own[1] + own[4]), unit * (own[2] + own[5])
    combine(cov, (xx + cut, xy, yy + cut), (centre[0] - pose[0], centre[1] - pose[1]), weight)


@lean_kernel
def weigh_step(step: Floats, covariance: Floats, centre: Floats, before: Floats, weight: Floats) -> None:
    """Make a step (3,) on the map and its covariance (3, 3) those of both witnesses. centre, before: (5,)."""
    p, q, r, s = 1.0 - weight[0, 0], -weight[0, 1], -weight[1, 0], 1.0 - weight[1, 1]
    own = transformed(p, q, r, s, (covariance[0, 0], covariance[0, 1], covariance[1, 1]))
    noise = (centre[2] + before[2], centre[3] + before[3], centre[4] + before[4])
    other = transformed(weight[0, 0], weight[0, 1], weight[1, 0], weight[1, 1], noise)
    covariance[0, 0], covariance[1, 1] = own[0] + other[0], own[2] + other[2]
    covariance[0, 1] = covariance[1, 0] = own[1] + other[1]
    x, y = covariance[0, 2], covariance[1, 2]
    covariance[0, 2] = covariance[2, 0] = p * x + q * y
    covariance[1, 2] = covariance[2, 1] = r * x + s * y
    add_weighted(step, centre[0] - before[0] - step[0], centre[1] - before[1] - step[1], weight)


@lean_kernel
def add_weighted(place: Floats, x: float, y: float, weight: Floats) -> None:
    """Move a place by the weighted (2, 2) part of x and y."""
    place[0] += weight[0, 0] * x + weight[0, 1] * y
    place[1] += weight[1, 0] * x + weight[1, 1] * y
