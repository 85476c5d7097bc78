"""Where the velocity of a slip changes: knots of a linear spline, added one by one while a criterion falls.

The sums over any segment come from running sums over the scans, so that a trial costs nothing per scan. Its normal
equations are banded, as the hat functions of a linear spline overlap with their neighbours' only.
"""

from __future__ import annotations

from math import inf, log, sqrt
from typing import Annotated, NamedTuple

from taxelflow.messages import Floats
from taxelflow.numerics.records import Records, Vector
from taxelflow.numerics.rounding import LINE_POINTS
from taxelflow.runtime.compiling import routine


class _Path(NamedTuple):
    """The path of a slip, in straight segments."""

    segments: int = 12
    """At most: memory and time are bounded."""
    candidates: int = 24
    """Times at which a further knot is tried, evenly spread over the scans."""


_PATH = _Path()
_MOST_KNOTS = _PATH.segments + 2
_ROWS = 3 * _MOST_KNOTS
"""Unknowns at most: three coordinates at each knot."""


class Sums(NamedTuple):
    """Running sums over scans. weight: (3, scans + 1, axes, axes), of the weight times time to the power 0, 1, 2.
    pull: (2, scans + 1, axes), of weight @ moved times time to the power 0, 1.
    """

    weight: Floats
    pull: Floats


class Knot:
    """t_s: time. scan: the first one of the segment that begins here; at the last knot the number of scans."""

    t_s: float
    scan: int


class Spline:
    """A path, and room to fit it. square: of all scans, the sum of moved @ weight @ moved. band: (knots * axes, 2 *
    axes), element [i, d] is (i, i - d) of the lower triangle of the normal equations. right: (knots * axes,), their
    right-hand side. knots: of the path. trial: those that are tried. position, white, before: of `fit_path`.
    """

    square: float
    band: Annotated[Floats, _ROWS, 6]
    right: Annotated[Floats, _ROWS]
    knots: Annotated[Records, Knot, _MOST_KNOTS]
    trial: Annotated[Records, Knot, _MOST_KNOTS]
    position: Annotated[Floats, _ROWS]
    white: Vector
    before: Vector


@routine
def add_up(t: Floats, moved: Floats, weight: Floats, sums: Sums, spline: Spline) -> None:
    """Fill the sums, which come in as 0, of scans at times t (scans,), moved (scans, axes), with weight (scans, axes,
    axes), and `Spline.square`.
    """
    scans, axes = moved.shape
    weights, pulls, square = sums.weight, sums.pull, 0.0
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
    spline.square = square


@routine
def place_knots(t: Floats, sums: Sums, readings: int, spline: Spline) -> tuple[int, float]:
    """Add knots between the first two, and fit them; how many there are then, and the chi-square of `fit_knots`.

    t: (scans,), increasing. readings: scans times axes.
    """
    held, best = 2, _criterion(sums, spline.knots, 2, readings, spline)
    while held <= _PATH.segments:
        room = 0
        for segment in range(held - 1):
            room += _room(spline.knots, segment)
        count = min(room, _PATH.candidates)
        least, chosen = inf, 0
        for candidate in range(count):
            number = candidate * (room - 1) // (count - 1) if room > count else candidate
            _with_another(held, number, t, spline)
            found = _criterion(sums, spline.trial, held + 1, readings, spline)
            if found < least:
                least, chosen = found, number
        if not least < best:
            break
        _with_another(held, chosen, t, spline)
        held, best = held + 1, least
        for k in range(held):
            spline.knots[k] = spline.trial[k]
    return held, fit_knots(sums, spline.knots, held, spline)


@routine
def _room(knots: Records, segment: int) -> int:
    """Scans of a segment at which it can be divided."""
    return max(int(knots[segment + 1].scan - knots[segment].scan) - 2 * LINE_POINTS + 1, 0)  # each part is a line


@routine
def _with_another(held: int, number: int, t: Floats, spline: Spline) -> None:
    """Make the trial the held knots and one at the scan of this number among those that are possible."""
    knots, trial, segment = spline.knots, spline.trial, 0
    while number >= _room(knots, segment):
        number -= _room(knots, segment)
        segment += 1
    for k in range(held + 1):
        trial[k] = knots[k if k <= segment else k - 1]
    added: Knot = trial[segment + 1]
    added.scan = knots[segment].scan + LINE_POINTS + number
    added.t_s = t[added.scan]


@routine
def _criterion(sums: Sums, knots: Records, held: int, readings: int, spline: Spline) -> float:
    """Of Schwarz, with a scale of the noise that is at least 1; infinite where the knots cannot be fitted."""
    chi_square = fit_knots(sums, knots, held, spline)
    if chi_square == inf:
        return inf
    scale = max(chi_square / readings, 1.0)  # the noise is not below what the covariances claim
    return float(readings * log(scale) + chi_square / scale + held * (sums.pull.shape[2] + 1) * log(readings))


@routine
def fit_knots(sums: Sums, knots: Records, held: int, spline: Spline) -> float:
    """Chi-square of the path through the held knots, infinite where they cannot be fitted.

    Leaves in the spline the Cholesky factor L of the normal equations and inv(L) times their right-hand side.
    """
    axes, band, right = sums.pull.shape[2], spline.band, spline.right
    for i in range(held * axes):
        right[i] = 0.0
        for d in range(2 * axes):
            band[i, d] = 0.0
    for segment in range(held - 1):
        _add_segment(sums, knots[segment], knots[segment + 1], segment * axes, band, right)
    explained = _explained(band, right, held * axes, 2 * axes)
    return float(inf if explained == inf else spline.square - explained)


@routine
def _add_segment(sums: Sums, here: Knot, there: Knot, row: int, band: Floats, right: Floats) -> None:
    """Add a segment's part of the normal equations: hat functions 1 - u and u, u from 0 to 1 along the segment. row:
    of its first knot.
    """
    axes = sums.pull.shape[2]
    begin, end, start = here.scan, there.scan, here.t_s
    span = there.t_s - start
    for a in range(axes):
        i, j = row + a, row + axes + a
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
def _explained(band: Floats, right: Floats, count: int, width: int) -> float:
    """right @ inverse @ right of the first `count` rows of a banded matrix, infinite if it is not positive definite.

    The matrix becomes its Cholesky factor, right is used up.
    """
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
def forward(band: Floats, right: Floats, count: int, width: int) -> float:
    """Make the first `count` of right inv(L) right; their squared length. band: of `fit_knots`, of this width."""
    square = 0.0
    for i in range(count):
        for k in range(max(0, i - width + 1), i):
            right[i] -= band[i, i - k] * right[k]
        right[i] /= band[i, 0]
        square += right[i] * right[i]
    return square


@routine
def backward(band: Floats, right: Floats, count: int, width: int) -> None:
    """Make the first `count` of right inv(L)' right. band: of `fit_knots`, of this width."""
    for i in range(count - 1, -1, -1):
        for k in range(i + 1, min(count, i + width)):
            right[i] -= band[k, k - i] * right[k]
        right[i] /= band[i, 0]
