"""What a scan should be, by the patterns and the motion known before it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.online import track_state as online
from taxelflow.estimation.template.online.residual_process import fades
from taxelflow.numerics.bspline import GAIN, THETA, evaluate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Floats

_NOISES = 4.0
"""A step is more than its noise if its square is more than so many variances."""


def expected(
    patterns: Floats,
    memory: Floats,
    states: Floats,
    steps: Floats,
    rests: Floats,
    places: Floats,
    starts: NDArray[np.int64],
    t_s: float | None,
) -> Floats:
    """(entries,) readings by the patterns (pads, rows, cols) at the states (pads, 5), moved on to t_s if given.

    See `follow.follow` for the arrays. Off its lattice a pattern has no pressure; a pad without one is NaN.
    """
    readings = np.full(places.shape[1], np.nan)
    for pad in np.flatnonzero(memory[:, online.ACTIVE]):
        m, own = memory[pad], slice(int(starts[pad]), int(starts[pad + 1]))
        state = states[pad].copy()
        if t_s is not None:
            state[: THETA + 1] += (t_s - m[online.LAST_T]) * _surely(m, steps[pad])
        values = np.empty((own.stop - own.start, 5))
        where, lattice = np.ascontiguousarray(places[:, own]), m[online.SPACING : online.LOW + 1]
        evaluate(patterns[pad], lattice, where, state, np.zeros((1, 2)), np.zeros((3, 0)), values)
        rest = rests[3, own]
        if t_s is not None and m[online.CARRIES]:
            span = t_s - m[online.LAST_T]
            rest = fades(span, span * np.hypot(m[online.SPEED_X], m[online.SPEED_Y])) * rests[0, own]
        readings[own] = np.maximum(state[GAIN] * np.maximum(np.nan_to_num(values[:, 0]), 0.0) + rest, 0.0)
    return readings


def _surely(m: Floats, information: Floats) -> Floats:
    """(3,), speeds of the last step as far as it was more than its noise; information (5, 5) of the step."""
    speed: Floats = m[online.SPEED_X : online.SPEED_T + 1].copy()
    noise = 2.0 / np.maximum(np.diagonal(information)[: THETA + 1], 1e-9)
    squared = np.maximum((speed * m[online.SPAN]) ** 2, 1e-12)
    surely: Floats = speed * np.maximum(1.0 - _NOISES * noise / squared, 0.0)
    return surely
