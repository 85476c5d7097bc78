"""The velocity of an object from steps of its pads' images: what is wrong in one place is wrong in two steps.

A step is the difference of two places, each with its own noise n. So the velocity along the pads is

    y_k = A v_k + (n_k - n_(k-1)) / T + w_k,

with the noise w_k of the step itself. Steps at rest correlate by -1/2 from scan to scan; the noise of their sum does
not grow. So the state of this Kalman filter is v, and the noise of the last place of each pad.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats


class StepFilter:
    """Begins at rest. Places are in m, velocities in m/s."""

    def __init__(self, count: int, pads: int) -> None:
        """count: n, components of the velocity."""
        self._count, self._places, size = count, 2 * pads, count + 2 * pads
        self._mean, self._covariance = np.zeros(size), np.diag(np.where(np.arange(size) < count, 1e-12, 0.0))
        self._placed: Bools = np.zeros(pads, dtype=np.bool_)  # pads whose last step is known

    @property
    def velocity(self) -> Floats:
        """(n,), of the object."""
        return self._mean[: self._count]

    @property
    def covariance(self) -> Floats:
        """(n, n), of that velocity."""
        return self._covariance[: self._count, : self._count]

    def predict(self, change_m_s: float, axes: Floats) -> None:
        """Add the standard deviation of a change of the velocity since the scan before.

        A gripped object moves along its pads. So each direction gets the share of it that lies in their planes, which
        is all for facing pads. axes: (pads, 2, n), of those that know a velocity.
        """
        along = np.einsum("pia,pib->ab", axes, axes) / len(axes)
        self._covariance[: self._count, : self._count] += change_m_s**2 * along

    def expected(self, axes: Floats, dt_s: float) -> tuple[Floats, Floats]:
        """(pads, 2), (pads, 2, 2): velocity along each pad by the scans before, and its covariance."""
        seen, pads = self._seen(axes, dt_s), np.arange(len(axes))
        covariance = (seen @ self._covariance @ seen.T).reshape(len(axes), 2, len(axes), 2)
        return (seen @ self._mean).reshape(-1, 2), covariance[pads, :, pads]

    def update(self, pads: Bools, velocity: Floats, axes: Floats, noise: tuple[Floats, Floats], dt_s: float) -> None:
        """Add the velocities (pads, 2) of some pads.

        axes: (pads, 2, n). noise: covariances (pads, 2, pads, 2) by the places, and by the step itself.
        """
        count, places, known = self._count, self._places, np.repeat(pads, 2)
        by_place, by_step = (one.reshape(places, places) for one in noise)
        half = by_place * dt_s**2 / 2.0  # of each of the two places
        before = count + np.flatnonzero(known & ~np.repeat(self._placed, 2))
        self._covariance[np.ix_(before, before)] = half[np.ix_(before - count, before - count)]
        now = np.flatnonzero(known)
        seen = np.hstack([self._seen(axes, dt_s), np.eye(places) / dt_s])[now]
        mean = np.concatenate([self._mean, np.zeros(places)])
        covariance = np.pad(self._covariance, (0, places))
        covariance[np.ix_(count + places + now, count + places + now)] = half[np.ix_(now, now)]
        shared = seen @ covariance
        gain = np.linalg.solve(shared @ seen.T + by_step[np.ix_(now, now)], shared).T
        mean += gain @ (velocity.ravel()[now] - seen @ mean)
        covariance -= gain @ shared
        kept = np.concatenate([np.arange(count), count + places + np.arange(places)])
        self._mean, self._covariance = mean[kept], covariance[np.ix_(kept, kept)]
        self._placed = pads

    def _seen(self, axes: Floats, dt_s: float) -> Floats:
        """(2 pads, n + 2 pads): velocities along the pads by the state, without the noise of their new places."""
        return np.hstack([axes.reshape(-1, self._count), -np.eye(self._places) / dt_s])
