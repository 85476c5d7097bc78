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
from taxelflow.numerics.bspline import KNOTS, STATE, State, add_around, evaluate, put, spread, state_of, sum_around
from taxelflow.numerics.robust import OUTLIER, huber_weight
from taxelflow.runtime.compiling import inlined, lean_kernel, long_kernel

FIT_HUBER = 4.0
"""Standard deviations above which a reading weighs less in a fit (Huber)."""


class Normal(NamedTuple):
    """The problem, linearised at a pattern and states; `assemble` fills it.

    Of the n readings that count, scan after scan: start: (scans + 1,), the first one of each scan; first: (n,), first
    knot; weight: (n, 16), by coefficient, and pull: (n, 5), by state, times the reading's own weight, both with the
    gain in. There is room for all. w, residual, model: (scans, taxels), own weight, 0 where a reading does not count,
    residual, and the model. stencil, right: of the coefficients. blocks, gradient: (scans, 5, 5), (scans, 5) of the
    states. chi, counts: (scans,), robust chi-square and the readings in it.
    """

    start: NDArray[np.int64]
    first: NDArray[np.int64]
    weight: Floats
    pull: Floats
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
            np.empty(scans + 1, np.int64),
            np.empty(scans * taxels, np.int64),
            np.empty((scans * taxels, KNOTS)),
            np.empty((scans * taxels, STATE)),
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
    taxels, row = places.shape[1], 0
    value, at, slope, slopes = np.empty((taxels, 5)), np.empty(STATE), np.empty(STATE), np.zeros((STATE, taxels))
    first, weights = np.empty(taxels, np.int64), np.empty((taxels, KNOTS))
    out.stencil[:], out.right[:] = 0.0, 0.0
    for k in range(len(states)):
        out.start[k] = row
        x, y, theta, gain, depth = state_of(states[k])
        put(State(x, y, theta, gain, 0.0 if level > 0.0 else depth), at)
        spread(c.shape, surface.lattice, places, at, readings.bends[k], first, weights)
        evaluate(c, surface.lattice, places, at, readings.bends[k], value)
        out.chi[k] = 0.0
        out.counts[k] = 0
        for i in range(taxels):
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
            rise = gain * read.share
            by_size = level if level > 0.0 else by_size
            put(State(rise * by_x, rise * by_y, rise * by_theta, read.mean, rise * by_size), slope)
            weight = out.weight[row]
            for a in range(KNOTS):
                weight[a] = rise * weights[i, a]
            if 0.0 < read.share < 1.0:
                place, turn = place_of(places, readings.bends[k], states[k], i)
                tilt = gain * read.along_x, gain * read.along_y
                add_tilt(c, surface.lattice, place, turn, tilt, weight, slope)
            for a in range(STATE):
                slopes[a, i] = free[a] * slope[a]
                out.pull[row, a] = factor * slopes[a, i]
            out.w[k, i], out.first[row] = factor, first[i]
            add_square(first[i], weight, factor, difference, nx, out.stencil, out.right)
            row += 1
        _sum_states(out.w[k], slopes, out.residual[k], out.blocks[k], out.gradient[k])
    out.start[len(states)] = row


@lean_kernel
def place_of(places: Floats, bend: Floats, state: Floats, taxel: int) -> tuple[tuple[float, float], float]:
    """Where a taxel is from the object, along the pad, and the object's turn, when it is read; see `evaluate`."""
    x, y, turn, _, _ = state_of(state)
    dx, dy = places[0, taxel] - x, places[1, taxel] - y
    if bend.shape[1]:
        return (dx - bend[0, taxel], dy - bend[1, taxel]), turn + bend[2, taxel]
    return (dx, dy), turn


@lean_kernel
def _sum_states(w: Floats, slopes: Floats, residual: Floats, block: Floats, gradient: Floats) -> None:
    """Fill the information (5, 5) of a scan's readings on its state, and the gradient (5,). slopes: (5, taxels)."""
    for a in range(STATE):
        gradient[a] = _weighted(w, slopes[a], residual)
        for b in range(a, STATE):
            block[a, b] = block[b, a] = _weighted(w, slopes[a], slopes[b])


@inlined
def _weighted(w: Floats, one: Floats, other: Floats) -> float:
    """Sum of products with weights w, (taxels,) each."""
    total = 0.0
    for i in range(len(w)):
        total += w[i] * one[i] * other[i]
    return total


@long_kernel
def to_knots(step: Floats, normal: Normal, nx: int) -> Floats:
    """(knots,), what steps of the states (scans, 5) do to the coefficients' equations."""
    out = np.zeros(len(normal.right))
    for k in range(len(step)):
        x, y, theta, gain, size = state_of(step[k])
        for i in range(np.uint64(normal.start[k]), np.uint64(normal.start[k + 1])):
            own = state_of(normal.pull[i])
            pull = own.x * x + own.y * y + own.theta * theta + own.gain * gain + own.size * size
            add_around(pull, normal.weight[i], normal.first[i], nx, out)
    return out


@long_kernel
def to_states(knots: Floats, normal: Normal, nx: int) -> Floats:
    """(scans, 5), what steps of the coefficients (knots,) do to the states' equations."""
    out = np.empty(normal.gradient.shape)
    for k in range(len(out)):
        x = y = theta = gain = size = 0.0
        for i in range(np.uint64(normal.start[k]), np.uint64(normal.start[k + 1])):
            own, rise = state_of(normal.pull[i]), sum_around(knots, normal.weight[i], normal.first[i], nx)
            x, y, theta = x + rise * own.x, y + rise * own.y, theta + rise * own.theta
            gain, size = gain + rise * own.gain, size + rise * own.size
        put(State(x, y, theta, gain, size), out[k])
    return out
