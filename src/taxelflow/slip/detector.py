"""Every pad's poses through the two tests, scan by scan: is it still, does it slip, and what changed."""

from __future__ import annotations

from math import erfc

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.messages import AMBIGUOUS, LOST, OK, UNRESOLVED, Bools, Bytes, Floats
from taxelflow.slip.ending import (
    AT,
    AT_VAR,
    BEGAN,
    DOUBT,
    FROM,
    LOST_TURN,
    RESTS,
    SINCE,
    SLIDE,
    SPEED,
    has_leapt,
    set_off,
    slide,
)
from taxelflow.slip.jump import (
    ARRIVED_S,
    BEFORE,
    BEFORE_S,
    FALLEN,
    JUMP,
    LATEST,
    LEAP,
    by_chance,
    goes_by,
    load_falls,
    rests_at,
)
from taxelflow.slip.onset import BEGIN, ENERGY_OF, SLIP, VELOCITY, thinned, threshold, weigh
from taxelflow.slip.rest_filter import (
    AXES,
    ENERGY,
    STEP,
    STILL,
    TURN_COUNTS,
    TURNS,
    P,
    forget,
    innovate,
    scale,
    settle,
    spread,
)

NEW, RESTING, SLIPPING = range(3)
"""Modes: in contact for too short a time to judge; still; slipping."""

# Memory per pad: mode, time of the last scan and of the last pose used, logarithm of the load or 0, poses since the
# contact began or began anew, when that was, how many ramps are followed, whether it is what is left of one that was
# let go, accumulated displacement (3), usual variance of its poses (3); `still`'s, `halt`'s and `leap`'s.
MODE, LAST, USED, LOAD, KNOWN, FIRST, RAMPS, LEFT, Y, USUAL = *range(9), 11
CALM = 14
MOVED = CALM + STILL
AWAY = MOVED + SLIDE
MEMORY = AWAY + LEAP
# What changed: when a slip began or ended, s, and its velocity along x, y, theta.
WHEN, MOTION, NOTE = 0, 1, 4
# Parameters, see `SlipMonitor.numbers`.
ALARM_S, LOAD_M, CREEP_M_S, SETTLE_S = range(4)

_UNSURE = 9.0
"""Factor on the variance of a pose that does not fit what the method knows."""
_UNKNOWN, _UNKNOWN_M = 100.0, 0.005
"""A place that is known so many times worse along one axis than along the other, and so badly, is told along that one
only. A centroid on a line of taxels is known exactly across it: that says nothing against what it is along it."""
_FRESH, _MOST_FRESH = 0.05, 4.0
"""What a pose counts for in the usual variance, and how many times as large it counts at most: one may be far off."""
_FEWEST = 3
"""Poses that a still object must have had."""
_FLOOR_M, _FLOOR_RAD = 1e-6, 1e-5
"""No pose is better known than this; some methods say 0."""
_STOPS, _GOES_ON, _SURE = 3.0, 0.02, 30.0
"""Odds of a stop at which it is told, at which the slip goes on after all, and that end the doubt."""
_CALM_SIGMAS = 2.5
"""A method without direction has stopped slipping when its sign of slip is below so many standard deviations."""


@kernel
def follow(
    t: Floats,
    contact: Bools,
    displacement: Floats,
    covariance: Floats,
    pose: Floats,
    pose_covariance: Floats,
    lag: Floats,
    load: Floats,
    disturbance: Floats,
    quality: Bytes,
    numbers: Floats,
    memory: Floats,
    ramps: Floats,
    stops: Floats,
    slipping: Bools,
    notes: Floats,
) -> None:
    """Fill slipping (scans, pads) and, where a slip begins or ends, notes (scans, pads, NOTE).

    The first ten: fields of `Slips`, covariance that of the displacement. numbers: `SlipMonitor.numbers`.
    memory: (pads, MEMORY), ramps: (pads, MOST_RAMPS, RAMP), stops: (pads, MOST_STOPS, STOP), kept from block to block.
    """
    y, noise, placed = np.empty(3), np.empty(6), np.empty(6)
    for pad in range(contact.shape[1]):
        m = memory[pad]
        for scan in range(len(t)):
            d, now = displacement[scan, pad], t[scan]
            senses = not np.isnan(disturbance[scan, pad])
            _take_load(load[scan, pad], contact[scan, pad], m)
            # What is left may be no contact at all but what has drifted: it must be worth something.
            worth = quality[scan, pad] == OK or (quality[scan, pad] == AMBIGUOUS and _along(covariance[scan, pad]))
            blind = np.isnan(d[0]) or quality[scan, pad] == LOST or (m[LEFT] > 0.0 and not worth)
            goes_by(now, pose[scan, pad], quality[scan, pad], m[LOAD], m[AWAY:])
            if not contact[scan, pad] or (not senses and blind):
                m[MODE], m[KNOWN] = NEW, 0.0
            else:
                if m[KNOWN] == 0.0:
                    m[FIRST], m[USED] = now, -np.inf
                    forget(m[CALM : CALM + STILL])
                m[KNOWN] += 1.0
                # A pose that is the mean of two scans shares one with the next: only every second one is new.
                shared = lag[scan, pad] > 0.0
                if senses:
                    _sense(now, disturbance[scan, pad], numbers, m, notes[scan, pad])
                else:
                    for axis in range(3):
                        m[Y + axis] += d[axis] if not np.isnan(d[axis]) else 0.0
                        y[axis] = m[Y + axis]
                    if not shared or now - 2.0 * lag[scan, pad] > m[USED] + 1e-9:
                        doubt = _UNSURE if quality[scan, pad] == UNRESOLVED else 1.0
                        _spread(covariance[scan, pad], doubt * (1.0 if shared else 0.5), noise)
                        _single_out(noise)
                        _judge(now, y, noise, numbers, m, ramps[pad], stops[pad], notes[scan, pad])
                        _spread(pose_covariance[scan, pad], doubt * scale(m[CALM:]), placed)
                        _compare(now, y, noise, pose[scan, pad], placed, numbers, m, stops[pad], notes[scan, pad])
                        m[USED] = now
            m[LAST] = now
            slipping[scan, pad] = m[MODE] == SLIPPING and m[MOVED + DOUBT] == 0.0


@kernel
def _take_load(load: float, touched: bool, m: Floats) -> None:
    """Remember the load; one that leaps is another contact: touched or let go, all or a part of it."""
    if not touched:
        m[LOAD] = m[LEFT] = m[AWAY + FALLEN] = 0.0
    elif load > 0.0:
        rise = np.log(load) - m[LOAD] if m[LOAD] != 0.0 else 0.0
        m[LOAD] = np.log(load)
        if abs(rise) > JUMP:
            if m[MODE] == RESTING and rise < 0.0:
                load_falls(m[LOAD], m[AWAY:])
            m[MODE], m[KNOWN] = NEW, 0.0
            m[LEFT] = 1.0 if rise < 0.0 else 0.0


@kernel
def _spread(covariance: Floats, share: float, noise: Floats) -> None:
    """Covariance (6,) of one pose: `share` of one (3, 3), a displacement's or its own, and no less than the floor."""
    noise[0] = share * covariance[0, 0] + _FLOOR_M**2
    noise[1] = share * covariance[1, 1] + _FLOOR_M**2
    noise[2] = share * covariance[2, 2] + _FLOOR_RAD**2
    noise[3] = share * covariance[0, 1]
    noise[4] = share * covariance[0, 2]
    noise[5] = share * covariance[1, 2]


@kernel
def _along(covariance: Floats) -> bool:
    """Whether one of x and y is known, and the other is not."""
    xx, yy = covariance[0, 0], covariance[1, 1]
    return _unknown(xx, yy) or _unknown(yy, xx)


@kernel
def _unknown(own: float, other: float) -> bool:
    """Whether a place is not known along an axis, by its variance along it and along the other."""
    return bool(own > max(_UNKNOWN**2 * other, _UNKNOWN_M**2))


@kernel
def _single_out(noise: Floats) -> None:
    """Let x or y, of a covariance (6,), count for nothing if it is known so much worse than the other."""
    for axis in range(2):
        if _unknown(noise[axis], noise[1 - axis]):
            noise[axis], noise[3], noise[4 + axis] = np.nan, 0.0, 0.0


@kernel
def _level(noise: Floats, m: Floats) -> None:
    """Raise a covariance (6,) to the mean over the last poses of an object that does not move, axis by axis.

    A covariance is that of the place where the pose came to lie. Where it differs much from place to place, one that
    noise has thrown off claims to be known well there; an object that rests has one place, and one covariance.
    """
    usual, fresh = m[USUAL : USUAL + 3], max(1.0 / m[KNOWN], _FRESH)
    if m[KNOWN] == 1.0:
        usual[:] = 0.0
    raised = np.ones(3)
    for axis in range(3):
        if not np.isnan(noise[axis]):
            before = usual[axis] if usual[axis] > 0.0 else noise[axis]
            usual[axis] = before + fresh * (min(noise[axis], _MOST_FRESH * before) - before)
            raised[axis] = np.sqrt(max(usual[axis] / noise[axis], 1.0))
            noise[axis] *= raised[axis] * raised[axis]
    noise[3] *= raised[0] * raised[1]
    noise[4] *= raised[0] * raised[2]
    noise[5] *= raised[1] * raised[2]


@kernel
def _judge(
    t: float, y: Floats, noise: Floats, numbers: Floats, m: Floats, ramps: Floats, stops: Floats, note: Floats
) -> None:
    """One pose of one pad, independent of the last one."""
    if m[MODE] != SLIPPING:
        _level(noise, m)
    if m[MODE] == NEW:
        calm = m[CALM : CALM + STILL]
        variance = spread(noise) * scale(calm)
        turns = not np.isnan(noise[2]) and (m[KNOWN] == 1.0 or calm[TURNS] > 0.0)
        settle(y, variance, m[LOAD], numbers[LOAD_M : CREEP_M_S + 1], calm)
        if not turns:
            calm[TURNS] = 0.0
        m[RAMPS] = 0.0
        if m[KNOWN] >= _FEWEST and t - m[FIRST] >= numbers[SETTLE_S]:
            m[MODE] = RESTING
    elif m[MODE] == RESTING:
        _rests(t, y, noise, numbers, m, ramps, note)
    else:
        _slips(t, y, noise, numbers, m, stops, note)


@kernel
def _compare(
    t: float,
    y: Floats,
    noise: Floats,
    pose: Floats,
    placed: Floats,
    numbers: Floats,
    m: Floats,
    stops: Floats,
    note: Floats,
) -> None:
    """An object that rests at a pose (3,), with covariance placed (6,): has it slipped here from where it rested before
    its load fell?

    y: (3,), noise: (6,), its accumulated displacement and that one's covariance.
    """
    away = m[AWAY:]
    if m[MODE] == SLIPPING:
        away[FALLEN] = 0.0  # what it does from here on is no leap
    if m[MODE] != RESTING:
        return
    stayed = by_chance(t, placed, m[LOAD], numbers[LOAD_M], numbers[SETTLE_S], away)
    if stayed < (t - m[LAST]) / numbers[ALARM_S]:
        m[MODE] = SLIPPING
        way, moved = away[LATEST : LATEST + 2] - away[BEFORE : BEFORE + 2], m[MOVED : MOVED + SLIDE]
        has_leapt(y, way, away[BEFORE_S], away[ARRIVED_S], t - m[LAST], spread(noise), moved, stops)
        _tell(moved[BEGAN], moved[SPEED : SPEED + 3], False, note)
    if away[FALLEN] == 0.0:
        rests_at(t, pose, placed, m[LOAD], away)


@kernel
def _rests(t: float, y: Floats, noise: Floats, numbers: Floats, m: Floats, ramps: Floats, note: Floats) -> None:
    """One more pose of a still object, which may begin to slip."""
    calm, moved = m[CALM : CALM + STILL], m[MOVED : MOVED + SLIDE]
    step, slip = np.empty(STEP), np.empty(SLIP)
    innovate(t - m[USED], y, noise, m[LOAD], numbers[LOAD_M : CREEP_M_S + 1], calm, step)
    count = int(m[RAMPS])
    whole = weigh(t, m[USED], step, calm, count, ramps, slip)
    m[RAMPS] = thinned(t, count + 1, ramps)
    if whole > threshold(numbers[ALARM_S], t - m[USED], step[AXES] + step[TURN_COUNTS]):
        m[MODE] = SLIPPING
        set_off(t, m[USED], slip, calm[P], moved)
        calm[ENERGY] = max(calm[ENERGY] - slip[ENERGY_OF], 0.0)  # the slip's part of the scatter is explained
        _tell(slip[BEGIN], slip[VELOCITY : VELOCITY + 3], step[TURN_COUNTS] > 0.0, note)


@kernel
def _slips(t: float, y: Floats, noise: Floats, numbers: Floats, m: Floats, stops: Floats, note: Floats) -> None:
    """One more pose of a slipping object, which may stop."""
    calm, moved = m[CALM : CALM + STILL], m[MOVED : MOVED + SLIDE]
    rests = np.empty(RESTS)
    turns = not np.isnan(noise[2]) and moved[LOST_TURN] == 0.0
    if not turns:  # what it turned by in between is unknown
        moved[LOST_TURN], noise[2] = 1.0, np.nan
    noise *= scale(calm)
    odds = slide(t, y, noise, m[USED], numbers[CREEP_M_S], moved, stops, rests)
    if odds > _STOPS and moved[DOUBT] == 0.0:
        moved[DOUBT] = 1.0
        mean = (rests[AT : AT + 3] - moved[FROM : FROM + 3]) / max(rests[SINCE] - moved[BEGAN], 1e-9)
        _tell(rests[SINCE], mean, turns, note)
    elif odds < _GOES_ON and moved[DOUBT] > 0.0:
        moved[DOUBT] = 0.0
        _tell(moved[BEGAN], moved[SPEED : SPEED + 3], turns, note)
    if odds > _SURE:
        m[MODE], m[RAMPS] = RESTING, 0.0
        m[USUAL : USUAL + 3] = 0.0  # that of another place
        settle(rests[AT : AT + 3], rests[AT_VAR], m[LOAD], numbers[LOAD_M : CREEP_M_S + 1], calm)
        if not turns:
            calm[TURNS] = 0.0


@kernel
def _tell(when_s: float, velocity: Floats, turns: bool, note: Floats) -> None:
    note[WHEN] = when_s
    for axis in range(3):
        note[MOTION + axis] = velocity[axis] if axis < 2 or turns else np.nan


@kernel
def _sense(t: float, sigmas: float, numbers: Floats, m: Floats, note: Floats) -> None:
    """One scan of a method without direction: it alarms if chance does so more seldom than was asked for."""
    chance = erfc(sigmas / np.sqrt(2.0))
    if m[MODE] == SLIPPING:
        if sigmas < _CALM_SIGMAS:
            m[MODE] = RESTING
            note[WHEN] = t
    elif t - m[FIRST] >= numbers[SETTLE_S] and chance < (t - m[LAST]) / numbers[ALARM_S]:
        m[MODE], m[MOVED + DOUBT] = SLIPPING, 0.0
        note[WHEN] = t
