"""Load that shifts over an object at rest: a hypothesis beside that of an object that moves.

Where an object hardly moves, its taxels read different parts of its map. So a map that is learned from all scans
explains any change that follows one or two numbers as a motion of less than about a pitch. A hand that swings, pulls or
pivots an object makes such changes: they redistribute the load, and the object stays. With the pattern q as the taxels
read it, load g, tilt (a, b) and the place (x, y) of a taxel on the pad,

    y = q (g + a x + b y),    not below 0,

has as many unknowns in each scan as a slide: three. The comparison is fair if both hypotheses learn their pattern from
the same scans, near the middle of the motion, and explain others with it, those that are furthest away. A slide shows
there what its neighbours have read before; a tilt does not.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.depth import HALF_TAXEL
from taxelflow.estimation.template.map import covering, fill
from taxelflow.estimation.template.rivals import reported
from taxelflow.numerics.bspline import STATE, evaluate, in_object, state_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.solution import Solved
    from taxelflow.messages import Bools, Floats

_PARTS = 4
"""One part in this many of the scans is nearest to the middle; one is furthest from it."""


def apart_from_rest(scanned: Scanned, solved: Solved) -> Floats:
    """(scans, 2), in pitches, how far from its median place an object moves that has rather rested while its load
    shifted; (0, 2) if a slide explains the scans better.

    Only of sensors with an `unseen_error`: of others the likelihood has decided.
    """
    if not scanned.unseen_error or len(scanned) < _PARTS:
        return np.zeros((0, 2))
    places = reported(solved, scanned)
    apart = places - np.median(places, axis=0)
    order = np.argsort(np.hypot(*apart.T), kind="stable")
    count = len(order) // _PARTS
    slides, rests = _unexplained(scanned, solved, order[:count], order[-count:])
    return apart if rests <= slides else np.zeros((0, 2))


def _unexplained(
    scanned: Scanned, solved: Solved, near: NDArray[np.int64], far: NDArray[np.int64]
) -> tuple[float, float]:
    """Squared readings of the scans `far` that the pattern of the scans `near` leaves by a slide, and by a tilt."""
    known, states = scanned.taken(near), solved.states[near]
    pattern = covering(known, states)
    fill(pattern, known.with_error(solved.error), states)
    at_rest = np.maximum(known.readings, 0.0).mean(axis=0)
    modes = at_rest[:, np.newaxis] * np.column_stack([np.ones(len(at_rest)), scanned.places.T - scanned.middle])
    middle, values = states[len(states) // 2], np.empty((len(at_rest), STATE))
    slides = rests = 0.0
    for k in far:
        evaluate(pattern.coefficients, pattern.lattice, scanned.places, solved.states[k], scanned.bends[k], values)
        seen = (scanned.variance[k] > 0) & (scanned.readings[k] < scanned.ceiling)
        seen &= _on_pad(scanned, solved.states[k], middle)
        reading, moved = scanned.readings[k, seen], np.maximum(np.nan_to_num(values[seen, 0]), 0.0)
        slides += _left(reading, moved[:, np.newaxis])
        rests += _left(reading, modes[seen])
    return slides, rests


def _on_pad(scanned: Scanned, state: Floats, before: Floats) -> Bools:
    """(taxels,), whether what is over a taxel at a state (5,) of the object was over the pad at another."""
    body, turn = in_object(scanned.places.T, state), state_of(before).theta
    cos, sin = np.cos(turn), np.sin(turn)
    was = body @ np.array([[cos, sin], [-sin, cos]]) * np.exp(state_of(before).size) + before[:2]
    low, high = scanned.places.min(axis=1) - HALF_TAXEL, scanned.places.max(axis=1) + HALF_TAXEL
    on_pad: Bools = ((was >= low) & (was <= high)).all(axis=1)
    return on_pad


def _left(reading: Floats, modes: Floats) -> float:
    """Squared readings (taxels,) that their least squares by modes (taxels, n) leaves; no model is negative."""
    model = modes @ np.linalg.lstsq(modes, reading, rcond=None)[0]
    return float(np.sum((reading - np.maximum(model, 0.0)) ** 2))
