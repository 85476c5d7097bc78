"""Frames of contacts on a pad's skin in space: position, tangents and normal at a place of the flattened pad."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow.numerics.rounding import ROUNDING
from taxelflow.sensors.pad_geometry import geometry_of

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.sensors.pads import Pad


class PadSurface:
    """The skin of one pad, in the pad's own 3-D frame (that of its grid or table, before `pose`).

    plane: (4, 4), frame of the plane through all taxels, at the flattened pad's origin. flat: whether the skin is that
    plane.
    """

    def __init__(self, pad: Pad) -> None:
        geometry = geometry_of(msgspec.structs.replace(pad, pose=None))
        self._xy, self._place, self._normal = geometry.xy, geometry.place_m, geometry.normal
        self._reach_m = max(geometry.pitch_m)
        self.plane = self._fitted(np.ones((1, len(self._xy))), np.zeros((1, 2)))[0]
        error = self._place - self._xy @ self.plane[:3, :2].T - self.plane[:3, 3]
        bend = np.abs(self._normal - self.plane[:3, 2]).max()
        self.flat = len(self._xy) < 3 or (np.abs(error).max() < ROUNDING and bend < ROUNDING)

    def frames(self, xy: Floats) -> Floats:
        """(n, 4, 4): x and y along those of the flattened pad at places (n, 2), z out of the skin; NaN where unknown.

        Curved skin: a plane through the taxels nearby, weighted by a Gaussian of one pitch.
        """
        if self.flat:
            F = np.tile(self.plane, (len(xy), 1, 1))
            F[:, :3, 3] += _each(xy, self.plane[:3, :2].T)
            return F
        F = np.full((len(xy), 4, 4), np.nan)
        known = np.isfinite(xy).all(axis=1)
        squared = np.sum((xy[known, np.newaxis] - self._xy) ** 2, axis=2) / self._reach_m**2
        weight = np.exp(-0.5 * (squared - squared.min(axis=1, keepdims=True, initial=np.inf)))
        F[known] = self._fitted(weight, xy[known])
        return F

    def _fitted(self, weight: Floats, at: Floats) -> Floats:
        """Frames (n, 4, 4) at places (n, 2) by weights (n, taxels)."""
        weight = weight / weight.sum(axis=1, keepdims=True)
        mean_xy, mean = _each(weight, self._xy), _each(weight, self._place)
        off = self._xy - mean_xy[:, np.newaxis]
        weighed = (weight[..., np.newaxis] * off).transpose(0, 2, 1)
        spread = weighed @ off + ROUNDING**2 * np.eye(2)
        tangents = np.asarray(np.linalg.solve(spread, weighed @ self._place), np.float64)
        z = _each(weight, self._normal)
        z /= np.linalg.norm(z, axis=1, keepdims=True)
        x = tangents[:, 0] - np.sum(tangents[:, 0] * z, axis=1, keepdims=True) * z
        length = np.linalg.norm(x, axis=1, keepdims=True)
        x = np.where(length > ROUNDING, x / np.where(length > ROUNDING, length, 1.0), [1.0, 0.0, 0.0])
        F = np.zeros((len(at), 4, 4))
        F[:, :3, 0], F[:, :3, 1], F[:, :3, 2] = x, np.cross(z, x), z
        F[:, :3, 3] = mean + _each(at - mean_xy, tangents)
        F[:, 3, 3] = 1.0
        return F


def _each(rows: Floats, matrix: Floats) -> Floats:
    """(n, m), each of rows (n, k) times a matrix (k, m), or its own of (n, k, m).

    One by one, as a product of all at once rounds otherwise than that of a single row.
    """
    product: Floats = (rows[:, np.newaxis] @ matrix)[:, 0]
    return product
