"""What a scan should be, by the patterns and the motion known before it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.online.residual_process import fades
from taxelflow.estimation.template.online.track_state import Track
from taxelflow.numerics.bspline import evaluate, pose_part, state_of
from taxelflow.numerics.records import record

if TYPE_CHECKING:
    from taxelflow.estimation.template.online.track_state import Hand, Patterns
    from taxelflow.messages import Floats
    from taxelflow.numerics.records import Records

_NOISES = 4.0
"""A step is more than its noise if its square is more than this many variances."""


def expected(maps: Patterns, hand: Hand, tracks: Records, t_s: float | None) -> Floats:
    """(entries,) readings by the patterns at the states, moved on to t_s if given.

    Off its lattice a pattern has no pressure; a pad without one is NaN.
    """
    readings = np.full(hand.places.shape[1], np.nan)
    for pad in np.flatnonzero(tracks["active"]):
        m: Track = record(Track, tracks, int(pad))
        own = slice(int(hand.starts[pad]), int(hand.starts[pad + 1]))
        state, span = m.state.copy(), 0.0
        if t_s is not None:
            span = t_s - m.last_t
            state += np.append(span * _surely(m), [0.0, 0.0])
        values = np.empty((own.stop - own.start, 5))
        where = np.ascontiguousarray(hand.places[:, own])
        evaluate(maps.patterns[pad], m.lattice.copy(), where, state, np.zeros((3, 0)), values)
        rest = maps.rests[3, own]
        if t_s is not None and m.carries:
            rest = fades(span, span * np.hypot(m.speed[0], m.speed[1])) * maps.rests[0, own]
        readings[own] = np.maximum(state_of(state).gain * np.maximum(np.nan_to_num(values[:, 0]), 0.0) + rest, 0.0)
    return readings


def _surely(m: Track) -> Floats:
    """(3,), speeds of the last step as far as it was more than its noise."""
    noise = 2.0 / np.maximum(pose_part(np.diagonal(m.step)), 1e-9)
    squared = np.maximum((m.speed * m.span) ** 2, 1e-12)
    surely: Floats = m.speed * np.maximum(1.0 - _NOISES * noise / squared, 0.0)
    return surely
