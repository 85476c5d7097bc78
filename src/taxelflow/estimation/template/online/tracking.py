"""Tracking: each scan is registered to the maps of all pads in contact, in one call for the whole hand."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taxelflow.estimation.template.levenberg_marquardt import FREE, HELD, MAY_BE_HELD, Prior, refine_state
from taxelflow.estimation.template.linearization import (
    PACKED,
    Frame,
    Packed,
    frame_of,
    lanes_for,
    look_up,
    pack_places,
    pack_readings,
    rows_of,
)
from taxelflow.estimation.template.map import Surface
from taxelflow.estimation.template.online.explained import UNEXPLAINED, fits, unexplained, unexplained_and_doubted
from taxelflow.estimation.template.online.hand import Hand, PadScan, Patterns, Room, Scan
from taxelflow.estimation.template.online.motion import GROWTH, growth_std, is_at_rest, update_motion
from taxelflow.estimation.template.online.residual_process import predict, update
from taxelflow.estimation.template.online.track_state import KEYFRAMES, Track
from taxelflow.estimation.template.online.witness import find_shift, middle_of
from taxelflow.messages import Floats
from taxelflow.numerics.bspline import STATE, State, put, state_of
from taxelflow.numerics.centroid import CELL_ERROR, LOADED, centroid_covariance
from taxelflow.numerics.cut import find_hidden
from taxelflow.numerics.records import Records
from taxelflow.numerics.robust import CHEAPER, GATE, HUBER, gate
from taxelflow.numerics.small_linalg import copy_matrix, mirror
from taxelflow.runtime.compiling import lean_kernel

_PREDICTED, _AS_BEFORE, _WITH_CENTROID, _LOOSE, _TURNS, _GROWS, _ATTEMPTS = range(7)
"""Ways to register a scan: from where it should be, where it was, where its centroid has gone; with a gain that may
jump; and for an object that may have begun to turn, or to grow with the load."""
_ITERATIONS = np.int64(12)  # numba compiles `register` again for each constant of Python
_LOOSE_GAIN_STD = 0.5
"""Standard deviation of a gain that may jump, as a share of it."""
_TURN_STD = 0.1
"""How far theta may move from scan to scan, rad."""
_PAID = 0.3
"""Share of the misfit that turning or growing must explain."""
_CUT = 0.1
"""A contact is cut if so much of its load lies at the border; an object that is whole may begin to turn."""


class Search(NamedTuple):
    """What a scan's registration begins with. states: see `Room`; the last state, the centre of pressure, and room.
    leaves_more: the scan before left more than faults of the sensor do, so that a turn is tried though this one fits.
    """

    states: Floats
    span: float
    usual: float
    grown_std: float
    may_turn: bool
    may_grow: bool
    leaves_more: bool


@lean_kernel
def follow(scan: Scan, hand: Hand, maps: Patterns, tracks: Records) -> bool:
    """Register one scan on the patterns of all pads in contact; whether all of them fit."""
    all_fit = True
    for pad in range(len(hand.starts) - 1):
        m: Track = tracks[pad]
        if not scan.contact[pad] or not m.active:
            continue
        own = slice(hand.starts[pad], hand.starts[pad + 1])
        places, edge, sides = hand.places[pad], hand.edge[own], hand.sides[pad]
        part = PadScan(scan.reading[own], scan.variance[own], scan.ceiling[own], scan.raw[own], places, edge, sides)
        surface = Surface(maps.patterns[pad], maps.doubts[pad], m.lattice[:])  # an array, as elsewhere
        _follow_pad(scan.t, part, hand.delay[own], surface, hand.floor, m, maps.rests[:, own], hand.room)
        all_fit = all_fit and fits(m) and m.probation == 0.0
    return all_fit


@lean_kernel
def _follow_pad(
    t: float, scan: PadScan, delay: Floats, surface: Surface, floor: float, m: Track, rest: Floats, room: Room
) -> None:
    """`follow` for one pad. rest: (4, taxels)."""
    count, lanes, states = len(scan.reading), room.lanes, room.states
    last, middle, precision = states[0], states[1], states[2]
    bend, brought = lanes[PACKED : PACKED + 3, : len(delay)], lanes[PACKED + 3 :]
    put(state_of(m.state), last)
    span = t - m.last_t
    middle_of(scan, floor, middle)
    if floor > 0.0:
        spread = m.centroid_covariance[:]
        centroid_covariance(scan.raw, scan.variance, scan.ceiling, scan.places, middle, CELL_ERROR, floor, spread)
        if m.undecided:
            find_hidden(scan.raw, scan.variance, scan.places, scan.sides, middle, m.hidden[:])
    m.cut = m.cut or middle[2] > _CUT
    leaves_more = floor > 0.0 and m.unexplained > UNEXPLAINED.by_faults * floor * floor
    in_line = max(m.across[0], m.across[1]) > 0.0
    may_turn = not (m.turns or m.cut or in_line)
    may_grow = not m.grows and m.away <= GROWTH.stays and m.keyframes >= KEYFRAMES.same
    grown_std = growth_std(m.load, middle[3])
    _bend(m, delay, bend)
    level = _level(scan, m)
    error = m.error * level
    taxels = Packed(lanes[:PACKED], lanes_for(count))
    pack_places(scan.places, bend, count, taxels)
    pack_readings(scan.reading, scan.variance, scan.ceiling, error, taxels)
    chi, usual = np.inf, m.usual
    if not m.carries or (may_turn and leaves_more) or (not fits(m) and (may_turn or may_grow)):
        search = Search(states, span, usual, grown_std, may_turn, may_grow, leaves_more)
        chi = _search(surface, taxels, search, m)
    if m.carries:
        usual = 1.0
        predict(span, _surely_moved(m, span), rest, scan, brought)
        pack_readings(brought[0, :count], brought[1, :count], brought[2, :count], 0.0, taxels)
        search = Search(states, span, usual, grown_std, False, False, False)
        chi = _search(Surface(surface.c, surface.doubt[:0], surface.lattice), taxels, search, m)
        pack_readings(scan.reading, scan.variance, scan.ceiling, error, taxels)
    copy_matrix(m.information, m.step)
    m.chi = chi
    frame = frame_of(surface.lattice, m.state[:])
    look_up(surface, frame, taxels)
    rests = is_at_rest(m, span) or m.changing
    for i in range(len(scan.reading)):
        rest[3, i] = scan.reading[i] - brought[0, i] if m.carries else 0.0
    if m.carries or rests or chi > GATE * usual:
        _stiffen(m, m.turns, grown_std if m.grows else 0.0, state_of(precision).gain, precision)
        before = brought[:, : count if m.carries else 0]
        m.chi = update(frame, taxels, error, chi / usual, rests, before, rest, precision, states[10], m)
        m.carries = rests or m.chi > GATE * m.usual
    _judge(frame, taxels, error, floor * level, level, precision, m)
    _add_lag(bend, scan, m)
    find_shift(floor, m)
    update_motion(t, span, last, middle, m)


@lean_kernel
def _level(scan: PadScan, m: Track) -> float:
    """The contact's largest reading."""
    level = m.amplitude
    for i in range(len(scan.reading)):
        if scan.variance[i] > 0.0:
            level = max(level, scan.reading[i])
    return level


@lean_kernel
def _judge(
    frame: Frame, taxels: Packed, error: float, unseen: float, level: float, precision: Floats, m: Track
) -> None:
    """Fill m.unexplained, m.shift, and m.doubted with the information that is left if readings have the error that the
    sensor may have unseen; and m.strange, whether they leave more than that. error, unseen: of a reading, by the
    pattern and by the sensor. level: the contact's largest reading.
    """
    m.strange = True
    if unseen <= error:
        m.unexplained = unexplained(frame, taxels, error, m.shift[:])
        copy_matrix(m.information, m.doubted)
        return
    more = unseen * unseen - error * error
    least = LOADED.skirt * level
    m.unexplained, chi, count = unexplained_and_doubted(frame, taxels, error, more, least, m.shift[:], m.doubted[:])
    m.strange = chi > gate(1.0, count) * count or m.unexplained > UNEXPLAINED.most
    for part in MAY_BE_HELD:
        if precision[part] >= HELD:
            for a in range(STATE):
                m.doubted[max(a, part), min(a, part)] = 0.0
    for a in range(STATE):
        m.doubted[a, a] += precision[a]
    mirror(m.doubted)


@lean_kernel
def _bend(m: Track, delay: Floats, bend: Floats) -> None:
    """Fill bend (3, taxels), how far the object goes, at its last speed, until each taxel is read; (3, 0) if all are at
    once.
    """
    for a in range(3):
        for i in range(len(delay)):
            bend[a, i] = m.speed[a] * delay[i]


@lean_kernel
def _add_lag(bend: Floats, scan: PadScan, m: Track) -> None:
    """Add to m.shift, a place as if all taxels were read at once, the object's mean motion until they are read."""
    load = dx = dy = 0.0
    for i in range(bend.shape[1]):
        reading = scan.reading[i] if scan.variance[i] > 0.0 and scan.reading[i] > 0.0 else 0.0
        load, dx, dy = load + reading, dx + reading * bend[0, i], dy + reading * bend[1, i]
    if load > 0.0:
        m.shift[0] += dx / load
        m.shift[1] += dy / load


@lean_kernel
def _surely_moved(m: Track, span: float) -> float:
    """Pitches from scan to scan at the last speed, beyond what noise makes of them."""
    moved = span * np.hypot(m.speed[0], m.speed[1])
    return float(np.sqrt(max(moved * moved - 4.0 / m.step[0, 0] - 4.0 / m.step[1, 1], 0.0)))


@lean_kernel
def _search(surface: Surface, taxels: Packed, search: Search, m: Track) -> float:
    """Register a scan in one way after the other until it fits well; m.state and m.information become the best.

    Returns chi-square per reading.
    """
    best, best_chi = np.inf, np.inf
    states = search.states
    precision, mean, trial, found = states[2], states[3], states[4], states[5:10]
    for attempt in range(_ATTEMPTS):
        fit, tried = best_chi <= GATE * search.usual, search.leaves_more and attempt == _TURNS
        if attempt < _TURNS and fit:
            continue
        if attempt >= _TURNS and best_chi <= gate(search.usual, m.count) and not tried:
            break
        if (attempt == _TURNS and not search.may_turn) or (attempt == _GROWS and not search.may_grow):
            continue
        last = state_of(states[0])
        put(_start(attempt, last, search, m), trial)
        grown_std = search.grown_std if m.grows else 0.0
        if attempt == _GROWS:
            grown_std = GROWTH.first_std
        gain_std = m.gain_std if attempt < _LOOSE else _LOOSE_GAIN_STD
        _stiffen(m, m.turns or attempt == _TURNS, grown_std, 1.0 / (gain_std * last.gain) ** 2, precision)
        theta = state_of(trial).theta if m.turns else last.theta
        put(State(last.x, last.y, theta, last.gain, last.size), mean)
        prior = Prior(mean, precision)
        cost, chi, count = refine_state(surface, taxels, prior, HUBER, _ITERATIONS, trial, found, states[10:])
        of_turn = _PAID * (best if fit else _misfit(best, taxels))
        if cost < best - (CHEAPER if attempt < _TURNS else of_turn):
            best, best_chi, m.count = cost, chi / max(count, 1), count
            put(state_of(trial), m.state)
            copy_matrix(found, m.information)
            _learn_freedom(attempt, m)
        if best_chi <= GATE * search.usual and not search.leaves_more:
            break
    return best_chi


@lean_kernel
def _misfit(cost: float, taxels: Packed) -> float:
    """What a cost is above that of readings which fit."""
    variance = rows_of(taxels).variance
    for i in range(taxels.lanes):
        cost -= 1.0 if variance[i] > 0.0 else 0.0
    return max(cost, CHEAPER)


@lean_kernel
def _start(attempt: int, last: State, search: Search, m: Track) -> State:
    """Where an attempt starts; from _LOOSE on at the best that was found."""
    if attempt >= _LOOSE:
        return state_of(m.state)
    dx = dy = turn = 0.0
    if attempt == _PREDICTED:
        dx, dy = m.speed[0] * search.span + m.shifted[0], m.speed[1] * search.span + m.shifted[1]
        turn = m.speed[2] * search.span + m.shifted[2] if m.turns else 0.0
    elif attempt == _WITH_CENTROID:
        dx, dy = search.states[1, 0] - m.centroid[0], search.states[1, 1] - m.centroid[1]
    return State(last.x + dx, last.y + dy, last.theta + turn, last.gain, last.size)


@lean_kernel
def _stiffen(m: Track, turns: bool, grown_std: float, gain: float, precision: Floats) -> None:
    """Fill precision (5,), with the gain's given. The angle is held if it does not turn, the size if grown_std is 0."""
    x = HELD if m.across[0] > 0.0 else FREE
    y = HELD if m.across[1] > 0.0 else FREE
    theta = 1.0 / _TURN_STD**2 if turns else HELD
    size = 1.0 / grown_std**2 if grown_std > 0.0 else HELD
    put(State(x, y, theta, gain, size), precision)


@lean_kernel
def _learn_freedom(attempt: int, m: Track) -> None:
    """Note that the object has turned, or grown, if that was what explained a scan; what was carried is explained."""
    if attempt >= _TURNS:
        m.carries = False
    if attempt == _TURNS:
        m.turned = True
    if attempt == _GROWS:  # the pose steps, for what was taken for motion was growth
        m.grows, m.continues = True, False
