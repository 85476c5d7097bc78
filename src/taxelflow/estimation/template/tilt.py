"""Tilt of the load in a pose and its covariance: pressure that shifts on the object looks like motion of the object.

The line of action of a load shifts over the contact when the arm moves, friction pulls or the skin creeps: by its
eccentricity d (2,), moment over force. A rigid object then sinks in by a plane, as in `rest_or_slide`: on an elastic
skin the pressure changes by a plane, too, on a softer one in proportion to itself. Each holds the whole moment,

    y = g (q + q l . M^-1 d),    y = g (q + m l' . P^-1 d),    q = q(u),

with the places l and l' about the centre of the pressure and of the contact, the second moments M and P of both, and
the mean pressure m of the contact. d is an unknown of each scan with a zero-mean prior, alike in every direction: a
moment knows nothing of the contact's shape, and a narrow contact, which cannot hold it, rolls.

For a paraboloid, tilt and shift cannot be separated; for a pattern with edges they can. A batch eliminates d (Schur
complement): the covariance of the pose contains its effect, and what it explains of the residuals moves the pose. A
stream registers its scans without: the error of its places is what such a fit makes of d.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.template.normal_equations import FIT_HUBER
from taxelflow.numerics.bspline import STATE, state_of
from taxelflow.numerics.centroid import LOADED, eccentricity_variance
from taxelflow.numerics.rounding import LINE_POINTS, NEGLIGIBLE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from taxelflow.estimation.template.map import Pattern
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.messages import Floats

_LEAST_RADIUS = 0.1
"""Lower limit of a radius of gyration, in pitches: that across a single line of taxels is 0."""
_STEP_PRIOR = np.eye(STATE)
"""Information on a step by a tilt: a standard deviation of a pitch, a rad, and 1 of gain and size."""


class _Tilts(NamedTuple):
    """What scan k knows of its tilts. information: (4, 4), on d by both changes. shared: (5, 4), with the state.
    right: (4,), of the residuals. variance: of each part of d, pitches^2.
    """

    k: int
    information: Floats
    shared: Floats
    right: Floats
    variance: float


def without_tilt(
    information: Floats, pattern: Pattern, scanned: Scanned, states: Floats, error: float, tilt_std: float
) -> tuple[Floats, Floats]:
    """Information (scans, 5, 5) of the states with the tilt of each scan eliminated, and the step (scans, 5) to the
    states that are best with it, from those that are best without.

    error: see `Scanned.with_error`. tilt_std: see `eccentricity_variance`; with 0 nothing changes.
    """
    step, own = np.zeros_like(states), information.copy()
    for one in _tilts(information, pattern, scanned, states, error, tilt_std):
        k, columns = one.k, np.column_stack([one.shared.T, one.right])
        by_tilt = np.linalg.solve(one.information + np.eye(4) / one.variance, columns)
        own[k] -= one.shared @ by_tilt[:, :-1]
        step[k] = np.linalg.solve(own[k] + _STEP_PRIOR, -one.shared @ by_tilt[:, -1])
    return own, step


def shift_by_tilt(
    information: Floats, pattern: Pattern, scanned: Scanned, states: Floats, error: float, tilt_std: float
) -> Floats:
    """Covariance (scans, 2, 2) of the places, pitches^2, by a tilt of which their fit knows nothing, mean of both
    changes of the pressure. Arguments as for `without_tilt`.
    """
    found = np.zeros((len(states), 2, 2))
    for one in _tilts(information, pattern, scanned, states, error, tilt_std):
        moved = np.linalg.solve(information[one.k] + NEGLIGIBLE * np.eye(STATE), one.shared)[:2]
        found[one.k] = 0.5 * one.variance * moved @ moved.T
    return found


def _tilts(
    information: Floats, pattern: Pattern, scanned: Scanned, states: Floats, error: float, tilt_std: float
) -> Iterator[_Tilts]:
    """Of the scans that have readings enough. States that are held share nothing with a tilt."""
    if tilt_std <= 0.0:
        return
    readings = scanned.with_error(error)
    for k, state in enumerate(states):
        values = pattern.read(scanned.places, state, scanned.bends[k])
        q = np.nan_to_num(values[:, 0])
        seen = (q > 0) & (readings.variance[k] > 0) & (scanned.readings[k] < scanned.ceiling)
        if np.count_nonzero(seen) < LINE_POINTS:
            continue
        gain = state_of(state).gain
        jacobian = np.column_stack([gain * values[seen, 1:4], q[seen], gain * values[seen, 4]])
        modes, moment = _modes(scanned.places[:, seen], q[seen])
        variance = readings.variance[k, seen]
        left = scanned.readings[k, seen] - gain * q[seen]
        off = np.abs(left) / np.sqrt(variance)
        weight = FIT_HUBER / np.maximum(off, FIT_HUBER) / variance  # that of the information: no more is eliminated
        modes *= gain
        weighted = modes * weight[:, np.newaxis]
        shared = jacobian.T @ weighted
        held = information[k].any(axis=1) & (np.count_nonzero(information[k], axis=1) == 1)
        shared[held] = 0.0
        prior = eccentricity_variance(tilt_std, 0.5 * float(np.trace(moment)))
        yield _Tilts(k, modes.T @ weighted, shared, left @ weighted, prior)


def _modes(places: Floats, pressure: Floats) -> tuple[Floats, Floats]:
    """(taxels, 4), changes of a pressure (taxels,) at places (2, taxels), pitches, by d above, in proportion to itself
    and by a plane; second moment (2, 2) of the pressure.
    """
    even = np.where(pressure > LOADED.skirt * pressure.max(), 1.0, 0.0)
    moments, changes = [], []
    for weight in (pressure, even * (pressure.sum() / even.sum())):
        share = weight / weight.sum()
        off = places - (places @ share)[:, np.newaxis]
        moments.append((off * share) @ off.T + _LEAST_RADIUS**2 * np.eye(2))
        changes.append(weight[:, np.newaxis] * np.linalg.solve(moments[-1], off).T)
    return np.concatenate(changes, axis=1), moments[0]
