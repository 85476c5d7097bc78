"""Motion along a pad that no reading shows: of a rod that reaches across it, along itself; of a smooth plate.

Where the border hides a direction from the centre of pressure, see `numerics.cut`, a map alone shows motion along it.
Slopes of a map do not prove that. Those of a plate may be faults of the taxels. Those of a rod are there between the
lines that taxels have passed along, where nothing but smoothness determines the map. So the motion is changed by a
few pitches from the first scan to the last, either way, and held, and all else fitted again. If that leaves no more of
the readings than faults of the sensor may, they do not determine the motion.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.bundle_adjustment import refine
from taxelflow.estimation.template.hypotheses import coarse, covering, refined
from taxelflow.estimation.template.likelihood import learned_error
from taxelflow.estimation.template.map import fill
from taxelflow.estimation.template.observations import COARSE
from taxelflow.estimation.template.scaling import SIZE_STD
from taxelflow.numerics.bspline import STATE, evaluate, states_of
from taxelflow.numerics.centroid import pressure_centre
from taxelflow.numerics.cut import HIDDEN, find_hidden, open_sides
from taxelflow.runtime.compiling import kernel

if TYPE_CHECKING:
    from taxelflow.estimation.template.observations import Readings, Scanned
    from taxelflow.estimation.template.solution import Solved
    from taxelflow.messages import Bools, Floats

_CHANGED = 2.0
"""Pitches by which the motion is changed: what one taxel reads, its neighbours must read, too."""
_FAULTS = 0.5
"""RMS error that faults of taxels make of a contact's readings, as a share of that of the largest, `unseen_error`."""
_ROUNDS = 4, 3, 3
"""Rounds of fits, the first with the coarse error."""
_FEWEST, _READINGS = 16, 2000
"""Scans, and readings in them, that the smoothing of a map does not outweigh: fewer are repeated."""
_SHOWN = 2.0
"""Times what faults of the taxels make of a map's slopes."""
_MOST_SCANS = 50


def hidden_direction(scanned: Scanned, solved: Solved) -> Floats:
    """(2,), unit vector along the pad of the motion that no reading shows; 0 if there is none."""
    found = np.zeros(2)
    if not scanned.unseen_error or solved.grows or scanned.across.any() or len(scanned) < 2:
        return found
    direction, is_textured = _least_textured(scanned, solved)
    follows = float(np.hypot(*(_shown_by_centre(scanned) @ direction)))
    if follows < HIDDEN and not (is_textured and _is_determined(scanned, solved, direction)):
        found[:] = direction
    return found


def shown_at_rest(scanned: Scanned) -> bool:
    """Whether one scan of an object shows that it would be seen to move: it is as if it had not moved for some time."""
    if scanned.across.any() or np.linalg.svd(_shown_by_centre(scanned), compute_uv=False)[1] >= HIDDEN:
        return True
    again, _ = _repeated(scanned, np.zeros((1, STATE)))
    states = np.zeros((len(again), STATE))
    states[:, :2], states_of(states).gain[:] = scanned.centroids()[0], 1.0
    return not hidden_direction(again, refined(again, coarse(again, states, turns=False))).any()


def _shown_by_centre(scanned: Scanned) -> Floats:
    """(2, 2), the matrix by which the centre of pressure follows a motion, mean of the scans; see `numerics.cut`."""
    hidden = np.empty((len(scanned), 4))
    _hidden(scanned.with_error(0.0), scanned.edge, open_sides(scanned.places), hidden)
    load = scanned.load().sum(axis=1)
    mean: Floats = np.eye(2) - np.average(hidden, axis=0, weights=load if load.any() else None).reshape(2, 2)
    return mean


@kernel
def _hidden(scans: Readings, edge: Bools, sides: Floats, out: Floats) -> None:
    """Fill out (scans, 4), see `find_hidden`."""
    middle = np.empty(5)
    for k in range(len(scans.value)):
        reading, variance = scans.value[k], scans.variance[k]
        pressure_centre(reading, variance, scans.places, edge, middle)
        find_hidden(reading, variance, scans.places, sides, middle, out[k])


def _least_textured(scanned: Scanned, solved: Solved) -> tuple[Floats, bool]:
    """(2,), the direction along which the map changes least, and whether more than faults of single taxels make it."""
    values, slopes, pressure = np.empty((scanned.places.shape[1], 5)), np.zeros((2, 2)), 0.0
    one = solved.pattern
    for k in range(0, len(scanned), max(len(scanned) // _MOST_SCANS, 1)):
        evaluate(one.coefficients, one.lattice, scanned.places, solved.states[k], scanned.bends[k], values)
        used = (scanned.variance[k] > 0) & np.isfinite(values[:, 0])
        slopes += values[used, 1:3].T @ values[used, 1:3]
        pressure += float(np.sum(np.maximum(values[used, 0], 0.0) ** 2))
    least, directions = np.linalg.eigh(slopes)
    by_faults = 2.0 * scanned.unseen_error**2 * pressure  # neighbours differ by two faults
    return directions[:, 0], bool(least[0] > _SHOWN * by_faults)


def _is_determined(scanned: Scanned, solved: Solved, direction: Floats) -> bool:
    """Whether another motion along a direction leaves more of the scans than faults of the sensor may."""
    most = np.hypot(solved.error, _FAULTS * scanned.unseen_error)
    scans, states = _repeated(scanned, solved.states)
    own, progress = replace(solved, states=states), np.linspace(-0.5, 0.5, len(scans))
    return all(_left_along(scans, own, direction, way * _CHANGED * progress) > most for way in (1.0, -1.0))


def _repeated(scanned: Scanned, states: Floats) -> tuple[Scanned, Floats]:
    """Scans and their states (scans, 5), each as often, one after the other, as makes them enough."""
    count, taxels = scanned.readings.shape
    times = -(-max(_FEWEST, -(-_READINGS // taxels)) // count)
    if times <= 1:
        return scanned, states
    which = np.repeat(np.arange(count), times)
    return replace(scanned.taken(which), t_s=np.arange(float(len(which)))), states[which]


def _left_along(scanned: Scanned, solved: Solved, direction: Floats, changed: Floats) -> float:
    """The error that a fit leaves whose places along a direction, changed by (scans,) pitches, are held.

    The size is free: of a map that tapers, motion stands for a contact that widens with its load.
    """
    cos, sin = direction
    turned = np.array([[cos, sin], [-sin, cos]])
    along = replace(scanned, places=turned @ scanned.places)
    states = solved.states.copy()
    states[:, :2] = states[:, :2] @ turned.T
    states_of(states).x[:] += changed
    pattern = covering(along, states)
    fill(pattern, along.with_error(COARSE), states)
    stiffness = along.stiffness(turns=solved.turns, gain_std=solved.gain_std, size=SIZE_STD**-2)
    stiffness[0] = np.inf
    error = COARSE
    for rounds in _ROUNDS:
        fit = refine(pattern, along, states, rounds=rounds, error=error, stiffness=stiffness)
        error = learned_error(fit, along)
    return error
