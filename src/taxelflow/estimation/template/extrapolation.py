"""Where taxels have observed an object, and extrapolation of its pattern to where none has."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt

from taxelflow.numerics.bspline import in_object

if TYPE_CHECKING:
    from taxelflow.estimation.template.map import Pattern
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.messages import Bools, Floats


class _Margin(NamedTuple):
    """Where nothing was read."""

    reach: float = 1.5
    """Knots farther than this from all readings, in knots, are extrapolated by the smoothness prior."""
    unloaded: float = 0.1
    """Share of the largest pressure below which a margin is unloaded."""


_MARGIN = _Margin()


def coverage(scanned: Scanned, states: Floats) -> Floats:
    """(n, 2) places in the pattern's own frame at which taxels were read."""
    places = np.broadcast_to(scanned.places, (len(scanned), *scanned.places.shape))
    if scanned.rolling:
        places = places - scanned.bends[:, :2]
    return np.concatenate(
        [in_object(at[:, own > 0].T, state) for at, own, state in zip(places, scanned.variance, states, strict=True)]
    )


def near(looked: Floats, x: Floats, y: Floats, reach: float) -> Bools:
    """(ny, nx), whether a reading lies within `reach`."""
    step = x[1] - x[0]
    at = np.round((looked - [x[0], y[0]]) / step).astype(np.int64)
    at = at[(at >= 0).all(axis=1) & (at < [len(x), len(y)]).all(axis=1)]
    away = np.ones((len(y), len(x)), dtype=np.bool_)
    away[at[:, 1], at[:, 0]] = False
    close: Bools = distance_transform_edt(away) * step <= reach
    return close


def extrapolate(pattern: Pattern, scanned: Scanned, states: Floats) -> None:
    """Extrapolate an unloaded margin as a constant; the smoothness prior would extrapolate it linearly.

    A loaded margin, cut by the pad's border, keeps the linear extrapolation: the object is likely to continue there.
    states: (scans, 5), of the scans that the pattern was learned from.
    """
    x, y = pattern.knots
    looked = coverage(scanned, states)
    least, most = looked.min(axis=0), looked.max(axis=0)
    between = (least[0] <= x) & (x <= most[0]) & ((least[1] <= y) & (y <= most[1]))[:, np.newaxis]
    seen = between | near(looked, x, y, _MARGIN.reach * pattern.lattice[0])
    row, col = distance_transform_edt(~seen, return_distances=False, return_indices=True)
    level = pattern.coefficients[row, col]
    unloaded = np.abs(level) < _MARGIN.unloaded * pattern.amplitude
    pattern.coefficients = np.where(unloaded, level, pattern.coefficients)
