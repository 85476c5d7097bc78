"""Poses of objects that stick, by a second witness, combined with the place where they were touched.

Where readings do not show a motion, the pose is open along a direction, whether the object moves or not. A sensor that
measures shear shows that it has not slipped. It is then where it was touched, but for what skin and finger give way:
a Gaussian prior, which a Kalman update combines with the pose.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import AMBIGUOUS, OK

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats, Slips

STICKS = 0.2
"""Standard deviation of the place of an object that sticks, pitches per axis, of a marker on objects in a XELA hand."""


class StickingPoses:
    """Follows where the objects on all pads were touched."""

    def __init__(self, pitch_m: Floats) -> None:
        """pitch_m: (pads,)."""
        self._variance = (STICKS * pitch_m) ** 2
        self._touched_m = np.full((len(pitch_m), 2), np.nan)

    def touched(self, slips: Slips) -> Floats:
        """(scans, pads, 2), places where the objects of scans, which follow those of the last call, were touched, m."""
        touched_m = np.empty((*slips.contact.shape, 2))
        for scan, contact in enumerate(slips.contact):
            known = contact[:, np.newaxis] & np.isfinite(self._touched_m)
            self._touched_m = np.where(known, self._touched_m, slips.pose[scan, :, :2])
            touched_m[scan] = self._touched_m
        return touched_m

    def held(self, slips: Slips, touched_m: Floats, sticks: Bools) -> Slips:
        """The same, where objects stick (scans, pads) with poses near where they were touched, which do not slide."""
        scans, pads = np.nonzero(sticks & np.isfinite(slips.pose[..., 0]))
        if not len(scans):
            return slips
        pose, covariance = slips.pose.copy(), slips.covariance.copy()
        displacement, quality = slips.displacement.copy(), slips.quality.copy()
        shared = np.nan_to_num(covariance[scans, pads, :, :2])  # an angle that is unknown has no covariance
        gain, left = _combined(shared, self._variance[pads])
        away_m = touched_m[scans, pads] - pose[scans, pads, :2]
        pose[scans, pads] += (gain @ away_m[..., np.newaxis])[..., 0]
        covariance[scans, pads, 2, 2] -= (gain[:, 2] * shared[:, 2]).sum(axis=1)
        covariance[scans, pads, :, :2] = np.where(np.isfinite(covariance[scans, pads, :, :2]), left, np.nan)
        covariance[scans, pads, :2, 2] = covariance[scans, pads, 2, :2]
        moved = displacement[scans, pads, :2]
        displacement[scans, pads, :2] = np.where(np.isfinite(moved), 0.0, moved)  # the first of a contact has none
        quality[scans, pads] = np.where(quality[scans, pads] == AMBIGUOUS, OK, quality[scans, pads])
        return replace(slips, pose=pose, covariance=covariance, displacement=displacement, quality=quality)


def _combined(shared: Floats, variance: Floats) -> tuple[Floats, Floats]:
    """Gain (n, 3, 2), and what a prior (n,) of each place leaves of covariances (n, 3, 2) of poses with their places.

    Along the axes of the places' covariances, where nothing cancels: one may be that of an object that is anywhere.
    """
    own, axes = np.linalg.eigh(shared[:, :2])
    turned, total = shared @ axes, (np.maximum(own, 0.0) + variance[:, np.newaxis])[:, np.newaxis]
    turned[:, :2] = axes * np.maximum(own, 0.0)[:, np.newaxis]
    back = axes.transpose(0, 2, 1)
    return turned / total @ back, variance[:, np.newaxis, np.newaxis] * turned / total @ back
