"""One scan after the other: every pad's scan registered to its pattern, in one call for the whole hand."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel, lean_kernel
from taxelflow.estimation.template.levenberg_marquardt import HELD, register_laid_out
from taxelflow.estimation.template.linearization import VARIANCE, laid_out
from taxelflow.estimation.template.online import track_state as online
from taxelflow.estimation.template.online.residual_process import bring, keep
from taxelflow.estimation.template.online.track_state import HUBER
from taxelflow.numerics.bspline import GAIN, SIZE, STATE, THETA, X, Y
from taxelflow.numerics.centroid import loaded_centroid
from taxelflow.numerics.robust import gate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats

_PREDICTED, _AS_BEFORE, _WITH_CENTROID, _LOOSE, _TURNS, _GROWS, _ATTEMPTS = range(7)
"""Ways to register a scan: from where it should be, where it was, where its centroid has gone; with a gain that may
jump; and for an object that may have begun to turn, or to grow with the load."""
_ITERATIONS = 12
_POOR = 2.0
"""A scan that fits so many times worse than usual is tried from other starts."""
_REST = 2.0
"""And what it leaves is carried over to the next."""
_MOVES, _SETTLES_S = 0.15, 0.2
"""An object that is closer, in pitches, than this to where it was in so many seconds is still."""
_FREE = 1e-6
"""Stiffness of a place."""
_LOOSE_GAIN_STD = 0.5
_CHEAPER, _PAID = 1e-3, 0.3
"""What an attempt must lower the cost by; and the share of the misfit that turning or growing must explain."""
_STAYS, _SAME = 0.5, 5
"""Only an object that has stayed within so many pitches, for so many keyframes, may be seen to grow."""
_GROWTH, _LEAST_GROWTH, _FIRST_GROWTH = 0.5, 0.002, 0.1
"""Change of the size's logarithm from scan to scan, per change of the load's; and where it first shows."""
_CUT, _FIRST_TURN_STD = 0.1, 0.1
"""A contact is cut if so much of its load lies at the border; an object that is whole may begin to turn."""


@kernel
def follow(
    t: float,
    reading: Floats,
    variance: Floats,
    ceiling: Floats,
    places: Floats,
    delay: Floats,
    edge: Bools,
    starts: NDArray[np.int64],
    contact: Bools,
    patterns: Floats,
    doubts: Floats,
    memory: Floats,
    states: Floats,
    information: Floats,
    steps: Floats,
    rests: Floats,
) -> bool:
    """Register one scan (entries,) on the patterns (pads, rows, cols) of all pads in contact; whether all of them fit.

    A pattern is NaN beyond its own rows and columns. memory: (pads, SLOTS), states: (pads, 5) and rests: (4, entries),
    see `carry`, are kept from scan to scan. information: (pads, 5, 5) of the states, steps: (pads, 5, 5) of how far
    they are from those before. places: (2, entries) in pitches; delay: (entries,) or (0,); edge: (entries,), at a
    border of its pad.
    """
    fits = True
    room = np.empty((STATE, STATE))
    found = np.zeros((STATE, STATE))
    for pad in range(len(starts) - 1):
        m = memory[pad]
        if not contact[pad] or m[online.ACTIVE] == 0.0:
            continue
        own = slice(starts[pad], starts[pad + 1])
        _follow_pad(
            t,
            reading[own],
            variance[own],
            ceiling[own],
            places[:, own],
            delay[own],
            edge[own],
            patterns[pad],
            doubts[pad],
            m,
            states[pad],
            information[pad],
            steps[pad],
            rests[:, own],
            room,
            found,
        )
        fits = fits and m[online.CHI] <= gate(m[online.USUAL], m[online.COUNT]) and m[online.PROBATION] == 0.0
    return fits


@kernel
def _follow_pad(
    t: float,
    reading: Floats,
    variance: Floats,
    ceiling: Floats,
    places: Floats,
    delay: Floats,
    edge: Bools,
    pattern: Floats,
    doubt: Floats,
    m: Floats,
    state: Floats,
    information: Floats,
    step: Floats,
    rest: Floats,
    room: Floats,
    found: Floats,
) -> None:
    """`follow` for one pad, whose scan is (taxels,); room, found: (5, 5), to work in."""
    last, middle, stiffness = room[0], room[1], room[2]
    for a in range(STATE):
        last[a] = state[a]
    span = t - m[online.LAST_T]
    loaded_centroid(reading, variance, places, edge, middle)
    m[online.CUT] = max(m[online.CUT], 1.0 if middle[2] > _CUT else 0.0)
    in_line = m[online.ACROSS_X] > 0.0 or m[online.ACROSS_Y] > 0.0
    may_turn = m[online.TURN_STD] == 0.0 and m[online.CUT] == 0.0 and not in_line
    may_grow = m[online.GROWS] == 0.0 and m[online.AWAY] <= _STAYS and m[online.KEYFRAMES] >= _SAME
    poor = m[online.CHI] > gate(m[online.USUAL], m[online.COUNT])
    grown_std = _growth(m[online.LOAD], middle[3])
    bend = _bend(m, delay)
    taxels = laid_out(places, bend, reading, variance, ceiling)
    lattice = m[online.SPACING : online.LOW + 1]
    brought = np.empty((3, 0))
    chi, usual = np.inf, m[online.USUAL]
    if m[online.CARRIES] == 0.0 or (poor and (may_turn or may_grow)):
        chi = _search(
            pattern, doubt, lattice, taxels, m[online.ROUGH], usual, span, grown_std, may_turn, may_grow,
            m, state, information, room, found,
        )  # fmt: skip
    if m[online.CARRIES] > 0.0:
        brought, usual = np.empty((3, len(reading))), 1.0
        bring(span, _surely_moved(m, span, step), rest, reading, variance, ceiling, brought)
        less = laid_out(places, bend, brought[0], brought[1], brought[2])
        chi = _search(
            pattern, np.empty((0, 0)), lattice, less, 0.0, usual, span, grown_std, False, False,
            m, state, information, room, found,
        )  # fmt: skip
    for a in range(STATE):
        for b in range(STATE):
            step[a, b] = information[a, b]
    m[online.CHI] = chi
    still = _stays(m, span, state, step)
    for i in range(len(reading)):
        rest[3, i] = reading[i] - brought[0, i] if m[online.CARRIES] > 0.0 else 0.0
    if m[online.CARRIES] > 0.0 or still or chi > _REST * usual:
        _stiffen(m, grown_std, stiffness)
        m[online.CHI] = keep(
            pattern, doubt, lattice, taxels, m[online.ROUGH], m[online.USUAL], stiffness, state,
            chi / usual, still, brought, rest, information,
        )  # fmt: skip
        m[online.CARRIES] = 1.0 if still or m[online.CHI] > _REST * m[online.USUAL] else 0.0
    _remember(t, span, last, middle, state, m)


@lean_kernel
def _growth(before: float, load: float) -> float:
    """How far the size's logarithm may go with a change of the load."""
    pressed = abs(np.log(load / before)) if load > 0.0 and before > 0.0 else 1.0
    return float(_GROWTH * pressed + _LEAST_GROWTH)


@kernel
def _bend(m: Floats, delay: Floats) -> Floats:
    """(3, taxels), how far the object goes, at its last speed, until each taxel is read; (3, 0) if all are at once."""
    bend = np.empty((3, len(delay)))
    for a in range(3):
        for i in range(len(delay)):
            bend[a, i] = m[online.SPEED_X + a] * delay[i]
    return bend


@lean_kernel
def _surely_moved(m: Floats, span: float, step: Floats) -> float:
    """Pitches from scan to scan at the last speed, beyond what noise makes of them; step: (5, 5), its information."""
    moved = span * np.hypot(m[online.SPEED_X], m[online.SPEED_Y])
    return float(np.sqrt(max(moved * moved - 4.0 / step[X, X] - 4.0 / step[Y, Y], 0.0)))


@kernel
def _search(
    pattern: Floats,
    doubt: Floats,
    lattice: Floats,
    taxels: Floats,
    rough: float,
    usual: float,
    span: float,
    grown_std: float,
    may_turn: bool,
    may_grow: bool,
    m: Floats,
    state: Floats,
    information: Floats,
    room: Floats,
    found: Floats,
) -> float:
    """Register a scan in one way after the other until it fits; state (5,) and information (5, 5) become the best.

    Returns chi-square per reading, by `usual` of which it is judged.
    """
    last, middle, stiffness, prior, trial = room[0], room[1], room[2], room[3], room[4]
    best, best_chi = np.inf, np.inf
    for attempt in range(_ATTEMPTS):
        if attempt >= _TURNS and best_chi <= gate(usual, m[online.COUNT]):
            break
        if (attempt == _TURNS and not may_turn) or (attempt == _GROWS and not may_grow):
            continue
        _start(attempt, m, span, middle, last, state, trial)
        _stiffen(m, grown_std, stiffness)
        stiffness[GAIN] = 1.0 / ((m[online.GAIN_STD] if attempt < _LOOSE else _LOOSE_GAIN_STD) * last[GAIN]) ** 2
        if attempt == _TURNS:
            stiffness[THETA] = 1.0 / _FIRST_TURN_STD**2
        elif attempt == _GROWS:
            stiffness[SIZE] = 1.0 / _FIRST_GROWTH**2
        for a in range(STATE):
            prior[a] = last[a]
        if m[online.TURN_STD] > 0.0:
            prior[THETA] = trial[THETA]
        cost, chi, count = register_laid_out(
            pattern, doubt, lattice, taxels, rough, HUBER, prior, stiffness, _ITERATIONS, trial, found
        )
        if cost < best - (_CHEAPER if attempt < _TURNS else _PAID * _misfit(best, taxels)):
            best, best_chi, m[online.COUNT] = cost, chi / max(count, 1), count
            for a in range(STATE):
                state[a] = trial[a]
                for b in range(STATE):
                    information[a, b] = found[a, b]
            _learn_freedom(attempt, m)
        if best_chi <= _POOR * usual:
            break
    return best_chi


@lean_kernel
def _misfit(cost: float, taxels: Floats) -> float:
    """What a cost is above that of readings which fit."""
    for i in range(taxels.shape[1]):
        cost -= 1.0 if taxels[VARIANCE, i] > 0.0 else 0.0
    return max(cost, _CHEAPER)


@lean_kernel
def _start(attempt: int, m: Floats, span: float, middle: Floats, last: Floats, best: Floats, trial: Floats) -> None:
    """Fill trial (5,) with where an attempt starts; last, best: (5,), the scan before's state, and what was found."""
    for a in range(STATE):
        trial[a] = best[a] if attempt >= _LOOSE else last[a]
    if attempt == _PREDICTED:
        trial[X] += m[online.SPEED_X] * span
        trial[Y] += m[online.SPEED_Y] * span
        trial[THETA] += m[online.SPEED_T] * span if m[online.TURN_STD] > 0.0 else 0.0
    elif attempt == _WITH_CENTROID:
        trial[X] += middle[0] - m[online.CENTROID_X]
        trial[Y] += middle[1] - m[online.CENTROID_Y]


@lean_kernel
def _stiffen(m: Floats, grown_std: float, stiffness: Floats) -> None:
    """Fill stiffness (5,), but for the gain, as a pad's pattern is known to turn and grow."""
    stiffness[X] = HELD if m[online.ACROSS_X] > 0.0 else _FREE
    stiffness[Y] = HELD if m[online.ACROSS_Y] > 0.0 else _FREE
    stiffness[THETA] = 1.0 / m[online.TURN_STD] ** 2 if m[online.TURN_STD] > 0.0 else HELD
    stiffness[SIZE] = 1.0 / grown_std**2 if m[online.GROWS] > 0.0 else HELD


@lean_kernel
def _learn_freedom(attempt: int, m: Floats) -> None:
    """Note that the object has turned, or grown, if that was what explained a scan; what was carried is explained."""
    if attempt >= _TURNS:
        m[online.CARRIES] = 0.0
    if attempt == _TURNS:
        m[online.TURNED] = 1.0
    if attempt == _GROWS:  # the pose steps, for what was taken for motion was growth
        m[online.GROWS], m[online.CONTINUES] = 1.0, 0.0


@lean_kernel
def _stays(m: Floats, span: float, state: Floats, step: Floats) -> bool:
    """Whether the object is where it has been lately, of which this scan becomes a part."""
    away = np.hypot(state[X] - m[online.PLACE_X], state[Y] - m[online.PLACE_Y])
    away += m[online.RADIUS] * abs(state[THETA] - m[online.PLACE_T])
    continues = m[online.CONTINUES] > 0.0
    still = continues and away < _MOVES + 3.0 * np.sqrt(1.0 / step[X, X] + 1.0 / step[Y, Y])
    follows = 1.0 - np.exp(-span / _SETTLES_S) if continues else 1.0
    for a in range(3):
        m[online.PLACE_X + a] += follows * (state[a] - m[online.PLACE_X + a])
    return bool(still)


@lean_kernel
def _remember(t: float, span: float, last: Floats, middle: Floats, state: Floats, m: Floats) -> None:
    """Keep what the next scan is predicted from."""
    if span > 0.0:
        for a in range(3):
            m[online.SPEED_X + a] = (state[a] - last[a]) / span
        m[online.SPAN] = span
    m[online.LAST_T] = t
    m[online.CENTROID_X], m[online.CENTROID_Y], m[online.LOAD] = middle[0], middle[1], middle[3]
