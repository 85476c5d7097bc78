"""Scan-to-map registration: robust Levenberg-Marquardt steps to the state at which a pattern explains a scan best."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taxelflow.estimation.template.linearization import Packed, linearise
from taxelflow.estimation.template.map import Surface
from taxelflow.messages import Floats
from taxelflow.numerics.bspline import STATE, State, put, state_of
from taxelflow.numerics.rounding import NEGLIGIBLE
from taxelflow.numerics.small_linalg import copy_matrix, factor5, mirror, solved5
from taxelflow.runtime.compiling import kernel, lean_kernel


class _Steps(NamedTuple):
    """Steps, and when they end."""

    enough: float = 1e-2
    """A step that lowers chi-square by less is the last, and is not evaluated: it is a tenth of a standard deviation,
    and the next one would be about a hundredth of that."""
    least_gain: float = 0.1
    """Least ratio of the gain after a step to that before."""
    first: float = 1e-4
    least: float = 1e-7
    most: float = 1e4
    """Damping, relative to the diagonal: at first, at least, and the one at which iterations end."""


_STEPS = _Steps()
HELD = 1e12
"""Prior information of a component of the state that is held at its prior."""
FREE = 1e-6
"""Prior information on a place that may be anywhere: 1 / pitch^2."""
MAY_BE_HELD = tuple(part for part, name in enumerate(State._fields) if name != "gain")
"""Components of the state that may be held."""
ROOM = STATE + 4
"""Rows of five numbers that a registration needs as workspace: a matrix and four vectors."""


class Prior(NamedTuple):
    """Prior of a state: mean (5,), and information (5,), 1 / variance; a component with `HELD` or more is fixed."""

    mean: Floats
    precision: Floats


@kernel
def register(
    surface: Surface,
    taxels: Packed,
    prior: Prior,
    huber: float,
    iterations: int | np.int64,
    state: Floats,
    information: Floats,
) -> tuple[float, float, int]:
    """Refine state (5,) so that the pattern explains one scan; information (5, 5) becomes J^T W J with the prior.

    taxels: the scan, from `linearization.pack_scan`; a masked taxel does not count, a saturated reading only as far
    as the model lies below it. huber: standard deviations above which a reading weighs less. Returns the cost
    (robust -2 log likelihood with prior, of the readings off the lattice, too; the pattern's doubt counts where it
    explains a reading), chi-square, and how many readings that is over: those on the lattice, and loads off it.
    """
    return refine_state(surface, taxels, prior, huber, iterations, state, information, np.empty((ROOM, STATE)))


@lean_kernel
def refine_state(
    surface: Surface,
    taxels: Packed,
    prior: Prior,
    huber: float,
    iterations: int | np.int64,
    state: Floats,
    information: Floats,
    room: Floats,
) -> tuple[float, float, int]:
    """`register`, with room (`ROOM`, 5) to work in."""
    _hold(prior, state)
    damping, best, best_chi, count = _STEPS.first, np.inf, 0.0, 0
    normal, right, best_right, step, kept = room[:STATE], room[5], room[6], room[7], room[8]
    put(state_of(state), kept)
    for _ in range(iterations):
        cost, chi, used = linearise(surface, taxels, huber, state, normal, right)
        cost += _add_prior(prior, state, normal, right)
        if cost <= best:
            gained = best - cost
            best, best_chi, count = cost, chi, used
            for a in range(STATE):
                kept[a], best_right[a] = state[a], right[a]
            copy_matrix(normal, information)
            damping = max(damping * 0.2, _STEPS.least)
            if gained < _STEPS.enough:
                break
        else:
            damping = max(damping * 20.0, 1e-3)
            if damping > _STEPS.most:
                break
        factor = factor5(information, damping, NEGLIGIBLE)
        if not factor.positive:
            break
        r = best_right
        step[0], step[1], step[2], step[3], step[4] = solved5(factor, r[0], r[1], r[2], r[3], r[4])
        lowered = 0.0
        for a in range(STATE):
            lowered += step[a] * best_right[a]
            state[a] = kept[a] + step[a]
        x, y, theta, gain, size = state_of(state)
        gain = max(gain, _STEPS.least_gain * state_of(kept).gain)  # pressure does not pull
        put(State(x, y, theta, gain, size), state)
        if lowered < _STEPS.enough:
            best -= lowered
            put(state_of(state), kept)
            break
    put(state_of(kept), state)
    mirror(information)
    return best, best_chi, count


@lean_kernel
def _hold(prior: Prior, state: Floats) -> None:
    """Put what is held where it stays."""
    for part in MAY_BE_HELD:
        if prior.precision[part] >= HELD:
            state[part] = prior.mean[part]


@lean_kernel
def _add_prior(prior: Prior, state: Floats, normal: Floats, right: Floats) -> float:
    """Add the prior to the normal equations, from which what is held drops out; its cost."""
    for part in MAY_BE_HELD:
        if prior.precision[part] >= HELD:
            right[part] = 0.0
            for a in range(STATE):
                normal[max(a, part), min(a, part)] = 0.0
    cost = 0.0
    for a in range(STATE):
        off = state[a] - prior.mean[a]
        cost += prior.precision[a] * off * off
        right[a] -= prior.precision[a] * off
        normal[a, a] += prior.precision[a]
    return cost
