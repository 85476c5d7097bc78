"""Contacts that grow with their load: at a border, growth looks like motion.

The hypothesis of an object at rest, whose contact scales with the load, is compared with the fits without scaling. The
fixed point of the scaling is estimated, too: the point whose position depends least on the size. It may lie beyond a
border that cuts the contact.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.template.bundle_adjustment import refine
from taxelflow.estimation.template.map import Pattern, covering, fill
from taxelflow.estimation.template.observations import COARSE
from taxelflow.numerics.bspline import STATE, states_of
from taxelflow.numerics.geometry import rotation

if TYPE_CHECKING:
    from taxelflow.estimation.template.bundle_adjustment import Fit
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.messages import Floats


class _Growth(NamedTuple):
    """A contact that grows with its load."""

    loads: tuple[float, float] = (0.05, 0.95)
    differ: float = 2.0
    """Quantiles of the load, and the least ratio of the second to the first at which growth can be estimated."""
    scans: int = 5
    """Scans from which growth is estimated."""
    stays: float = 2.0
    """Growth is tried only if the position, less its dependence on the load, stays within this many pitches."""
    terms: int = 4
    """Coefficients of the polynomial by which the position depends on the size."""
    gain_std: float = 1.0
    """Prior standard deviation of the gains: here they follow the load, which varies much."""
    most_share: float = 20.0
    """Largest ratio of the load to that of the first scan fitted, and the largest inverse of it."""
    place_std: float = 0.02
    slide_std: float = 0.25
    """Standard deviations over that of the fixed point from the origin, one pitch: of positions; and of the velocity,
    per s, at which an object slides while it is pressed."""


_GROWTH = _Growth()
_POWER, SIZE_STD = 1 / 3, 0.3
"""Hertz: size and pressure grow as this power of the force; standard deviation of log size from that law."""


def grown_starts(scanned: Scanned, states: Floats, start: int) -> list[tuple[Pattern, Floats, Fit]]:
    """Pattern, states (scans, 5) and coarse fit of an object that stays where it is in scan `start` while its contact
    grows with the load, around each place that may stay; none where the load hardly varies, or where the object clearly
    moved: a contact that a border cuts seems to grow, too.

    states: (scans, 5), of a fit without growth.
    """
    if not may_have_grown(scanned, states):
        return []
    return [_grown_around(scanned, place, start) for place in _places_that_may_stay(scanned, start)]


def _places_that_may_stay(scanned: Scanned, start: int) -> list[Floats]:
    """Places (2,) around which the contact of scan `start` may grow: its centroid; that of what the border cuts; and
    one as far beyond.
    """
    middle, edge = scanned.centroids()[start], scanned.edge
    load = scanned.load()[start, edge]
    if not load.any():
        return [middle]
    cut: Floats = scanned.places[:, edge] @ load / load.sum()
    return [middle, cut, 2.0 * cut - middle]


def _grown_around(scanned: Scanned, place: Floats, start: int) -> tuple[Pattern, Floats, Fit]:
    """`grown_starts` around a given place (2,)."""
    load = scanned.load().sum(axis=1)
    share = np.clip(load / max(float(load[start]), 1e-300), 1.0 / _GROWTH.most_share, _GROWTH.most_share)
    held = np.zeros((len(scanned), STATE))
    held[:, :2] = place
    parts = states_of(held)
    parts.gain[:], parts.size[:] = share**_POWER, _POWER * np.log(share)
    pattern = covering(scanned, held)
    fill(pattern, scanned.with_error(COARSE), held)
    precision = np.array([np.inf, np.inf, np.inf, _GROWTH.gain_std**-2, SIZE_STD**-2])
    # more rounds than without growth, for it starts from the load alone
    fit = refine(pattern, scanned, held, rounds=15, error=COARSE, precision=precision)
    return pattern, held, fit


def may_have_grown(scanned: Scanned, states: Floats) -> bool:
    """Whether the load varies enough to estimate growth, and the object hardly moved except with its load.

    states: (scans, 5). Of a contact that a border cuts, only a flank may be observed.
    """
    load = scanned.load().sum(axis=1)
    least, most = np.quantile(load, _GROWTH.loads)
    if len(scanned) < _GROWTH.scans or most < _GROWTH.differ * max(least, 1e-300):
        return False
    with_load = np.vander(np.clip(load / most, 1.0 / _GROWTH.most_share, _GROWTH.most_share) ** _POWER, _GROWTH.terms)
    places = states[:, :2]
    left = places - with_load @ np.linalg.lstsq(with_load, places, rcond=None)[0]
    return bool(np.ptp(left, axis=0).max() <= _GROWTH.stays)


def centre(pattern: Pattern, scanned: Scanned, states: Floats) -> None:
    """Shift the origin of the object's frame, in place, to the point whose position depends least on the size.

    Motion that is linear in time is sliding; motion that follows the load up and down is growth.
    """
    parts = states_of(states)
    arms = np.exp(parts.size)[:, np.newaxis, np.newaxis] * rotation(parts.theta)
    since = (scanned.t_s - scanned.t_s.mean())[:, np.newaxis, np.newaxis] * np.eye(2)
    apart = np.concatenate([arms - arms.mean(axis=0), since], axis=2).reshape(-1, 4)
    away = (states[:, :2] - states[:, :2].mean(axis=0)).ravel()
    known = np.diag(np.repeat([_GROWTH.place_std, _GROWTH.place_std / _GROWTH.slide_std], 2))
    body = -np.linalg.lstsq(np.concatenate([apart, known]), np.append(away, np.zeros(4)), rcond=None)[0][:2]
    states[:, :2] += arms @ body
    pattern.lattice = pattern.lattice - np.array([0.0, *body])
