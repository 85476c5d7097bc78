"""The simplest fusion: the mean translation of the loaded pads, whose frames are taken as parallel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import Floats, Motions

if TYPE_CHECKING:
    from taxelflow.messages import Slips


class MeanTranslation:
    """Mean velocity and summed mean displacement over the pads that know theirs; a new contact starts at 0."""

    def __init__(self) -> None:
        self._moved = np.zeros(2)
        self._touching = False

    def step(self, slips: Slips) -> Motions:
        """Motion per scan. The pose is unknown while nothing touches, 0 at first contact."""
        scans = len(slips)
        known = slips.valid
        pads = known.sum(axis=1)
        share = np.divide(known, pads[:, np.newaxis], out=np.zeros(known.shape), where=pads[:, np.newaxis] > 0)
        displacement = _weighted(slips.displacement[..., :2], share)
        velocity = np.full((scans, 3), np.nan)
        pose = np.full((scans, 3), np.nan)
        covariance = np.full((scans, 3, 3), np.nan)
        moving = pads > 0
        velocity[moving, :2] = _weighted(slips.velocity[..., :2], share)[moving]
        of_velocity = slips.displacement_covariance[..., :2, :2] / slips.span_s[..., np.newaxis, np.newaxis] ** 2
        covariance[moving, :2, :2] = _weighted(of_velocity, share**2)[moving]
        for scan, touching in enumerate(np.any(slips.contact, axis=1).tolist()):
            if touching:
                self._moved = self._moved + displacement[scan] if self._touching else np.zeros(2)
                pose[scan, :2] = self._moved
            self._touching = touching
        return Motions(slips.t_s, velocity, pose, covariance, pads)


def _weighted(values: Floats, share: Floats) -> Floats:
    """Sum over pads of (scans, pads, ...) with weights (scans, pads); unknown values have weight 0."""
    weights = share.reshape(*share.shape, *(1,) * (values.ndim - 2))
    total: Floats = np.where(weights > 0, values * weights, 0.0).sum(axis=1)
    return total
