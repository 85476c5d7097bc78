"""Relocalisation: registration of a scan to a former map from starts all over the pad."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.template.levenberg_marquardt import FREE, HELD, ROOM, Prior, refine_state
from taxelflow.estimation.template.linearization import Packed, frame_of, look_up, pack_scan
from taxelflow.estimation.template.map import Surface
from taxelflow.estimation.template.online.explained import UNEXPLAINED, unexplained
from taxelflow.messages import Floats
from taxelflow.numerics.bspline import STATE, put, state_of, states_of
from taxelflow.numerics.robust import HUBER, gate
from taxelflow.numerics.small_linalg import copy_matrix
from taxelflow.runtime.compiling import kernel
from taxelflow.runtime.settled import Settled

if TYPE_CHECKING:
    from taxelflow.estimation.template.online.hand import PadScan
    from taxelflow.estimation.template.online.local_map import LocalMap
    from taxelflow.estimation.template.online.track_state import Track

DOUBT = 0.25
"""Share of a map's approximate variance that counts when scans are registered."""


class _Search(NamedTuple):
    """Where a known pattern is looked for, and when it is found."""

    about: float = 1.0
    """How far, in pitches, a recognised object may lie from where it is looked for."""
    surely: float = 9.0
    leap: tuple[float, float] = (2.0, 0.5)
    """A state that was followed stands against one found all over the pad only if its chi-square is less by this times
    the usual; an object that is known lies within this many pitches and rad of where it was."""
    reaches: tuple[float, float, float, float, float] = (0.0, 0.5, 1.0, 1.5, 2.0)
    """Radii outwards of the scan's centroid at which the object is looked for."""
    same: float = 0.5
    """States closer than this, in pitches, are the same."""


_SEARCH = _Search()
_ITERATIONS = np.int64(20)


class Found(NamedTuple):
    """Where a scan fits a known map: state (5,), its information (5, 5), chi-square per reading, number of readings."""

    state: Floats
    information: Floats
    chi: float
    readings: int


@kernel
def _best_of(
    surface: Surface,
    taxels: Packed,
    starts: Floats,
    precision: Floats,
    limits: tuple[float, float],
    state: Floats,
    information: Floats,
) -> tuple[float, int]:
    """Register a scan from every start (n, 5), and fill state (5,) and information (5, 5) with the likeliest of what
    explains it; its chi-square and how many readings, 0 if there is none.

    limits: chi-square per reading that is usual; error of the pattern.
    """
    best, best_chi, best_count = np.inf, 0.0, 0
    usual, error = limits
    room = np.empty((ROOM + STATE + 2, STATE))
    mean, trial, found = room[ROOM + STATE], room[ROOM + STATE + 1], room[ROOM : ROOM + STATE]
    for start in range(len(starts)):
        put(state_of(starts[start]), mean)
        put(state_of(starts[start]), trial)
        prior = Prior(mean, precision)
        cost, chi, count = refine_state(surface, taxels, prior, HUBER, _ITERATIONS, trial, found, room[:ROOM])
        if not (cost < best and count > 0 and chi / max(count, 1) < gate(usual, float(count))):
            continue
        frame = frame_of(surface.lattice, trial)
        look_up(surface, frame, taxels)
        if unexplained(frame, taxels, error, mean) > UNEXPLAINED.known:
            continue
        best, best_chi, best_count = cost, chi, count
        put(state_of(trial), state)
        copy_matrix(found, information)
    return best_chi, best_count


_best = Settled(_best_of)


def relocalise(
    known: LocalMap,
    middle: Floats,
    scan: PadScan,
    theta: float | None = None,
) -> Found | None:
    """Where a known pattern explains a scan, or None. middle: (2,) centroid of the scan.

    The object may lie partly beyond the pad's border, so it is looked for further out, too; where a turn can be seen,
    at all angles, or at those around theta. A few taxels at the border may be explained by many a place along it: it is
    looked for where its middle lies on the line from the pad's through the scan's.
    """
    pattern = known.pattern
    coefficients, doubt = np.ascontiguousarray(pattern.coefficients), np.ascontiguousarray(DOUBT * pattern.doubt)
    surface = Surface(coefficients, doubt, pattern.lattice)
    error = known.error * min(known.scanned.amplitude, float(scan.reading.max()))  # it may touch but lightly
    taxels = pack_scan(scan.places, np.zeros((3, 0)), scan.reading, scan.variance, scan.ceiling, error)
    outward = middle / max(float(np.hypot(*middle)), 1e-9)
    steps = np.arange(12) if theta is None else np.arange(-1, 2)
    angles = steps * (np.pi / 6) if known.turns else np.zeros(1)
    angles = angles + (state_of(known.keyframes.states[-1]).theta if theta is None else theta)
    x, y = pattern.centre()
    cos, sin = np.cos(angles), np.sin(angles)
    arms = np.stack([cos * x - sin * y, sin * x + cos * y], axis=1)
    reaches = np.array(_SEARCH.reaches)[:, np.newaxis]
    places = (middle + reaches * known.radius * outward) - arms[:, np.newaxis]
    starts = np.zeros((len(angles) * len(reaches), STATE))
    starts[:, :2], at = places.reshape(-1, 2), states_of(starts)
    at.theta[:], at.gain[:] = np.repeat(angles, len(reaches)), 1.0
    across = known.keyframes.scanned.across
    starts[:, :2][:, across] = known.keyframes.states[-1, :2][across]
    place = np.where(across, HELD, _SEARCH.about**-2)
    state, information = np.zeros(STATE), np.zeros((STATE, STATE))
    for gain_std in (known.loose_gain_std, 1.0):
        precision = np.array([*place, FREE if known.turns else HELD, gain_std**-2, HELD])
        chi, count = _best(surface, taxels, starts, precision, (float(known.usual), float(error)), state, information)
        if count:
            return Found(state, information, chi / count, count)
    return None


def close(found: Floats, known: Floats) -> bool:
    """Whether one state (5,) can have become the other at once."""
    leap = state_of(found - known)
    return bool(np.hypot(leap.x, leap.y) < _SEARCH.leap[0] and abs(leap.theta) < _SEARCH.leap[1])


def surely_elsewhere(found: Found, m: Track) -> bool:
    """Whether a state found from nothing but a scan is to be believed, and not the one that was followed."""
    better = m.chi * m.count < found.chi * found.readings - _SEARCH.surely * m.usual
    return bool(not better and np.hypot(*(found.state - m.state)[:2]) > _SEARCH.same)
