"""Normal equations of bundle adjustment: each reading's information on its coefficients and its scan's state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from taxelflow.estimation.template.depth import Touch, add_tilt, touch
from taxelflow.estimation.template.map import Surface
from taxelflow.estimation.template.observations import Readings
from taxelflow.messages import Floats
from taxelflow.numerics.banded import WIDTH, add_square
from taxelflow.numerics.bspline import KNOTS, STATE, State, evaluate, knot_of, put, spread, state_of
from taxelflow.numerics.robust import OUTLIER, huber_weight
from taxelflow.runtime.compiling import lean_kernel, long_kernel

FIT_HUBER = 4.0
"""Standard deviations above which a reading weighs less in a fit (Huber)."""


class Normal(NamedTuple):
    """The problem, linearised at a pattern and states; `assemble` fills it.

    first, weight, slope, w, residual, model: (scans, taxels, ...), per reading: its first knot, its weights by
    coefficient (16,) and slopes by state (5,), both with the gain in, its own weight, its residual, and
    the model. stencil, right: of the coefficients. blocks, gradient: (scans, 5, 5), (scans, 5) of the states. chi,
    counts: (scans,), robust chi-square and the readings in it.
    """

    first: NDArray[np.int64]
    weight: Floats
    slope: Floats
    w: Floats
    residual: Floats
    model: Floats
    stencil: Floats
    right: Floats
    blocks: Floats
    gradient: Floats
    chi: Floats
    counts: NDArray[np.int64]

    @classmethod
    def empty(cls, scans: int, taxels: int, knots: int) -> Normal:
        """Room for a problem of this size."""
        return cls(
            np.empty((scans, taxels), np.int64),
            np.empty((scans, taxels, KNOTS)),
            np.empty((scans, taxels, STATE)),
            np.empty((scans, taxels)),
            np.empty((scans, taxels)),
            np.empty((scans, taxels)),
            np.empty((knots, WIDTH, 2 * WIDTH - 1)),
            np.empty(knots),
            np.empty((scans, STATE, STATE)),
            np.empty((scans, STATE)),
            np.empty(scans),
            np.empty(scans, np.int64),
        )


@long_kernel
def assemble(surface: Surface, readings: Readings, states: Floats, free: Floats, level: float, out: Normal) -> None:
    """Linearise at states (scans, 5). free: (5,), 1 of those that may move, 0 of others. level: the contact's largest
    reading if the surface is one of heights and the size of a state a depth, else 0; see `depth`.
    """
    c, places, nx = surface.c, readings.places, surface.c.shape[1]
    value, at = np.empty((places.shape[1], 5)), np.empty(STATE)
    out.stencil[:], out.right[:], out.blocks[:], out.gradient[:] = 0.0, 0.0, 0.0, 0.0
    for k in range(len(states)):
        first, weight, slope = out.first[k], out.weight[k], out.slope[k]
        x, y, theta, gain, depth = state_of(states[k])
        put(State(x, y, theta, gain, 0.0 if level > 0.0 else depth), at)
        spread(c.shape, surface.lattice, places, at, readings.bends[k], first, weight)
        evaluate(c, surface.lattice, places, at, readings.bends[k], value)
        out.chi[k] = 0.0
        out.counts[k] = 0
        for i in range(places.shape[1]):
            reading, variance = readings.value[k, i], readings.variance[k, i]
            out.w[k, i] = out.residual[k, i] = out.model[k, i] = 0.0
            if first[i] < 0 or variance == 0.0 or np.isnan(value[i, 0]):
                continue
            q, by_x, by_y, by_theta, by_size = value[i]
            read = touch(q + depth * level, -by_x, -by_y, level) if level > 0.0 else Touch(q, 1.0, 0.0, 0.0)
            expected = gain * read.mean
            difference = reading - expected
            out.model[k, i], out.residual[k, i] = expected, difference
            if reading == 0.0 and expected <= 0.0:  # the sensor clips there
                continue
            if reading >= readings.ceiling[i] and difference < 0.0:
                continue
            factor = 1.0 / variance
            z = abs(difference) * np.sqrt(factor)
            out.chi[k] += min(z * z, OUTLIER)
            out.counts[k] += 1
            factor *= huber_weight(z, FIT_HUBER)
            out.w[k, i] = factor
            rise = gain * read.share
            by_size = level if level > 0.0 else by_size
            put(State(rise * by_x, rise * by_y, rise * by_theta, read.mean, rise * by_size), slope[i])
            for a in range(KNOTS):
                weight[i, a] *= rise
            if 0.0 < read.share < 1.0:
                place, turn = place_of(places, readings.bends[k], states[k], i)
                tilt = gain * read.along_x, gain * read.along_y
                add_tilt(c, surface.lattice, place, turn, tilt, weight[i], slope[i])
            for a in range(STATE):
                slope[i, a] *= free[a]
            add_square(first[i], weight[i], factor, difference, nx, out.stencil, out.right)
            _add_state(slope[i], factor, difference, out.blocks[k], out.gradient[k])


@lean_kernel
def place_of(places: Floats, bend: Floats, state: Floats, taxel: int) -> tuple[tuple[float, float], float]:
    """Where a taxel is from the object, along the pad, and the object's turn, when it is read; see `evaluate`."""
    x, y, turn, _, _ = state_of(state)
    dx, dy = places[0, taxel] - x, places[1, taxel] - y
    if bend.shape[1]:
        return (dx - bend[0, taxel], dy - bend[1, taxel]), turn + bend[2, taxel]
    return (dx, dy), turn


@lean_kernel
def _add_state(slope: Floats, factor: float, difference: float, block: Floats, gradient: Floats) -> None:
    """Add the information of one reading on its scan's state."""
    for a in range(STATE):
        gradient[a] += factor * slope[a] * difference
        for b in range(STATE):
            block[a, b] += factor * slope[a] * slope[b]


@long_kernel
def to_knots(step: Floats, normal: Normal, nx: int, out: Floats) -> None:
    """Add to out (knots,) what steps of the states (scans, 5) do to the coefficients' equations."""
    for k in range(normal.first.shape[0]):
        for i in range(normal.first.shape[1]):
            if normal.w[k, i] == 0.0:
                continue
            pull = 0.0
            for a in range(STATE):
                pull += normal.slope[k, i, a] * step[k, a]
            pull *= normal.w[k, i]
            for a in range(KNOTS):
                out[knot_of(normal.first[k, i], a, nx)] += pull * normal.weight[k, i, a]


@long_kernel
def to_states(knots: Floats, normal: Normal, nx: int, out: Floats) -> None:
    """Add to out (scans, 5) what steps of the coefficients (knots,) do to the states' equations."""
    for k in range(normal.first.shape[0]):
        for i in range(normal.first.shape[1]):
            if normal.w[k, i] == 0.0:
                continue
            pull = 0.0
            for a in range(KNOTS):
                pull += knots[knot_of(normal.first[k, i], a, nx)] * normal.weight[k, i, a]
            pull *= normal.w[k, i]
            for a in range(STATE):
                out[k, a] += pull * normal.slope[k, i, a]
