"""Known patterns, looked for all over a pad."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.levenberg_marquardt import HELD, Prior, register
from taxelflow.estimation.template.linearization import laid_out
from taxelflow.estimation.template.map import Surface
from taxelflow.estimation.template.online.explained import KNOWN_UNEXPLAINED, unexplained
from taxelflow.estimation.template.online.track_state import HUBER
from taxelflow.numerics.bspline import STATE, state_of
from taxelflow.numerics.robust import gate
from taxelflow.runtime.settled import Settled

if TYPE_CHECKING:
    from taxelflow.estimation.template.online.local_map import Learned
    from taxelflow.estimation.template.online.track_state import PadScan, Track
    from taxelflow.messages import Floats

DOUBT = 0.25
"""How much of a pattern's rough doubt counts when scans are registered."""


@dataclass(frozen=True, slots=True)
class _Search:
    """Where a known pattern is looked for, and when it is found."""

    about: float = 1.0
    """How far, in pitches, a recognised object may lie from where it is looked for."""
    surely: float = 9.0
    leap: tuple[float, float] = (2.0, 0.5)
    """A place found all over the pad is followed only if chi-square is less by so much; an object that is known lies
    within this many pitches and rad of where it was."""
    iterations: int = 20
    reaches: tuple[float, float, float, float, float] = (0.0, 0.5, 1.0, 1.5, 2.0)
    """Radii outwards of the scan's centroid at which the object is looked for."""
    same: float = 0.5
    """States closer than this, in pitches, are the same."""


_SEARCH = _Search()

_register, _unexplained = Settled(register), Settled(unexplained)


def recognised(
    known: Learned,
    middle: Floats,
    scan: PadScan,
    theta: float | None = None,
) -> tuple[Floats, Floats, float, int] | None:
    """Where a known pattern explains a scan, or None: state (5,), its information (5, 5), chi-square per reading and
    how many readings. middle: (2,) centroid of the scan.

    The object may lie partly beyond the pad's border, so it is looked for further out, too; where a turn can be seen,
    at all angles, or at those around theta. A few taxels at the border may be explained by many a place along it: it is
    looked for where its middle lies on the line from the pad's through the scan's.
    """
    pattern = known.pattern
    coefficients, doubt = np.ascontiguousarray(pattern.coefficients), np.ascontiguousarray(DOUBT * pattern.doubt)
    surface = Surface(coefficients, doubt, pattern.lattice)
    error = known.error * min(known.scanned.amplitude, float(scan.reading.max()))  # it may touch but lightly
    taxels = laid_out(scan.places, np.zeros((3, 0)), scan.reading, scan.variance, scan.ceiling, error)
    outward = middle / max(float(np.hypot(*middle)), 1e-9)
    steps = np.arange(12) if theta is None else np.arange(-1, 2)
    angles = steps * (np.pi / 6) if known.turns else np.zeros(1)
    angles = angles + (state_of(known.keyframes.states[-1]).theta if theta is None else theta)
    centre, best, found = pattern.centre(), np.inf, None
    information = np.zeros((STATE, STATE))
    across = known.keyframes.scanned.across
    place = np.where(across, HELD, _SEARCH.about**-2)
    for gain_std in (max(3.0 * known.gain_std, 0.05), 1.0):
        stiffness = np.array([*place, 1e-6 if known.turns else HELD, gain_std**-2, HELD])
        for angle, reach in product(angles, _SEARCH.reaches):
            cos, sin = np.cos(angle), np.sin(angle)
            arm = np.array([cos * centre[0] - sin * centre[1], sin * centre[0] + cos * centre[1]])
            state = np.array([*(middle + reach * known.radius * outward - arm), angle, 1.0, 0.0])
            state[:2][across] = known.keyframes.states[-1, :2][across]
            prior = Prior(state.copy(), stiffness)
            cost, chi, count = _register(surface, taxels, prior, HUBER, _SEARCH.iterations, state, information)
            fits = count and chi / count < gate(known.usual, count)
            if cost < best and fits and _unexplained(surface, taxels, error, state, np.empty(2)) <= KNOWN_UNEXPLAINED:
                best, found = cost, (state.copy(), information.copy(), chi / count, count)
        if found is not None:
            break
    return found


def close(found: Floats, known: Floats) -> bool:
    """Whether one state (5,) can have become the other at once."""
    leap = state_of(found - known)
    return bool(np.hypot(leap.x, leap.y) < _SEARCH.leap[0] and abs(leap.theta) < _SEARCH.leap[1])


def surely_elsewhere(found: tuple[Floats, Floats, float, int], m: Track) -> bool:
    """Whether a state found from nothing but a scan is to be believed, and not the one that was followed."""
    place, _, chi, count = found
    better = m.chi * m.count < chi * count - _SEARCH.surely * m.usual
    return bool(not better and np.hypot(*(place - m.state)[:2]) > _SEARCH.same)
