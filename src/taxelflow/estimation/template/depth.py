"""Patterns of heights: a relief that sinks into an elastic skin, by a depth of each scan.

Under a constant force an object sinks in when lower parts of its relief come under the pad, and rises when higher ones
do. On an elastic skin the pressure at a point follows its depth and is never below 0, so a taxel reads

    y = g m,    m: mean of max(h + d, 0) over the taxel,

with the relief's height h over the skin and the depth d of each scan, both as pressures. d may be 0 in all scans: a
contact with sharp edges touches taxels in part, whether it sinks or not. In a model with a gain only, the pattern would
have to explain d, which depends on the object's place: map and motion would be stretched by some per cent.

The pattern of such a contact is the height h, averaged over a taxel; it is negative where there is a gap. Over a taxel
it is a plane, whose slopes give the share of the taxel that touches. During a fit, the states hold the depth instead of
the size, as a share of the contact's largest reading.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.ndimage import correlate1d, spline_filter

from taxelflow.numerics.bspline import AT_KNOT, KNOTS, SLOPE_AT_KNOT, basis, basis_bends, basis_slopes, states_of
from taxelflow.runtime.compiling import inlined, routine

if TYPE_CHECKING:
    from taxelflow.estimation.template.map import Pattern
    from taxelflow.messages import Floats

DEPTH_STD = 0.1
"""Prior standard deviation of the depth, as a share of the contact's largest reading."""


class _Heights(NamedTuple):
    """Limits of heights, as shares of the contact's largest reading."""

    level: float = 0.004
    """Rise over half a taxel below which the height is level along an axis."""
    touched: float = 0.06
    """Pressure up to which a taxel counts as touched in part, in the initial heights of a fit."""
    least: float = 1e-3
    """Lower limit of the pressure there."""


_HEIGHTS = _Heights()


class Touch(NamedTuple):
    """mean: pressure over the taxel. share: of the taxel that touches, which is the derivative by the height. along_x,
    along_y: derivatives by the slopes along the pad's axes.
    """

    mean: float
    share: float
    along_x: float
    along_y: float


@inlined
def touch(height: float, slope_x: float, slope_y: float, level: float) -> Touch:
    """What a taxel reads of a plane with this height at its middle and these slopes per pitch.

    The mean of max(h, 0) over a square: differences of its third integral, max(h, 0)^3 / 6. level: the contact's
    largest reading.
    """
    least, rise_x, rise_y = _HEIGHTS.level * level, 0.5 * abs(slope_x), 0.5 * abs(slope_y)
    flat_x, flat_y, x, y = rise_x < least, rise_y < least, max(rise_x, least), max(rise_y, least)
    if height >= x + y:
        return Touch(height, 1.0, 0.0, 0.0)
    if height <= -x - y:
        return Touch(0.0, 0.0, 0.0, 0.0)
    a, b = height + x + y, max(height + x - y, 0.0)
    c, d = max(height - x + y, 0.0), max(height - x - y, 0.0)
    unit = 1.0 / (24.0 * x * y)
    mean = unit * (a * a * a - b * b * b - c * c * c + d * d * d)
    share = 3.0 * unit * (a * a - b * b - c * c + d * d)
    by_x = 0.0 if flat_x else 3.0 * unit * (a * a - b * b + c * c - d * d) - mean / x
    by_y = 0.0 if flat_y else 3.0 * unit * (a * a + b * b - c * c - d * d) - mean / y
    return Touch(mean, share, 0.5 * by_x * np.sign(slope_x), 0.5 * by_y * np.sign(slope_y))


@routine
def add_tilt(
    c: Floats,
    lattice: Floats,
    place: tuple[float, float],
    turn: float,
    tilt: tuple[float, float],
    weight: Floats,
    slope: Floats,
) -> None:
    """Add the derivatives of a reading through the slopes of the height: by coefficients, weight (16,), x, y and theta.

    place: of the taxel from the object, along the pad. turn: of the object. tilt: derivatives of the reading by the
    slopes along the pad. slope: (5,), by the state.
    """
    h, left, low = lattice
    cos, sin = np.cos(turn), np.sin(turn)
    u, w = cos * place[0] + sin * place[1], cos * place[1] - sin * place[0]
    column, row = (u - left) / h, (w - low) / h
    k, j = int(column), int(row)
    along, across = basis(column - k), basis(row - j)
    rise, climb = basis_slopes(column - k), basis_slopes(row - j)
    bend, curl = basis_bends(column - k), basis_bends(row - j)
    tilt_u, tilt_w = (cos * tilt[0] + sin * tilt[1]) / h, (cos * tilt[1] - sin * tilt[0]) / h
    by_u = by_w = first_u = first_w = 0.0
    for i in range(KNOTS):
        own, a, b = c[j - 1 + i // 4, k - 1 + i % 4], i % 4, i // 4
        slope_u, slope_w = across[b] * rise[a], climb[b] * along[a]
        weight[i] += tilt_u * slope_u + tilt_w * slope_w
        mixed = climb[b] * rise[a]
        by_u += own * (tilt_u * across[b] * bend[a] + tilt_w * mixed) / h
        by_w += own * (tilt_u * mixed + tilt_w * curl[b] * along[a]) / h
        first_u += own * slope_u
        first_w += own * slope_w
    slope[0] += sin * by_w - cos * by_u
    slope[1] -= sin * by_u + cos * by_w
    slope[2] += by_u * w - by_w * u + tilt_w * first_u - tilt_u * first_w


def as_heights(pattern: Pattern) -> Pattern:
    """The initial pattern of heights of a fit, from one of pressure."""
    part = _HEIGHTS.touched * pattern.amplitude
    q = np.maximum(pattern.coefficients, _HEIGHTS.least * pattern.amplitude)
    return replace(pattern, coefficients=q + part * np.log(-np.expm1(-q / part)))


def as_pressure(pattern: Pattern) -> Pattern:
    """The pattern of pressure that taxels read of a pattern of heights at depth 0."""
    c, h = pattern.coefficients, pattern.lattice[0]
    over = [correlate1d(c, AT_KNOT, axis=axis, mode="nearest") for axis in (0, 1)]
    height = correlate1d(over[0], AT_KNOT, axis=1, mode="nearest")
    slope_x = correlate1d(over[0], SLOPE_AT_KNOT, axis=1, mode="nearest") / h
    slope_y = correlate1d(over[1], SLOPE_AT_KNOT, axis=0, mode="nearest") / h
    read = [touch(*one, pattern.amplitude).mean for one in zip(height.flat, slope_x.flat, slope_y.flat, strict=True)]
    values = np.reshape(read, c.shape)
    return replace(pattern, coefficients=spline_filter(values, order=3, mode="mirror"))


def with_depth(states: Floats, depth: Floats) -> Floats:
    """States (scans, 5) with the depth (scans,), if there is any, instead of the size, which is then 0."""
    own = states.copy()
    if len(depth):
        states_of(own).size[:] = depth
    return own


def take_depth(whole: Floats, states: Floats, depth: Floats) -> None:
    """Fill states (scans, 5) and depth (scans,), if there is any, from what `with_depth` gives."""
    states[:] = whole
    if len(depth):
        depth[:] = states_of(whole).size
        states_of(states).size[:] = 0.0
