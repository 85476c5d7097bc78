"""Placement of the camera, so that all that is drawn fits into the picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.publish.view.look import CAMERA

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Floats


class Camera(NamedTuple):
    """Place and target of the camera, (3,), m."""

    position: Floats
    look_at: Floats

    @property
    def wxyz(self) -> Floats:
        """(4,), its orientation, with z of the scene up."""
        return picture_axes(self.position - self.look_at).wxyz


class Axes(NamedTuple):
    """Unit vectors (3,) of a picture: right, up, and out of it towards the camera."""

    right: Floats
    up: Floats
    out: Floats

    @property
    def wxyz(self) -> Floats:
        """(4,), orientation of a frame whose x points right, y down, and z ahead: of a camera, of a plane before it."""
        from viser.transforms import SO3

        return SO3.from_matrix(np.stack([self.right, -self.up, -self.out], axis=1)).wxyz.astype(np.float64)


class View(NamedTuple):
    """A camera and its picture. eye: (3,), its position. front_m: distance to the nearest point. wide_m: width of the
    picture at the distance of the middle of what it shows.
    """

    axes: Axes
    eye: Floats
    front_m: float
    wide_m: float

    def nearer(self, point: Floats) -> tuple[Floats, float]:
        """Where a point (3,) has to be to be seen in the same place, before all else, and how much smaller."""
        share = min(1.0, self.front_m / float((self.eye - point) @ self.axes.out))
        return self.eye + share * (point - self.eye), share


def view_of(camera: Camera, points: Floats, wide_m: float) -> View:
    """Of points (n, 3)."""
    axes = picture_axes(camera.position - camera.look_at)
    front_m = float(((camera.position - points) @ axes.out).min())
    return View(axes, camera.position, front_m, wide_m)


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
    tangent = np.tan(CAMERA.fov_rad / 2) / CAMERA.margin
    reach = np.array([tangent * aspect, tangent])
    middle, far = (own[:, :2].min(axis=0) + own[:, :2].max(axis=0)) / 2, 0.0
    for _ in range(12):  # to the nearest camera
        far = float((np.abs(own[:, :2] - middle) / reach + own[:, 2:]).max())
        at = (own[:, :2] - middle) / (far - own[:, 2:])
        middle = middle + 0.5 * (at.min(axis=0) + at.max(axis=0)) * (far - own[:, 2].mean())
    depth = float(own[:, 2].mean())
    look_at = middle @ np.stack(axes[:2]) + depth * axes.out
    return Camera(look_at + (far - depth) * axes.out, look_at)


def clearest(place: Floats, normal: Floats, pad: NDArray[np.int64], cell_m: float) -> Floats:
    """(3,), the direction from above in which most of the skin faces the camera, and is hidden by no other pad.

    place, normal: (taxels, 3). pad: (taxels,), whose they are. cell_m: size of a taxel.
    """
    best, found = -np.inf, np.array([0.0, 0.0, 1.0])
    for height in np.radians(CAMERA.heights_deg):
        for turn in 2 * np.pi * np.arange(CAMERA.turns) / CAMERA.turns - np.pi / 2:
            direction = np.array([np.cos(turn) * np.cos(height), np.sin(turn) * np.cos(height), np.sin(height)])
            own = place @ np.stack(picture_axes(direction), axis=1)
            seen = np.where(_in_front(own, pad, cell_m), np.maximum(normal @ direction, 0.0), CAMERA.hidden_weight)
            if seen.sum() > best + 1e-9:
                best, found = float(seen.sum()), direction
    return found


def _in_front(own: Floats, pad: NDArray[np.int64], cell_m: float) -> NDArray[np.bool_]:
    """(taxels,), whether no taxel of another pad is before it in the picture. own: (taxels, 3), along its axes."""
    cells = np.floor((own[:, :2] - own[:, :2].min(axis=0)) / (2.0 * cell_m)).astype(np.int64)
    key = cells[:, 0] * (cells[:, 1].max() + 1) + cells[:, 1]
    order = np.lexsort((-own[:, 2], key))
    first = np.searchsorted(key[order], key)  # of the cell's taxels, the nearest
    found: NDArray[np.bool_] = pad[order[first]] == pad
    return found
