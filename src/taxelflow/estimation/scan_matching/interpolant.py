"""A scan as a spline: the linear map from a pad's readings to coefficients on knots one pitch apart.

Minimises sum_i w_i (y_i - q(r_i))^2 + smoothing x squared second differences, with so little smoothing that the spline
goes through the readings where taxels lie on a grid, and bends evenly across holes and between scattered taxels. The
matrix depends on places and noise only, so it is factored once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.errors import ParameterInvalid
from taxelflow.estimation.template.map import Pattern, Sums
from taxelflow.estimation.template.observations import Scanned, across, reach
from taxelflow.numerics.bspline import STATE, spread

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats

_SMOOTHING = 1e-6
"""Weight of squared second differences, over that of a reading."""
_FARTHEST = 0.75
"""A knot farther than so many pitches from every live taxel knows nothing."""
_MOST_KNOTS = 40_000
VALUE_NOISE = 0.764
SLOPE_NOISE = 2.163
"""Variance of a cubic spline through readings on a grid, and of its slope per pitch, over theirs (means)."""


@dataclass(frozen=True, slots=True, eq=False)
class Interpolant:
    """What turns a pad's readings (taxels,) into coefficients (ny, nx); lengths in pitches.

    lattice: see `spline.evaluate`. first, weight: see `spline.spread`. factor: (knots, band), column k of the lower
    Cholesky factor in row k. trust: (taxels,), weight of a reading. doubt: (ny, nx), variance that noise makes of the
    spline. blind: (ny, nx), no live taxel is near. across: (2,) how far off x and y may be if a line of taxels cannot
    tell, 0 where they are told.
    """

    lattice: Floats
    shape: tuple[int, int]
    first: NDArray[np.int64]
    weight: Floats
    factor: Floats
    trust: Floats
    doubt: Floats
    blind: Bools
    across: Floats

    @classmethod
    def of(cls, name: str, places: Floats, variance: Floats) -> Interpolant:
        """Places (2, taxels), variance (taxels,) of their noise, 0 where masked. `name` is the pad's, for the error.

        Raises ParameterInvalid if the taxels are spread too thinly.
        """
        live = variance > 0
        low, high = places.min(axis=1), places.max(axis=1)
        if np.prod(high - low + 7.0) > _MOST_KNOTS:
            size = " x ".join(f"{side:.0f}" for side in high - low)
            duty = f"cover at most {_MOST_KNOTS} square pitches: leave this group out"
            raise ParameterInvalid(f"extent of {name}", f"{size} pitches", duty)
        usual = float(np.median(variance[live])) if live.any() else 1.0
        pattern = Pattern.empty(low, high, 1.0, 1, np.ones(2), 1e3)
        pattern.smoothing = _SMOOTHING
        relative = variance / usual
        state = np.array([0.0, 0.0, 0.0, 1.0, 0.0])
        sums, nothing = Sums(pattern), np.zeros(len(variance))
        once = Scanned.of(np.zeros(1), places, nothing[np.newaxis], relative[np.newaxis], nothing + np.inf, nothing)
        sums.add(pattern, once, state[np.newaxis, :STATE], 0.0)
        factor = sums.solve(pattern).lower
        first, weight = np.empty(len(variance), np.int64), np.empty((len(variance), pattern.width**2))
        spread(
            pattern.shape, pattern.lattice, places, state, pattern.points, once.bends[0], pattern.width, first, weight
        )
        nearest = _nearest_live(pattern, places, live)
        doubt = np.where(nearest >= 0, VALUE_NOISE * variance[nearest], usual)
        return cls(
            lattice=pattern.lattice,
            shape=pattern.shape,
            first=first,
            weight=weight,
            factor=np.ascontiguousarray(factor.T),
            trust=np.divide(1.0, relative, out=np.zeros_like(relative), where=live),
            doubt=doubt.reshape(pattern.shape),
            blind=(nearest < 0).reshape(pattern.shape),
            across=np.where(across(places, live), reach(places), 0.0),
        )


def _nearest_live(pattern: Pattern, places: Floats, live: Bools) -> NDArray[np.int64]:
    """(knots,) number of the nearest live taxel; -1 if it is too far."""
    h, left, low = pattern.lattice
    ny, nx = pattern.shape
    nearest = np.full(ny * nx, -1)
    across, up = np.meshgrid(left + h * np.arange(nx), low + h * np.arange(ny))
    knots = np.stack([across.ravel(), up.ravel()])
    closest = np.full(ny * nx, _FARTHEST)
    for taxel in np.flatnonzero(live):
        away = np.hypot(*(knots - places[:, taxel, np.newaxis]))
        near = away < closest
        nearest[near], closest[near] = taxel, away[near]
    return nearest
