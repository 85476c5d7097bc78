"""Tilt of the load in a pose and its covariance: pressure that shifts on the object looks like motion of the object.

The line of action of a load shifts over the contact when the arm moves, friction pulls or the skin creeps. A rigid
object then sinks in by a plane, as in `rest_or_slide`: on an elastic skin the pressure changes by a plane, too, on a
softer one in proportion to itself,

    y = g (q(u) (1 + a . l) + m (b . l)),    l = ((x - x_c) / r_x, (y - y_c) / r_y),

with the contact's centre (x_c, y_c), radii of gyration (r_x, r_y) and mean pressure m. For a paraboloid, tilt and shift
cannot be separated; for a pattern with edges they can. a and b are unknowns of each scan with a zero-mean prior, and
are eliminated (Schur complement): the covariance of the pose contains their effect, and what they explain of the
residuals moves the pose.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.normal_equations import FIT_HUBER
from taxelflow.numerics.bspline import STATE, state_of
from taxelflow.numerics.centroid import LOADED
from taxelflow.numerics.rounding import LINE_POINTS

if TYPE_CHECKING:
    from taxelflow.estimation.template.map import Pattern
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.messages import Floats

_LEAST_RADIUS = 0.1
"""Lower limit of a radius of gyration, in pitches: that across a single line of taxels is 0."""
_STEP_PRIOR = np.eye(STATE)
"""Information on a step by a tilt: a standard deviation of a pitch, a rad, and 1 of gain and size."""


def without_tilt(
    information: Floats,
    pattern: Pattern,
    scanned: Scanned,
    states: Floats,
    error: float,
    tilt_std: float,
) -> tuple[Floats, Floats]:
    """Information (scans, 5, 5) of the states with the tilt of each scan eliminated, and the step (scans, 5) to the
    states that are best with it, from those that are best without.

    error: see `Scanned.with_error`. tilt_std: standard deviation of each a and b; with 0 nothing changes.
    """
    step = np.zeros_like(states)
    if tilt_std <= 0.0:
        return information, step
    readings = scanned.with_error(error)
    own = information.copy()
    prior = np.eye(4) / tilt_std**2
    for k, state in enumerate(states):
        values = pattern.read(scanned.places, state, scanned.bends[k])
        q = np.nan_to_num(values[:, 0])
        seen = (q > 0) & (readings.variance[k] > 0) & (scanned.readings[k] < scanned.ceiling)
        if np.count_nonzero(seen) < LINE_POINTS:
            continue
        gain = state_of(state).gain
        jacobian = np.column_stack([gain * values[seen, 1:4], q[seen], gain * values[seen, 4]])
        modes = gain * _modes(scanned.places[:, seen], q[seen])
        variance = readings.variance[k, seen]
        left = scanned.readings[k, seen] - gain * q[seen]
        off = np.abs(left) / np.sqrt(variance)
        weight = FIT_HUBER / np.maximum(off, FIT_HUBER) / variance  # that of the information: no more is eliminated
        weighted = modes * weight[:, np.newaxis]
        shared = jacobian.T @ weighted
        by_tilt = np.linalg.solve(modes.T @ weighted + prior, np.column_stack([shared.T, left @ weighted]))
        explained, right = shared @ by_tilt[:, :-1], -shared @ by_tilt[:, -1]
        held = own[k].any(axis=1) & (np.count_nonzero(own[k], axis=1) == 1)  # a state that is held
        explained[held] = explained[:, held] = 0.0
        own[k] -= explained
        right[held] = 0.0
        step[k] = np.linalg.solve(own[k] + _STEP_PRIOR, right)
    return own, step


def _modes(places: Floats, pressure: Floats) -> Floats:
    """(taxels, 4), changes of a pressure (taxels,) at places (2, taxels), pitches, by a and b above."""
    share = pressure / pressure.sum()
    off = places - (places @ share)[:, np.newaxis]
    radius = np.sqrt(off**2 @ share)
    levers = (off / np.maximum(radius, _LEAST_RADIUS)[:, np.newaxis]).T
    plane = np.where(pressure > LOADED.skirt * pressure.max(), pressure @ share, 0.0)
    return np.concatenate([pressure[:, np.newaxis] * levers, plane[:, np.newaxis] * levers], axis=1)
