"""The forward model of a stream: readings that map, state and motion predict."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.online.hand import places_of
from taxelflow.estimation.template.online.track_state import Track
from taxelflow.numerics.bspline import STATE, evaluate, state_of
from taxelflow.numerics.records import record

if TYPE_CHECKING:
    from taxelflow.estimation.template.online.hand import Hand, Patterns
    from taxelflow.messages import Floats
    from taxelflow.numerics.records import Records


def expected(maps: Patterns, hand: Hand, tracks: Records) -> Floats:
    """(entries,) readings of the last scan by the patterns at its states, with what was carried over to it.

    Off its lattice a pattern has no pressure; a pad without one is NaN.
    """
    readings = np.full(len(hand.edge), np.nan)
    for pad in np.flatnonzero(tracks["active"]):
        own, m = _part(hand, int(pad)), record(Track, tracks, int(pad))
        readings[own] = np.maximum(_pressure(maps, hand, int(pad), m, m.state) + maps.rests[3, own], 0.0)
    return readings


def change(maps: Patterns, hand: Hand, tracks: Records, t_s: float) -> Floats:
    """(entries,) by how much readings change until t_s if each object goes on, as much of its step as usually does.

    A pad without a pattern is NaN.
    """
    readings = np.full(len(hand.edge), np.nan)
    for pad in np.flatnonzero(tracks["active"]):
        m = record(Track, tracks, int(pad))
        then = m.state.copy()
        then[:3] += (t_s - m.last_t) * _persistent(m) * m.speed
        now, then = (_pressure(maps, hand, int(pad), m, state) for state in (m.state, then))
        readings[_part(hand, int(pad))] = then - now
    return readings


def _part(hand: Hand, pad: int) -> slice:
    return slice(int(hand.starts[pad]), int(hand.starts[pad + 1]))


def _pressure(maps: Patterns, hand: Hand, pad: int, m: Track, state: Floats) -> Floats:
    """(taxels,), by the pattern at a state (5,)."""
    where = places_of(hand, pad)
    values = np.empty((where.shape[1], STATE))
    evaluate(maps.patterns[pad], m.lattice.copy(), where, state.copy(), np.zeros((3, 0)), values)
    pressure: Floats = state_of(state).gain * np.maximum(np.nan_to_num(values[:, 0]), 0.0)
    return pressure


def _persistent(m: Track) -> float:
    """Share of a step that the next one has been on average, from 0 to 1: noise reverses, motion goes on."""
    return float(np.clip(m.persistence[0] / m.persistence[1], 0.0, 1.0)) if m.persistence[1] > 0.0 else 0.0
