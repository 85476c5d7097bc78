"""Faults of a real sensor: cross-talk, relaxation, creep, hysteresis, gains, offsets, noise, dead taxels, resolution.

Each random fault has a generator of its own, so that one of them changes no other random number.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import lfilter

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats
    from taxelflow.sensors.layout import Layout
    from taxelflow.simulation.relief.parameters import SensorFaults

_GAIN, _OFFSET, _NOISE, _DEAD = range(4)
"""Numbers of the generators, beside the seed."""
_PLAYS = np.arange(1, 5) / 8
"""Half-widths of play over the largest reading."""
_LOADED = 0.3
"""Largest reading, over that of all taxels, from which a taxel may be a dead one: others would not be missed."""
_ROW_GROUPS = 5
"""Most rows, or groups of rows, that are read at times of their own."""


def readings(faults: SensorFaults, layout: Layout, pad: int, pressure_pa: Floats, rate_hz: float, seed: int) -> Floats:
    """Readings (scans, taxels) in Pa at full scale `full_scale_pa`, of pressures (scans, taxels) on one pad, in Pa."""
    value = pressure_pa
    if faults.cross_talk:
        value = mixed(value, layout.neighbours(pad), faults.cross_talk)
    if faults.relaxation or faults.creep:
        slow = faults.creep * lagged(value, rate_hz * faults.creep_s)
        slow = slow - faults.relaxation * lagged(value, rate_hz * faults.relaxation_s)
        value = np.maximum(value + slow, 0.0)
    if faults.hysteresis:
        value = value + faults.hysteresis * (with_play(value) - value)
    taxels = value.shape[1]
    gain = 1.0 + faults.gain_spread * _random(seed, _GAIN).standard_normal(taxels)
    gain = np.maximum(gain, 0.0) * ~dead_taxels(faults, value, seed)
    offset = faults.offset_pa + faults.offset_spread_pa * _random(seed, _OFFSET).standard_normal(taxels)
    noise = faults.noise_pa * _random(seed, _NOISE).standard_normal(value.shape)
    return resolved(faults, gain * value + offset + noise)


def resolved(faults: SensorFaults, value_pa: Floats) -> Floats:
    """Readings clipped to 0 and full scale, and rounded to steps of the resolution."""
    clipped: Floats = np.clip(value_pa, 0.0, faults.full_scale_pa)
    if not faults.bits:
        return clipped
    step = faults.full_scale_pa / (2**faults.bits - 1)
    rounded: Floats = np.round(clipped / step) * step
    return rounded


def mixed(value: Floats, pairs: np.ndarray[tuple[int, int], np.dtype[np.int64]], share: float) -> Floats:
    """Values (scans, taxels), to each of which a share of each neighbour's is added. pairs: (pairs, 2), neighbours."""
    spread = np.eye(value.shape[1])
    spread[pairs[:, 0], pairs[:, 1]] = share
    spread[pairs[:, 1], pairs[:, 0]] = share
    return np.asarray(value @ spread, dtype=np.float64)


def lagged(value: Floats, scans: float) -> Floats:
    """Values (scans, taxels) behind a first-order lag with this time constant in scans, from rest at 0 or, where the
    recording starts loaded, from a load that has lasted as long as the time constant.
    """
    keep = float(np.exp(-1 / max(scans, 1e-9)))
    first = (1 - np.exp(-1.0)) * value[:1]
    slow, _ = lfilter([1 - keep], [1, -keep], value, axis=0, zi=keep * first)
    found: Floats = np.asarray(slow, dtype=np.float64)
    return found


def with_play(value: Floats) -> Floats:
    """Mean of plays (scans, taxels) of several widths; at rest under a load that has risen from 0."""
    wide = _PLAYS[:, np.newaxis] * float(value.max(initial=0.0))
    follower = np.zeros((len(_PLAYS), value.shape[1]))
    found = np.empty_like(value)
    for k, now in enumerate(value):
        follower = np.minimum(np.maximum(follower, now - wide), now + wide)
        found[k] = follower.mean(axis=0)
    return found


def dead_taxels(faults: SensorFaults, value: Floats, seed: int) -> Bools:
    """Whether a taxel (taxels,) is dead, drawn from those that are loaded. value: (scans, taxels)."""
    largest = value.max(axis=0, initial=0.0)
    loaded = np.flatnonzero(largest >= _LOADED * largest.max())
    dead = np.zeros(len(largest), dtype=np.bool_)
    dead[_random(seed, _DEAD).permutation(loaded)[: faults.dead]] = True
    return dead


def delays(faults: SensorFaults, layout: Layout, pad: int, rate_hz: float) -> Floats:
    """Time (taxels,) from a scan's stamp to the reading of each taxel of a pad, s.

    As the sensor declares it, else row by row; never more than a few distinct times.
    """
    own = layout.of_pad(pad)
    declared = layout.delay_s[own]
    if declared.any() or not faults.scan_share:
        return declared
    rows = layout.shapes[pad][0]
    groups = min(rows, _ROW_GROUPS)
    delay_s: Floats = (layout.row[own] * groups // rows) / groups * faults.scan_share / rate_hz
    return delay_s


def _random(seed: int, which: int) -> np.random.Generator:
    return np.random.default_rng([seed, 31, which])
