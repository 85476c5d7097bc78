"""Tilt of the load in a pose and its covariance: pressure that shifts on the object looks like motion of the object.

The line of action of a load shifts over the contact when the arm moves, friction pulls or the skin creeps: by its
eccentricity d (2,), moment over force. A rigid object then sinks in by a plane, as in `rest_or_slide`: on an elastic
skin the pressure changes by a plane, too, on a softer one in proportion to itself. Each holds the whole moment,

    y = g (q + q l . M^-1 d),    y = g (q + m l' . P^-1 d),    q = q(u),

with the places l and l' about the centre of the pressure and of the contact, the second moments M and P of both, and
the mean pressure m of the contact. For a paraboloid, tilt and shift cannot be separated; for a pattern with edges they
can.

**Pose.** A batch has d as an unknown of each scan, for both changes, and eliminates it (Schur complement): what it
explains of the residuals moves the pose. Its prior is narrow, e^2 M and e^2 P with the sensor's unseen error e: beyond,
a contact lifts off, and no change in proportion to d describes it. A stream registers its scans without.

**Covariance.** A moment knows nothing of the contact's shape: a narrow contact, which cannot hold it, rolls. So the
load acts beside the middle by more, alike in every direction, see `eccentricity_variance`. The covariance holds what
the fit of the pose makes of such a d, by one change or the other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import block_diag

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
    right: (4,), of the residuals. moments: (2, 2, 2), pitches^2, M and P. variance: of each part of d, pitches^2.
    """

    k: int
    information: Floats
    shared: Floats
    right: Floats
    moments: Floats
    variance: float


def without_tilt(
    information: Floats, pattern: Pattern, scanned: Scanned, states: Floats, error: float, tilt_std: float
) -> tuple[Floats, Floats, Floats]:
    """Information (scans, 5, 5) of the states with the tilt of each scan eliminated, the step (scans, 5) to the states
    that are best with it, from those that are best without, and the covariance (scans, 2, 2) of their places by an
    eccentric load, pitches^2.

    error: see `Scanned.with_error`. tilt_std: the sensor's unseen error; with 0 nothing changes.
    """
    step, own, shift = np.zeros_like(states), information.copy(), np.zeros((len(states), 2, 2))
    for one in _tilts(information, pattern, scanned, states, error, tilt_std):
        k, prior = one.k, block_diag(*np.linalg.inv(tilt_std**2 * one.moments))
        by_tilt = np.linalg.solve(one.information + prior, np.column_stack([one.shared.T, one.right, prior]))
        own[k] -= one.shared @ by_tilt[:, :STATE]
        step[k] = np.linalg.solve(own[k] + _STEP_PRIOR, -one.shared @ by_tilt[:, STATE])
        shift[k] = _moved(own[k], one.shared @ by_tilt[:, STATE + 1 :], one.variance)
    return own, step, shift


def shift_by_tilt(
    information: Floats, pattern: Pattern, scanned: Scanned, states: Floats, error: float, tilt_std: float
) -> Floats:
    """The same covariance (scans, 2, 2) of places whose fit knows no tilt. Arguments as for `without_tilt`."""
    shift = np.zeros((len(states), 2, 2))
    for one in _tilts(information, pattern, scanned, states, error, tilt_std):
        shift[one.k] = _moved(information[one.k], one.shared, one.variance)
    return shift


def _moved(information: Floats, shared: Floats, variance: float) -> Floats:
    """Covariance (2, 2) of a place by d, mean of both changes of the pressure. shared: (5, 4), what a fit with this
    information (5, 5) shares with d.
    """
    moved = np.linalg.solve(information + NEGLIGIBLE * np.eye(STATE), shared)[:2]
    covariance: Floats = 0.5 * variance * moved @ moved.T
    return covariance


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
        modes, moments = _modes(scanned.places[:, seen], q[seen])
        variance = readings.variance[k, seen]
        left = scanned.readings[k, seen] - gain * q[seen]
        off = np.abs(left) / np.sqrt(variance)
        weight = FIT_HUBER / np.maximum(off, FIT_HUBER) / variance  # that of the information: no more is eliminated
        modes *= gain
        weighted = modes * weight[:, np.newaxis]
        shared = jacobian.T @ weighted
        held = information[k].any(axis=1) & (np.count_nonzero(information[k], axis=1) == 1)
        shared[held] = 0.0
        eccentric = eccentricity_variance(tilt_std, 0.5 * float(np.trace(moments[0])))
        yield _Tilts(k, modes.T @ weighted, shared, left @ weighted, moments, eccentric)


def _modes(places: Floats, pressure: Floats) -> tuple[Floats, Floats]:
    """(taxels, 4), changes of a pressure (taxels,) at places (2, taxels), pitches, by d above, in proportion to itself
    and by a plane; second moments (2, 2, 2) of the pressure and of the contact.
    """
    even = np.where(pressure > LOADED.skirt * pressure.max(), 1.0, 0.0)
    moments, changes = [], []
    for weight in (pressure, even * (pressure.sum() / even.sum())):
        share = weight / weight.sum()
        off = places - (places @ share)[:, np.newaxis]
        moments.append((off * share) @ off.T + _LEAST_RADIUS**2 * np.eye(2))
        changes.append(weight[:, np.newaxis] * np.linalg.solve(moments[-1], off).T)
    return np.concatenate(changes, axis=1), np.stack(moments)
