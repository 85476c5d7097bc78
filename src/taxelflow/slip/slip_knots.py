"""Where the velocity of a slip changes: knots of a linear spline, added one by one while a criterion falls.

The sums over any segment come from running sums over the scans, so that a trial costs nothing per scan. Its normal
equations are banded, as the hat functions of a linear spline overlap with their neighbours' only.
"""

from __future__ import annotations

from math import inf, log, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from taxelflow.messages import Floats
from taxelflow.runtime.compiling import routine

MOST_SEGMENTS = 12
_MIN_SEGMENT_SCANS = 3
"""A segment has at least this many scans."""
_MOST_CANDIDATES = 24
"""Times at which a further knot is tried, evenly spread over the scans."""


class Sums(NamedTuple):
    """Running sums over scans. weight: (3, scans + 1, axes, axes), of the weight times time to the power 0, 1, 2.
    pull: (2, scans + 1, axes), of weight @ moved times time to the power 0, 1. square: of all, moved @ weight @ moved.
    """

    weight: Floats
    pull: Floats
    square: float


class Scratch(NamedTuple):
    """Room for what is tried. band: (knots * axes, 2 * axes), element [i, d] is (i, i - d) of the lower triangle of the
    normal equations. right: (knots * axes,), their right-hand side. knots, first: as of `place_knots`.
    """

    band: Floats
    right: Floats
    knots: Floats
    first: NDArray[np.int64]


@routine
def room_for(axes: int) -> Scratch:
    """Room for paths of so many coordinates."""
    most = MOST_SEGMENTS + 2
    return Scratch(
        np.zeros((most * axes, 2 * axes)), np.zeros(most * axes), np.zeros(most), np.zeros(most, dtype=np.int64)
    )


@routine
def running_sums(t: Floats, moved: Floats, weight: Floats) -> Sums:
    """Of scans at times t (scans,), moved (scans, axes), with weight (scans, axes, axes)."""
    scans, axes = moved.shape
    weights, pulls, square = np.zeros((3, scans + 1, axes, axes)), np.zeros((2, scans + 1, axes)), 0.0
    for n in range(scans):
        for a in range(axes):
            pulls[0, n + 1, a], pulls[1, n + 1, a] = pulls[0, n, a], pulls[1, n, a]
        for ab in range(axes * axes):
            a, b = ab // axes, ab % axes
            weights[0, n + 1, a, b] = weights[0, n, a, b] + weight[n, a, b]
            weights[1, n + 1, a, b] = weights[1, n, a, b] + weight[n, a, b] * t[n]
            weights[2, n + 1, a, b] = weights[2, n, a, b] + weight[n, a, b] * t[n] * t[n]
            pull = weight[n, a, b] * moved[n, b]
            pulls[0, n + 1, a] += pull
            pulls[1, n + 1, a] += pull * t[n]
            square += pull * moved[n, a]
    return Sums(weights, pulls, square)


@routine
def place_knots(t: Floats, sums: Sums, readings: int, scratch: Scratch, knots: Floats, first: NDArray[np.int64]) -> int:
    """Add knots between the first two; how many there are then. t: (scans,), increasing. knots: (MOST_SEGMENTS + 2,),
    of the same clock. first: of each segment, the number of its first scan; after the last segment the number of scans.
    readings: scans times axes.
    """
    held, best = 2, _criterion(sums, knots, first, 2, readings, scratch)
    while held <= MOST_SEGMENTS:
        room = 0
        for segment in range(held - 1):
            room += _room(first, segment)
        count = min(room, _MOST_CANDIDATES)
        least, chosen = inf, 0
        for candidate in range(count):
            number = candidate * (room - 1) // (count - 1) if room > count else candidate
            _with_another(knots, first, held, number, t, scratch)
            found = _criterion(sums, scratch.knots, scratch.first, held + 1, readings, scratch)
            if found < least:
                least, chosen = found, number
        if not least < best:
            break
        _with_another(knots, first, held, chosen, t, scratch)
        held, best = held + 1, least
        for k in range(held):
            knots[k], first[k] = scratch.knots[k], scratch.first[k]
    return held


@routine
def _room(first: NDArray[np.int64], segment: int) -> int:
    """Scans of a segment at which it can be divided."""
    return max(int(first[segment + 1] - first[segment]) - 2 * _MIN_SEGMENT_SCANS + 1, 0)


@routine
def _with_another(knots: Floats, first: NDArray[np.int64], held: int, number: int, t: Floats, scratch: Scratch) -> None:
    """Fill the scratch with the held knots and one at the scan of this number among those that are possible."""
    segment = 0
    while number >= _room(first, segment):
        number -= _room(first, segment)
        segment += 1
    scan = first[segment] + _MIN_SEGMENT_SCANS + number
    for k in range(held + 1):
        old = k if k <= segment else k - 1
        scratch.knots[k] = knots[old] if k != segment + 1 else t[scan]
        scratch.first[k] = first[old] if k != segment + 1 else scan


@routine
def _criterion(
    sums: Sums, knots: Floats, first: NDArray[np.int64], held: int, readings: int, scratch: Scratch
) -> float:
    """Of Schwarz, with a scale of the noise that is at least 1; infinite where the knots cannot be fitted."""
    chi_square = fit_knots(sums, knots, first, held, scratch)
    if chi_square == inf:
        return inf
    scale = max(chi_square / readings, 1.0)  # the noise is not below what the covariances claim
    return float(readings * log(scale) + chi_square / scale + held * (sums.pull.shape[2] + 1) * log(readings))


@routine
def fit_knots(sums: Sums, knots: Floats, first: NDArray[np.int64], held: int, scratch: Scratch) -> float:
    """Chi-square of the path through the held knots, infinite where they cannot be fitted.

    Leaves in the scratch the Cholesky factor L of the normal equations and inv(L) times their right-hand side.
    """
    band, right = scratch.band, scratch.right
    count = held * sums.pull.shape[2]
    for i in range(count):
        right[i] = 0.0
        for d in range(band.shape[1]):
            band[i, d] = 0.0
    for segment in range(held - 1):
        _add_segment(sums, knots, first, segment, band, right)
    explained = _explained(band, right, count)
    return float(inf if explained == inf else sums.square - explained)


@routine
def _add_segment(
    sums: Sums, knots: Floats, first: NDArray[np.int64], segment: int, band: Floats, right: Floats
) -> None:
    """Add a segment's part of the normal equations: hat functions 1 - u and u, u from 0 to 1 along the segment."""
    axes = sums.pull.shape[2]
    begin, end, start = first[segment], first[segment + 1], knots[segment]
    span = knots[segment + 1] - start
    for a in range(axes):
        i, j = segment * axes + a, (segment + 1) * axes + a
        pull = sums.pull[0, end, a] - sums.pull[0, begin, a]
        rising = (sums.pull[1, end, a] - sums.pull[1, begin, a] - start * pull) / span
        right[i] += pull - rising
        right[j] += rising
        for b in range(axes):
            weight = sums.weight[0, end, a, b] - sums.weight[0, begin, a, b]
            first_moment = sums.weight[1, end, a, b] - sums.weight[1, begin, a, b]
            second_moment = sums.weight[2, end, a, b] - sums.weight[2, begin, a, b]
            up = (first_moment - start * weight) / span
            up_up = (second_moment - 2.0 * start * first_moment + start * start * weight) / (span * span)
            band[j, axes + a - b] += up - up_up
            if b <= a:
                band[i, a - b] += weight - 2.0 * up + up_up
                band[j, a - b] += up_up


@routine
def _explained(band: Floats, right: Floats, count: int) -> float:
    """right @ inverse @ right of the first `count` rows of a banded matrix, infinite if it is not positive definite.

    The matrix becomes its Cholesky factor, right is used up.
    """
    width = band.shape[1]
    explained = 0.0
    for i in range(count):
        low = max(0, i - width + 1)
        for j in range(low, i):
            total = band[i, i - j]
            for k in range(low, j):
                total -= band[i, i - k] * band[j, j - k]
            band[i, i - j] = total / band[j, 0]
        total = band[i, 0]
        for k in range(low, i):
            total -= band[i, i - k] * band[i, i - k]
            right[i] -= band[i, i - k] * right[k]
        if not total > 0.0:
            return inf
        band[i, 0] = sqrt(total)
        right[i] /= band[i, 0]
        explained += right[i] * right[i]
    return explained


@routine
def forward(band: Floats, right: Floats, count: int) -> float:
    """Make the first `count` of right inv(L) right, and return their squared length. band: of `fit_knots`."""
    square = 0.0
    for i in range(count):
        for k in range(max(0, i - band.shape[1] + 1), i):
            right[i] -= band[i, i - k] * right[k]
        right[i] /= band[i, 0]
        square += right[i] * right[i]
    return square


@routine
def backward(band: Floats, right: Floats, count: int) -> None:
    """Make the first `count` of right inv(L)' right. band: of `fit_knots`."""
    for i in range(count - 1, -1, -1):
        for k in range(i + 1, min(count, i + band.shape[1])):
            right[i] -= band[k, k - i] * right[k]
        right[i] /= band[i, 0]
