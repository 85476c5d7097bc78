"""Where the camera stands so that all that is to be seen fits into the picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Floats

FOV_RAD = 0.4
"""Vertical field of view: narrow, so that pads far from the middle are not distorted."""
MARGIN = 1.06
_ROUNDS = 12


class Camera(NamedTuple):
    """Place and target of the camera, (3,), m."""

    position: Floats
    look_at: Floats

    @property
    def wxyz(self) -> Floats:
        """(4,), orientation of a camera whose z looks ahead and whose y is down, with z of the scene up."""
        right, up, out = picture_axes(self.position - self.look_at)
        from viser.transforms import SO3

        return SO3.from_matrix(np.stack([right, -up, -out], axis=1)).wxyz.astype(np.float64)


class Axes(NamedTuple):
    """Unit vectors (3,) of a picture: right, up, and out of it towards the camera."""

    right: Floats
    up: Floats
    out: Floats


def picture_axes(direction: Floats) -> Axes:
    """Axes of a picture taken from a direction (3,), with z up as far as possible (y if it looks along z)."""
    out = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    above = np.array([0.0, 1.0, 0.0]) if abs(out[2]) > 0.999 else np.array([0.0, 0.0, 1.0])
    right = np.cross(above, out)
    right /= np.linalg.norm(right)
    return Axes(right, np.cross(out, right), out)


def fitted(points: Floats, direction: Floats, aspect: float) -> Camera:
    """The nearest camera in a direction (3,) that sees all points (n, 3), centred. aspect: width over height."""
    axes = picture_axes(direction)
    own = points @ np.stack(axes, axis=1)
    tangent = np.tan(FOV_RAD / 2) / MARGIN
    reach = np.array([tangent * aspect, tangent])
    middle, far = (own[:, :2].min(axis=0) + own[:, :2].max(axis=0)) / 2, 0.0
    for _ in range(_ROUNDS):
        far = float((np.abs(own[:, :2] - middle) / reach + own[:, 2:]).max())
        at = (own[:, :2] - middle) / (far - own[:, 2:])
        middle = middle + 0.5 * (at.min(axis=0) + at.max(axis=0)) * (far - own[:, 2].mean())
    depth = float(own[:, 2].mean())
    look_at = middle @ np.stack(axes[:2]) + depth * axes.out
    return Camera(look_at + (far - depth) * axes.out, look_at)
