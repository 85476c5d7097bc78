"""Where the velocity of a slip changes: knots of a linear spline, added one by one while a criterion falls.

The sums over any segment come from running sums over the scans, so that a trial costs nothing per scan. Its normal
equations are banded, as the hat functions of a linear spline overlap with their neighbours' only.
"""

from __future__ import annotations

from math import inf, log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from taxelflow.messages import Floats
from taxelflow.runtime.compiling import kernel, routine

_MOST_SEGMENTS = 12
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


def knots_of(t: Floats, moved: Floats, weight: Floats, start_s: float, end_s: float) -> Floats:
    """(knots,), the dates, and between them times at which the velocity changes, by the information criterion.

    t: (scans,), increasing. moved: (scans, axes). weight: (scans, axes, axes), inverse covariances.
    """
    knots, first = np.zeros(_MOST_SEGMENTS + 2), np.zeros(_MOST_SEGMENTS + 2, np.int64)
    knots[1], first[1] = end_s - start_s, len(t)
    held = place_knots(t - start_s, np.ascontiguousarray(moved), np.ascontiguousarray(weight), knots, first)
    return np.array([start_s, *t[first[1 : held - 1]], end_s])


@kernel
def place_knots(t: Floats, moved: Floats, weight: Floats, knots: Floats, first: NDArray[np.int64]) -> int:
    """Add knots between the first two; how many there are then. first: of each segment, the number of its first scan;
    after the last segment the number of scans.
    """
    sums = _running(t, moved, weight)
    held, best = 2, _criterion(sums, knots, first, 2, moved.size)
    tried, tried_first = knots.copy(), first.copy()
    while held <= _MOST_SEGMENTS:
        room = 0
        for segment in range(held - 1):
            room += _room(first, segment)
        count = min(room, _MOST_CANDIDATES)
        least, chosen = inf, 0
        for candidate in range(count):
            number = candidate * (room - 1) // (count - 1) if room > count else candidate
            _with_another(knots, first, held, number, t, tried, tried_first)
            found = _criterion(sums, tried, tried_first, held + 1, moved.size)
            if found < least:
                least, chosen = found, number
        if not least < best:
            break
        _with_another(knots, first, held, chosen, t, tried, tried_first)
        knots[:], first[:] = tried, tried_first
        held, best = held + 1, least
    return held


@routine
def _room(first: NDArray[np.int64], segment: int) -> int:
    """Scans of a segment at which it can be divided."""
    return max(int(first[segment + 1] - first[segment]) - 2 * _MIN_SEGMENT_SCANS + 1, 0)


@routine
def _with_another(
    knots: Floats,
    first: NDArray[np.int64],
    held: int,
    number: int,
    t: Floats,
    more: Floats,
    more_first: NDArray[np.int64],
) -> None:
    """Fill `more` with the held knots and one at the scan of this number among those that are possible."""
    segment = 0
    while number >= _room(first, segment):
        number -= _room(first, segment)
        segment += 1
    scan = first[segment] + _MIN_SEGMENT_SCANS + number
    for k in range(held + 1):
        if k == segment + 1:
            more[k], more_first[k] = t[scan], scan
        else:
            old = k if k <= segment else k - 1
            more[k], more_first[k] = knots[old], first[old]


@routine
def _running(t: Floats, moved: Floats, weight: Floats) -> Sums:
    scans, axes = moved.shape
    weights, pulls, square = np.zeros((3, scans + 1, axes, axes)), np.zeros((2, scans + 1, axes)), 0.0
    for scan in range(scans):
        at = t[scan]
        for a in range(axes):
            pull = 0.0
            for b in range(axes):
                pull += weight[scan, a, b] * moved[scan, b]
            square += pull * moved[scan, a]
            pulls[0, scan + 1, a] = pulls[0, scan, a] + pull
            pulls[1, scan + 1, a] = pulls[1, scan, a] + pull * at
        weights[0, scan + 1] = weights[0, scan] + weight[scan]
        weights[1, scan + 1] = weights[1, scan] + weight[scan] * at
        weights[2, scan + 1] = weights[2, scan] + weight[scan] * (at * at)
    return Sums(weights, pulls, square)


@routine
def _criterion(sums: Sums, knots: Floats, first: NDArray[np.int64], held: int, readings: int) -> float:
    """Of Schwarz, with a scale of the noise that is at least 1; infinite where the knots cannot be fitted."""
    axes = sums.pull.shape[2]
    count = held * axes
    band, right = np.zeros((count, 2 * axes)), np.zeros(count)  # band[i, d]: element (i, i - d) of the lower triangle
    for segment in range(held - 1):
        _add_segment(sums, knots, first, segment, band, right)
    if not _factor(band):
        return inf
    chi_square = float(sums.square - _explained(band, right))
    scale = max(chi_square / readings, 1.0)  # the noise is not below what the covariances claim
    return float(readings * log(scale) + chi_square / scale + held * (axes + 1) * log(readings))


@routine
def _add_segment(
    sums: Sums, knots: Floats, first: NDArray[np.int64], segment: int, band: Floats, right: Floats
) -> None:
    """Add a segment's part of the normal equations: hat functions 1 - u and u, u from 0 to 1 along the segment."""
    axes = sums.pull.shape[2]
    begin, end, start = first[segment], first[segment + 1], knots[segment]
    span = knots[segment + 1] - start
    pull, weight = sums.pull[:, end] - sums.pull[:, begin], sums.weight[:, end] - sums.weight[:, begin]
    rising = (pull[1] - start * pull[0]) / span
    up = (weight[1] - start * weight[0]) / span
    up_up = (weight[2] - 2.0 * start * weight[1] + start * start * weight[0]) / (span * span)
    down_down, up_down = weight[0] - 2.0 * up + up_up, up - up_up
    for a in range(axes):
        i, j = segment * axes + a, (segment + 1) * axes + a
        right[i] += pull[0, a] - rising[a]
        right[j] += rising[a]
        for b in range(axes):
            band[j, axes + a - b] += up_down[a, b]
            if b <= a:
                band[i, a - b] += down_down[a, b]
                band[j, a - b] += up_up[a, b]


@routine
def _factor(band: Floats) -> bool:
    """Replace a banded matrix by its Cholesky factor; whether it is positive definite."""
    count, width = band.shape
    for i in range(count):
        for j in range(max(0, i - width + 1), i + 1):
            total = band[i, i - j] - _overlap(band, i, j)
            if i == j and not total > 0.0:
                return False
            band[i, i - j] = np.sqrt(total) if i == j else total / band[j, 0]
    return True


@routine
def _overlap(band: Floats, i: int, j: int) -> float:
    """Product of rows i and j of the factor, up to column j."""
    total = 0.0
    for k in range(max(0, i - band.shape[1] + 1), j):
        total += band[i, i - k] * band[j, j - k]
    return total


@routine
def _explained(band: Floats, right: Floats) -> float:
    """right @ inverse @ right, from the factor; right is used up."""
    width = band.shape[1]
    explained = 0.0
    for i in range(len(right)):
        for k in range(max(0, i - width + 1), i):
            right[i] -= band[i, i - k] * right[k]
        right[i] /= band[i, 0]
        explained += right[i] * right[i]
    return float(explained)
