"""Every pad's poses through the two tests, scan by scan: is it still, does it slip, and what changed."""

from __future__ import annotations

from math import erfc

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.messages import LOST, UNRESOLVED, Bools, Bytes, Floats
from taxelflow.monitor.halt import BEGAN, DOUBT, FROM, SLIDE, SPEED, TURNED, set_off, slide
from taxelflow.monitor.onset import ENERGY, STILL, P, TURNS, scale, settle, threshold, turn_counts, watch

NEW, RESTING, SLIPPING = range(3)
"""Modes: in contact for too short a time to judge; still; slipping."""

# Memory per pad: mode, whether it was in contact, time of the last known pose and of the last one used, logarithm of the
# load, poses since the contact began or began anew, when that was, accumulated displacement (3), then the still object's
# and the slipping one's.
MODE, TOUCHED, LAST, USED, LOAD, KNOWN, SINCE, Y = 0, 1, 2, 3, 4, 5, 6, 7
CALM, MOVED = 10, 10 + STILL
MEMORY = MOVED + SLIDE

# What changed: a slip's onset or end in s, velocity along x, y, theta.
WHEN, VELOCITY, NOTE = 0, 1, 4

# Numbers of the tests.
ALARM_S, LOAD_M, CREEP_M_S, SETTLE_S = range(4)

_UNSURE = 9.0
"""Factor on the variance of a pose that does not fit what the method knows."""
_FEWEST = 3
"""Poses that a still object must have had."""
_FLOOR_M, _FLOOR_RAD = 1e-6, 1e-5
"""No pose is better known than this; some methods say 0."""
_STOPS, _SURE = 3.0, 30.0
"""Odds at which a slip is said to have stopped, and to go on after all below one over them; odds that end the doubt."""
_CALM_SIGMAS = 2.5
"""A method without direction has stopped slipping when its sign of slip is below so many standard deviations."""


@kernel
def follow(
    t: Floats,
    contact: Bools,
    displacement: Floats,
    covariance: Floats,
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

    The first eight: fields of `Slips`, covariance that of the displacement. numbers: `SlipMonitor.numbers`. memory: (pads, MEMORY),
    ramps: (pads, MOST_RAMPS, RAMP), stops: (pads, MOST_STOPS, STOP), kept from block to block.
    """
    y, noise = np.empty(3), np.empty(6)
    for pad in range(contact.shape[1]):
        m = memory[pad]
        for scan in range(len(t)):
            d = displacement[scan, pad]
            if not contact[scan, pad]:
                m[MODE], m[KNOWN] = NEW, 0.0
            elif not np.isnan(disturbance[scan, pad]):
                if m[KNOWN] == 0.0:
                    m[SINCE] = t[scan]
                m[KNOWN] += 1.0
                _sense(t[scan], disturbance[scan, pad], numbers, m, notes[scan, pad])
            elif np.isnan(d[0]) or quality[scan, pad] == LOST:
                m[MODE], m[KNOWN] = NEW, 0.0
            else:
                logarithm = np.log(load[scan, pad]) if load[scan, pad] > 0.0 else m[LOAD]
                for axis in range(3):
                    m[Y + axis] += d[axis] if not np.isnan(d[axis]) else 0.0
                    y[axis] = m[Y + axis]
                # A pose that is the mean of two scans shares one with the next: only every second one is new.
                shared = lag[scan, pad] > 0.0
                if m[KNOWN] == 0.0:
                    m[SINCE] = t[scan]
                m[KNOWN] += 1.0
                if m[KNOWN] == 1.0 or not shared or t[scan] - 2.0 * lag[scan, pad] > m[USED] + 1e-9:
                    doubt = _UNSURE if quality[scan, pad] == UNRESOLVED else 1.0
                    _spread(covariance[scan, pad], doubt * (1.0 if shared else 0.5), noise)
                    _judge(t[scan], y, noise, logarithm, numbers, m, ramps[pad], stops[pad], notes[scan, pad])
                    m[USED], m[LOAD] = t[scan], logarithm
            m[LAST] = t[scan]
            slipping[scan, pad] = m[MODE] == SLIPPING and m[MOVED + DOUBT] == 0.0


@kernel
def _spread(covariance: Floats, share: float, noise: Floats) -> None:
    """Covariance (6,) of one pose from that of a displacement (3, 3): `share` of it, and no less than the floor."""
    noise[0] = share * covariance[0, 0] + _FLOOR_M**2
    noise[1] = share * covariance[1, 1] + _FLOOR_M**2
    noise[2] = share * covariance[2, 2] + _FLOOR_RAD**2
    noise[3] = share * covariance[0, 1]
    noise[4] = share * covariance[0, 2]
    noise[5] = share * covariance[1, 2]


@kernel
def _judge(
    t: float,
    y: Floats,
    noise: Floats,
    load: float,
    numbers: Floats,
    m: Floats,
    ramps: Floats,
    stops: Floats,
    note: Floats,
) -> None:
    """One pose of one pad, independent of the last one."""
    calm, moved = m[CALM : CALM + STILL], m[MOVED : MOVED + SLIDE]
    prior = numbers[LOAD_M : CREEP_M_S + 1]
    variance = 0.5 * (noise[0] + noise[1])
    if m[MODE] == NEW:
        settle(y, variance * scale(calm), load, prior, calm)
        turn_counts(y[2], noise, calm)
        if m[KNOWN] >= _FEWEST and t - m[SINCE] >= numbers[SETTLE_S]:
            m[MODE] = RESTING
    elif m[MODE] == RESTING:
        best = np.empty(10)
        whole = watch(t, y, noise, load, m[USED], prior, calm, ramps, best)
        if whole > threshold(numbers[ALARM_S], t - m[USED], not np.isnan(noise[2])):
            m[MODE] = SLIPPING
            set_off(t, best, calm[P], moved)
            calm[ENERGY] = max(calm[ENERGY] - best[9], 0.0)  # the slip's part of the scatter is explained
            note[WHEN] = best[0]
            note[VELOCITY : VELOCITY + 3] = best[4:7]
            if np.isnan(noise[2]):
                note[VELOCITY + 2] = np.nan
    else:
        scaled = scale(calm)
        rest = np.empty(5)
        turns = not np.isnan(noise[2]) and moved[TURNED] == 0.0
        if not turns:  # what it turned by in between is lost
            moved[TURNED], noise[2] = 1.0, np.nan
        noise *= scaled
        odds = slide(t, y, noise, scaled * variance, m[USED], moved, stops, rest)
        if odds > _STOPS and moved[DOUBT] == 0.0:
            moved[DOUBT] = 1.0
            note[WHEN] = rest[0]
            lasted = max(rest[0] - moved[BEGAN], 1e-9)
            for axis in range(3):
                note[VELOCITY + axis] = (rest[1 + axis] - moved[FROM + axis]) / lasted
            if not turns:
                note[VELOCITY + 2] = np.nan
        elif odds < 1.0 / _STOPS and moved[DOUBT] > 0.0:
            moved[DOUBT] = 0.0
            note[VELOCITY : VELOCITY + 3] = moved[SPEED : SPEED + 3]
            if not turns:
                note[VELOCITY + 2] = np.nan
        if odds > _SURE:
            m[MODE] = RESTING
            settle(rest[1:4], rest[4], load, prior, calm)
            if not turns:
                calm[TURNS] = 0.0


@kernel
def _sense(t: float, sigmas: float, numbers: Floats, m: Floats, note: Floats) -> None:
    """One scan of a method without direction: a scan alarms if chance does so more seldom than was asked for."""
    chance = erfc(sigmas / np.sqrt(2.0))
    if m[MODE] == SLIPPING:
        if sigmas < _CALM_SIGMAS:
            m[MODE] = RESTING
            note[WHEN] = t
    elif t - m[SINCE] >= numbers[SETTLE_S] and chance < (t - m[LAST]) / numbers[ALARM_S]:
        m[MODE] = SLIPPING
        note[WHEN] = t
