"""Scan after scan of one pad: each registered on the one before, steps added up to a pose."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.estimation.scan_matching.matching import DOF, carried, find, gains, sight, surroundings, weigh
from taxelflow.messages import AMBIGUOUS, LOST, OK, UNRESOLVED
from taxelflow.numerics.banded import solve_band
from taxelflow.numerics.bspline import GAIN, STATE, THETA, evaluate, gather
from taxelflow.numerics.centroid import loaded_centroid
from taxelflow.numerics.robust import gate
from taxelflow.numerics.small_linalg import eigenvalues2

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats

# Memory of a pad: whether there is a scan to register on, its time, the pose (pitches, rad), whether its turn is not
# yet seen, seen, or lost sight of, the pose's covariance, and the way since the contact began.
RUN, LAST, POSE, TURN, COVARIANCE, WAY, MEMORY = 0, 1, 2, 5, 6, 15, 18
_NOT_YET, _SEEN, _GONE = 0.0, 1.0, 2.0
_SIGHT, _STILL_SIGHT = 4.0, 2.0
"""A turn is seen if the pattern tells it so many times better than noise would pretend; it stays seen down to the
second."""
_SURE_RAD = 0.1
"""... and if its standard deviation is below this. What noise does not explain of a scan counts as more noise."""
_SCALE_ERROR = 0.03
"""Standard deviation of the share by which steps are too long or too short: a spline through taxels is too flat between
them, by 1 % for waves of six pitches and 4 % for waves of four."""
_BLURRED = 0.25
"""Standard deviation of a position, in pitches, above which its direction is not seen."""


@kernel
def follow(  # noqa: PLR0912, PLR0915  one loop, as a kernel must be
    t: Floats,
    readings: Floats,
    noise: Floats,
    ceiling: Floats,
    contact: Bools,
    complete: Bools,
    cut_off: Bools,
    pitch_m: float,
    places: Floats,
    lattice: Floats,
    first: NDArray[np.int64],
    weight: Floats,
    factor: Floats,
    trust: Floats,
    noise_doubt: Floats,
    blind: Bools,
    across: Floats,
    memory: Floats,
    before: Floats,
    variance_before: Floats,
    c: Floats,
    gains_before: Floats,
    pose: Floats,
    covariance: Floats,
    displacement: Floats,
    displacement_covariance: Floats,
    span: Floats,
    quality: NDArray[np.uint8],
) -> None:
    """Fill pose ... quality (scans, ...) of one pad, which come in as NaN and 0.

    readings: (scans, taxels). contact, complete, cut_off: (scans,). places: (2, taxels) in pitches. lattice ... across:
    `Interpolant`. memory (MEMORY,), before and variance_before (taxels,), c (ny, nx), gains_before (3, taxels): kept
    from scan to scan.
    """
    taxels = len(noise)
    m, p = memory, memory[POSE : POSE + 3]
    P = memory[COVARIANCE:WAY].reshape((3, 3))
    way = memory[WAY:]
    chosen = np.empty(taxels, np.bool_)
    middle, middle_before = np.empty(4), np.empty(4)
    anywhere = np.zeros(taxels, np.bool_)  # where the border is does not matter to it
    state = np.empty(STATE)
    normal, pretended = np.empty((DOF, DOF)), np.empty((DOF, DOF))
    unit = np.array([pitch_m, pitch_m, 1.0])
    local = lattice.copy()
    for k in range(len(t)):
        if not contact[k]:
            m[RUN] = 0.0
            continue
        now = readings[k].copy()
        variance = noise * noise
        if not complete[k]:
            missing = False
            for i in range(taxels):
                if now[i] == 0.0:
                    missing = missing or noise[i] > 0.0
                    variance[i] = 0.0
            if not missing and m[RUN] != 0.0:  # a gap in time: nobody knows what the object did
                m[RUN], quality[k] = 0.0, LOST
                continue
        fresh = m[RUN] == 0.0
        if fresh:
            if not complete[k]:
                continue
            loaded_centroid(now, variance, places, anywhere, middle)
            p[0], p[1], p[2] = middle[0], middle[1], 0.0
            m[TURN] = _NOT_YET
            way[:] = 0.0
            refresh(now, first, weight, factor, trust, c)
            before[:], variance_before[:] = now, variance
            gains_before[:] = 0.0
        count = surroundings(before, now, variance_before, variance, places, chosen)
        own = np.flatnonzero(chosen)
        where = np.empty((2, count))
        y, v, top = now[own], variance[own], ceiling[own]
        peak = 0.0
        total = total_before = 0.0
        for i in range(taxels):
            peak = max(peak, before[i])
            if variance[i] > 0.0 and variance_before[i] > 0.0:
                total += now[i]
                total_before += before[i]
        for j in range(count):
            where[0, j], where[1, j] = places[0, own[j]] - p[0], places[1, own[j]] - p[1]
        local[1], local[2] = lattice[1] - p[0], lattice[2] - p[1]
        unsure = hidden(before, variance_before, ceiling, blind, lattice, places, noise)
        doubt = np.where(unsure, peak * peak, noise_doubt)
        model, weights = np.empty(count), np.empty(count)
        jacobian = np.zeros((count, DOF))
        turns = m[TURN] != _GONE and not across.any()
        gain = total / total_before if total > 0.0 and total_before > 0.0 else 1.0
        state[:] = 0.0
        state[GAIN] = 1.0
        if not fresh:
            loaded_centroid(before, variance_before, places, anywhere, middle_before)
            loaded_centroid(now, variance, places, anywhere, middle)
            shift = (middle - middle_before)[:2]
            find(c, doubt, local, where, y, v, top, shift, gain, turns, across, state)
        chi, fit, freedom = weigh(
            c, noise_doubt, unsure, across, local, where, y, v, top, state, model, jacobian, weights, normal, pretended
        )
        g, g_before = np.empty((3, count)), np.zeros((3, taxels))
        if turns:
            enough = _STILL_SIGHT if m[TURN] == _SEEN else _SIGHT
            worse = max(1.0, chi / freedom)
            turns = sight(normal, pretended) > enough * worse
            if turns:
                gains(normal, pretended, jacobian, weights, True, g)
                turns = squared(g, y, v) * worse < _SURE_RAD**2
            if not turns and not fresh:
                find(c, doubt, local, where, y, v, top, shift, gain, False, across, state)
                chi, fit, freedom = weigh(
                    c,
                    noise_doubt,
                    unsure,
                    across,
                    local,
                    where,
                    y,
                    v,
                    top,
                    state,
                    model,
                    jacobian,
                    weights,
                    normal,
                    pretended,
                )
        gains(normal, pretended, jacobian, weights, turns, g)
        g *= np.sqrt(max(1.0, chi / freedom))
        part = np.zeros((3, 3))
        for j in range(count):
            if y[j] != 0.0:
                for a in range(3):
                    for b in range(3):
                        part[a, b] += g[a, j] * g[b, j] * v[j]
        if fresh:
            P[:] = part
        else:
            if m[TURN] == _SEEN and not turns:
                m[TURN] = _GONE
            elif m[TURN] == _NOT_YET and turns:
                m[TURN] = _SEEN
            carried(c.shape, local, where, state, g, first, weight, factor, trust, g_before)
            for a in range(3):
                for b in range(3):
                    mine = mixed = 0.0
                    for i in range(taxels):
                        if before[i] != 0.0:
                            mine += g_before[a, i] * g_before[b, i] * variance_before[i]
                            mixed += gains_before[a, i] * g_before[b, i] * variance_before[i]
                            mixed += gains_before[b, i] * g_before[a, i] * variance_before[i]
                    displacement_covariance[k, a, b] = (part[a, b] + mine) * unit[a] * unit[b]
                    P[a, b] += part[a, b] + mine - mixed
            for a in range(3):
                displacement[k, a] = state[a] * unit[a]
                p[a] += state[a]
                way[a] += state[a]
            if not turns:
                displacement[k, 2] = np.nan
                displacement_covariance[k, 2, :] = np.nan
                displacement_covariance[k, :, 2] = np.nan
            span[k] = t[k] - m[LAST]
        for a in range(3):
            pose[k, a] = p[a] * unit[a]
            for b in range(3):
                covariance[k, a, b] = (P[a, b] + _SCALE_ERROR**2 * way[a] * way[b]) * unit[a] * unit[b]
        if m[TURN] != _SEEN and not (fresh and turns):
            pose[k, 2] = np.nan
            covariance[k, 2, :] = np.nan
            covariance[k, :, 2] = np.nan
        for a in range(2):
            if across[a] > 0.0:
                covariance[k, a, a] = (across[a] * pitch_m) ** 2
                displacement_covariance[k, a, a] = np.nan if fresh else 2.0 * covariance[k, a, a]
                part[a, a] = across[a] ** 2
        xx, yy, xy = part[0, 0], part[1, 1], part[0, 1]
        _, largest = eigenvalues2(xx, yy, xy)
        quality[k] = AMBIGUOUS if cut_off[k] or largest > _BLURRED**2 else OK
        if fit > freedom * gate(1.0, freedom):
            quality[k] = UNRESOLVED
        gains_before[:] = 0.0
        for j in range(count):
            for a in range(3):
                gains_before[a, own[j]] = g[a, j]
        if not fresh:
            if not complete[k]:
                fill_in(c, local, places, p - state[: THETA + 1], noise, variance, state, now)
            refresh(now, first, weight, factor, trust, c)
            before[:], variance_before[:] = now, variance
        m[RUN], m[LAST] = 1.0, t[k]


@kernel
def squared(g: Floats, y: Floats, v: Floats) -> float:
    """Variance of the turn from the later scan's noise."""
    total = 0.0
    for j in range(len(y)):
        if y[j] != 0.0:
            total += g[2, j] * g[2, j] * v[j]
    return total


@kernel
def fill_in(
    c: Floats,
    lattice: Floats,
    places: Floats,
    origin: Floats,
    noise: Floats,
    variance: Floats,
    state: Floats,
    now: Floats,
) -> None:
    """Put what the model expects into a scan's missing readings, so that the next one finds no dip there."""
    missing = np.flatnonzero((variance == 0.0) & (noise > 0.0))
    where, slopes = np.empty((2, len(missing))), np.empty((len(missing), 5))
    for j in range(len(missing)):
        where[0, j], where[1, j] = places[0, missing[j]] - origin[0], places[1, missing[j]] - origin[1]
    evaluate(c, lattice, where, state, np.zeros((1, 2)), np.zeros((3, 0)), slopes)
    for j in range(len(missing)):
        if not np.isnan(slopes[j, 0]):
            now[missing[j]] = state[GAIN] * slopes[j, 0]


@kernel
def refresh(now: Floats, first: NDArray[np.int64], weight: Floats, factor: Floats, trust: Floats, c: Floats) -> None:
    """Make c (ny, nx) the spline through readings (taxels,)."""
    right = np.zeros((1, c.size))
    gather(first, weight, (now * trust).reshape((1, -1)), c.shape[1], right)
    solve_band(factor, right)
    c[:] = right.reshape(c.shape)


@kernel
def hidden(
    before: Floats,
    variance_before: Floats,
    ceiling: Floats,
    blind: Bools,
    lattice: Floats,
    places: Floats,
    noise: Floats,
) -> Bools:
    """(ny, nx): knots at which the earlier scan knows nothing, because no taxel is there, or not then, or saturated."""
    unknown = blind.copy()
    for i in range(len(before)):
        if noise[i] > 0.0 and (variance_before[i] == 0.0 or before[i] >= ceiling[i]):
            ix = int(np.round((places[0, i] - lattice[1]) / lattice[0]))
            iy = int(np.round((places[1, i] - lattice[2]) / lattice[0]))
            unknown[iy, ix] = True
    return unknown
