"""A map of the hand in space: the azimuthal equidistant projection, as of a world map around one pole.

The skin of a grasping hand lies roughly on a sphere around the object. Its centre is the point that is closest to the
normals of all taxels; the pole is the direction to the pad with the lowest place along the hand's z axis, the palm of
a BarrettHand. A place is drawn at its azimuth around the pole, at a distance of its angle from the pole times the mean
radius. On a sphere, distances from the pole are exact; those around the pole are stretched by angle / sin(angle).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.rounding import PARALLEL

if TYPE_CHECKING:
    from taxelflow.messages import Floats

_STEP_M = 1e-5
"""Step of the numerical derivative of the map."""


class SphereMap:
    """The projection of one pose of the hand. centre_m: (3,), of the sphere; radius_m: its mean radius."""

    def __init__(self, places: Floats, normals: Floats) -> None:
        """places, normals: (taxels, 3), in the hand."""
        across = np.eye(3) - normals[:, :, np.newaxis] * normals[:, np.newaxis]
        whole = across.mean(axis=0)
        least = float(np.linalg.eigvalsh(whole)[0])
        middle = places.mean(axis=0)
        if least < PARALLEL:  # a flat hand: the centre is far away, and the map a plane view
            self.centre_m = middle + 1e3 * normals.mean(axis=0)
        else:
            self.centre_m = np.linalg.solve(whole, np.einsum("nij,nj->i", across, places) / len(places))
        self.radius_m = float(np.linalg.norm(places - self.centre_m, axis=1).mean())
        pole = places[np.argsort(places[:, 2])[: max(len(places) // 7, 1)]].mean(axis=0) - self.centre_m
        pole /= np.linalg.norm(pole)
        x = np.array([1.0, 0.0, 0.0]) - pole[0] * pole
        if np.linalg.norm(x) < 0.1:
            x = np.array([0.0, 1.0, 0.0]) - pole[1] * pole
        x /= np.linalg.norm(x)
        self._axes = np.stack([x, np.cross(-pole, x), pole])

    def project(self, points: Floats) -> Floats:
        """Map points (..., 3) in the hand to (..., 2), m, as seen from the object, with the pole at 0."""
        seen = (points - self.centre_m) @ self._axes.T
        across = np.linalg.norm(seen[..., :2], axis=-1)
        angle = np.arctan2(across, seen[..., 2])
        scale = np.where(across > 0, self.radius_m * angle / np.where(across > 0, across, 1.0), 0.0)
        found: Floats = seen[..., :2] * scale[..., np.newaxis]
        return found

    def carry(self, points: Floats, vectors: Floats) -> Floats:
        """Map vectors (..., 3) at points (..., 3) to (..., 2): their directions are mapped, their lengths are kept."""
        length = np.linalg.norm(vectors, axis=-1, keepdims=True)
        step = _STEP_M * vectors / np.where(length > 0, length, 1.0)
        on_map = self.project(points + step) - self.project(points - step)
        mapped = np.linalg.norm(on_map, axis=-1, keepdims=True)
        carried: Floats = length * on_map / np.where(mapped > 0, mapped, 1.0)
        return carried

    def distortion(self, places: Floats, pairs: list[tuple[int, int]]) -> tuple[float, float]:
        """Smallest and largest distance on the map over that in space, of pairs of neighbouring taxels.

        Without neighbours, nearest taxels are used; a single taxel has no distortion.
        """
        first, second = np.array(pairs or _nearest(places), dtype=np.int64).reshape(-1, 2).T
        apart = np.linalg.norm(places[first] - places[second], axis=1)
        flat = self.project(places)
        ratio = (np.linalg.norm(flat[first] - flat[second], axis=1) / np.where(apart > 0, apart, 1.0))[apart > 0]
        return (float(ratio.min()), float(ratio.max())) if len(ratio) else (1.0, 1.0)


def _nearest(places: Floats) -> list[tuple[int, int]]:
    """Each taxel with the one nearest to it in space."""
    if len(places) < 2:
        return []
    from scipy.spatial import cKDTree

    nearest = np.asarray(cKDTree(places).query(places, k=2)[1])[:, 1]
    return list(enumerate(nearest.tolist()))
