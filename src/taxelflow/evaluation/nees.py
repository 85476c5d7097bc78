"""Consistency of covariances: the normalised estimation error squared (NEES) of pose differences.

For e = (pose[k+n] - pose[k]) - (truth[k+n] - truth[k]) and C = covariance[k] + covariance[k+n], as an estimator writes
them, e^T C^-1 e over its degrees of freedom is 1 on average if C is the covariance of e (Bar-Shalom, Li & Kirubarajan
2001, section 5.4). Axes without a number are left out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import numpy as np
from scipy.stats import chi2

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.messages import Floats

SPANS = (1, 20, 100)
"""Scans that the differences reach over."""


class Consistency(msgspec.Struct, frozen=True):
    """NEES over one number of scans. None: no contact is long enough."""

    nees: float | None
    """Mean per degree of freedom: below 1 the covariance is too wide, above 1 too narrow."""
    low: float | None
    """Where the mean lies with 95 % probability if the covariance is right: chi-square with as many degrees of freedom
    as the independent pairs have."""
    high: float | None
    pairs: int
    """Differences, no scan in two of them."""
    independent: float
    """What they are worth, for neighbours err alike: their number over the autocorrelation time of the NEES, at least
    the number of contacts."""


def consistency(contacts: Sequence[tuple[Floats, Floats]], over: int) -> Consistency:
    """NEES over `over` scans of contacts, each errors (scans, 3), NaN where unknown, and covariances (scans, 3, 3)."""
    found = [nees_of(error, covariance, over) for error, covariance in contacts]
    found = [(nees, freedom) for nees, freedom in found if len(nees)]
    if not found:
        return Consistency(None, None, None, 0, 0.0)
    nees, freedom = (np.concatenate(parts) for parts in zip(*found, strict=True))
    finite = [np.minimum(own / axes, 1e9) for own, axes in found]  # a NEES may be infinite
    independent = max(len(nees) / _correlation(finite), float(len(found)))
    degrees = float(freedom.mean()) * independent
    low, high = (float(chi2.ppf(share, degrees) / degrees) for share in (0.025, 0.975))
    return Consistency(float(nees.sum() / freedom.sum()), low, high, len(nees), independent)


def nees_of(error: Floats, covariance: Floats, over: int) -> tuple[Floats, Floats]:
    """NEES (pairs,) and degrees of freedom (pairs,) of one contact; pairs (k, k + over) that share no scan."""
    first = np.arange(max(len(error) - over, 0))
    first = first[first // over % 2 == 0]
    e, c = error[first + over] - error[first], covariance[first] + covariance[first + over]
    known = np.isfinite(e) & np.isfinite(np.diagonal(c, axis1=1, axis2=2))
    use = known[:, :2].all(axis=1)
    e, c, known = e[use], c[use], known[use]
    turn = known[:, 2]
    nees = np.empty(len(e))
    nees[turn] = _squared(e[turn], c[turn])
    nees[~turn] = _squared(e[~turn, :2], c[~turn, :2, :2])
    return nees, known.sum(axis=1).astype(np.float64)


def _squared(e: Floats, c: Floats) -> Floats:
    """e^T C^-1 e (n,); infinite where C is singular, for such a covariance claims to know all."""
    scale = np.sqrt(np.diagonal(c, axis1=1, axis2=2))
    with np.errstate(divide="ignore", invalid="ignore"):
        e, c = e / scale, c / scale[:, :, np.newaxis] / scale[:, np.newaxis]
    sound = np.asarray(np.isfinite(c).all(axis=(1, 2)))
    sound[sound] = np.linalg.eigvalsh(c[sound])[:, 0] > 1e-9
    squared = np.full(len(e), np.inf)
    squared[sound] = np.sum(e[sound] * np.linalg.solve(c[sound], e[sound, :, np.newaxis])[..., 0], axis=1)
    return squared


def _correlation(series: list[Floats]) -> float:
    """Autocorrelation time, in pairs, of series from one process: 1 + 2 sum of the correlations down to the first that
    is not positive.
    """
    whole = np.concatenate(series)
    apart = [own - whole.mean() for own in series]
    variance = float(np.mean(np.concatenate(apart) ** 2))
    time = 1.0
    for lag in range(1, max(map(len, series))):
        products = np.concatenate([own[lag:] * own[:-lag] for own in apart if len(own) > lag])
        share = float(products.mean()) / variance if variance > 0 else 0.0
        if not share > 0:
            break
        time += 2 * share
    return time
