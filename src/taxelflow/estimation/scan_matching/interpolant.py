"""A scan as a spline surface: the linear map from a pad's readings to coefficients on knots one pitch apart.

Minimises sum_i w_i (y_i - q(r_i))^2 + smoothing x squared second differences, with so little smoothing that the spline
goes through the readings where taxels lie on a grid, and bends evenly across holes and between scattered taxels. The
matrix depends on places and noise only, so it is factored once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.errors import ParameterInvalid
from taxelflow.estimation.template.map import LATTICE
from taxelflow.estimation.template.observations import across, reach
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.banded import WIDTH, add_diagonal, add_square, lower_factor, smoothness, solve_band
from taxelflow.numerics.bspline import KNOTS, evaluate, gather, spread, state_of
from taxelflow.runtime.compiling import routine

if TYPE_CHECKING:
    from numpy.typing import NDArray


class _Spline(NamedTuple):
    """The surface through the taxels of a scan."""

    smoothing: float = 1e-6
    """Weight of squared second differences, over that of a reading."""
    prior: float = 2.5e-7
    """Weight that keeps coefficients far from any taxel near 0, over that of a reading."""
    margin: int = 3
    """Knots beyond the outermost taxels: a step may lead so far off the pad."""
    farthest: float = 0.75
    """A knot farther than this from every live taxel, in pitches, is not observed."""


_SPLINE = _Spline()


class _Noise(NamedTuple):
    """Variances of a cubic spline through readings on a grid, over theirs (means)."""

    value: float = 0.764
    """Of its value."""
    slope: float = 2.163
    """Of its slope per pitch."""


SPLINE_NOISE = _Noise()


class Interpolant(NamedTuple):
    """What turns a pad's readings (taxels,) into coefficients (ny, nx); lengths in pitches.

    lattice: see `bspline.evaluate`; shape: (ny, nx). first, weight: see `bspline.spread`. factor: (knots, band), see
    `solve_band`. trust: (taxels,), weight of a reading. variance: (ny, nx), of the spline by noise. unobserved: (ny,
    nx), no live taxel is near. unobservable: (2,), how far off x and y may be if all live taxels lie in a line across
    that axis, else 0.
    """

    lattice: Floats
    shape: tuple[int, int]
    first: NDArray[np.int64]
    weight: Floats
    factor: Floats
    trust: Floats
    variance: Floats
    unobserved: Bools
    unobservable: Floats

    @classmethod
    def of(cls, name: str, places: Floats, variance: Floats) -> Interpolant:
        """Places (2, taxels), variance (taxels,) of their noise, 0 where masked. `name` is the pad's, for the error.

        Raises ParameterInvalid if the taxels are spread too thinly.
        """
        live = variance > 0
        low, high = places.min(axis=1), places.max(axis=1)
        if np.prod(high - low + 2 * _SPLINE.margin + 1) > LATTICE.most_knots:
            size = " x ".join(f"{side:.0f}" for side in high - low)
            duty = f"cover at most {LATTICE.most_knots} square pitches: leave this group out"
            raise ParameterInvalid(f"extent of {name}", f"{size} pitches", duty)
        usual = float(np.median(variance[live])) if live.any() else 1.0
        relative = variance / usual
        trust = np.divide(1.0, relative, out=np.zeros_like(relative), where=live)
        lattice = np.array([1.0, *(low - _SPLINE.margin)])
        nx, ny = (np.ceil(high - low).astype(int) + 2 * _SPLINE.margin + 1).tolist()
        first, weight = np.empty(len(variance), np.int64), np.empty((len(variance), KNOTS))
        still = np.array([0.0, 0.0, 0.0, 1.0, 0.0])
        spread((ny, nx), lattice, places, still, np.zeros((3, 0)), first, weight)
        nearest = _nearest_live(lattice, (ny, nx), places, live)
        return cls(
            lattice=lattice,
            shape=(ny, nx),
            first=first,
            weight=weight,
            factor=np.ascontiguousarray(_factor((ny, nx), first, weight, trust).T),
            trust=trust,
            variance=np.where(nearest >= 0, SPLINE_NOISE.value * variance[nearest], usual).reshape(ny, nx),
            unobserved=(nearest < 0).reshape(ny, nx),
            unobservable=np.where(across(places, live), reach(places), 0.0),
        )


def _factor(shape: tuple[int, int], first: NDArray[np.int64], weight: Floats, trust: Floats) -> Floats:
    """(band, knots), the lower Cholesky factor of the normal equations."""
    knots = shape[0] * shape[1]
    stencil, nothing = np.zeros((knots, WIDTH, 2 * WIDTH - 1)), np.zeros(knots)
    for taxel in np.flatnonzero(trust > 0):
        add_square(first[taxel], weight[taxel], trust[taxel], 0.0, shape[1], stencil, nothing)
    stencil += _SPLINE.smoothing * smoothness(shape)
    add_diagonal(stencil, _SPLINE.prior)
    return lower_factor(stencil, shape)


def _nearest_live(lattice: Floats, shape: tuple[int, int], places: Floats, live: Bools) -> NDArray[np.int64]:
    """(knots,) number of the nearest live taxel; -1 if it is too far."""
    h, left, low = lattice
    ny, nx = shape
    nearest = np.full(ny * nx, -1)
    column, row = np.meshgrid(left + h * np.arange(nx), low + h * np.arange(ny))
    knots = np.stack([column.ravel(), row.ravel()])
    closest = np.full(ny * nx, _SPLINE.farthest)
    for taxel in np.flatnonzero(live):
        away = np.hypot(*(knots - places[:, taxel, np.newaxis]))
        near = away < closest
        nearest[near], closest[near] = taxel, away[near]
    return nearest


@routine
def interpolate(spline: Interpolant, reading: Floats, c: Floats) -> None:
    """Make c (ny, nx) the coefficients of the spline through readings (taxels,)."""
    weighted, right = np.empty((1, len(reading))), c.reshape((1, c.size))
    for i in range(len(reading)):
        weighted[0, i] = reading[i] * spline.trust[i]
    for j in range(c.size):
        right[0, j] = 0.0
    gather(spline.first, spline.weight, weighted, c.shape[1], right)
    solve_band(spline.factor, right)


@routine
def fill_missing(
    c: Floats,
    lattice: Floats,
    places: Floats,
    origin: Floats,
    noise: Floats,
    variance: Floats,
    state: Floats,
    reading: Floats,
) -> None:
    """Put the surface c at a state (5,) into a scan's missing readings, so that the next scan finds no dip there.

    lattice: from the origin (2 or more,), about which the surface turns; places: (2, taxels), not so. noise: (taxels,),
    0 where masked; variance: (taxels,), 0 where masked or missing.
    """
    where, values = np.empty((2, len(noise))), np.empty((len(noise), 5))
    for i in range(len(noise)):
        where[0, i], where[1, i] = places[0, i] - origin[0], places[1, i] - origin[1]
    evaluate(c, lattice, where, state, np.zeros((3, 0)), values)
    gain = state_of(state).gain
    for i in range(len(noise)):
        if variance[i] == 0.0 and noise[i] > 0.0 and not np.isnan(values[i, 0]):
            reading[i] = gain * values[i, 0]
