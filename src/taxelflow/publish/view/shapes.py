"""Unit shapes that the scene repeats, and rotations that stand them up."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from taxelflow.messages import Floats

NONE = 1e-9
"""Scale of what is not drawn: three.js cannot invert a scale of 0."""


_SPARE, _LEAST = 0.95, 0.4
"""Of a solid inside a skin: its size over that at which it would touch a taxel, and its least size over the skin's."""


class Shape(NamedTuple):
    """Triangles. vertices: (v, 3), of size 1 along z from 0 to 1. faces: (f, 3)."""

    vertices: NDArray[Any]
    faces: NDArray[Any]


def box() -> Shape:
    """A cube that stands on the origin."""
    import trimesh

    return _standing(trimesh.creation.box((1.0, 1.0, 1.0)), 0.5)


def disc() -> Shape:
    """A cylinder of diameter 1 that stands on the origin."""
    import trimesh

    return _standing(trimesh.creation.cylinder(0.5, 1.0, sections=24), 0.5)


def cone() -> Shape:
    """A cone of diameter 1 that stands on the origin, tip up."""
    import trimesh

    return _standing(trimesh.creation.cone(0.5, 1.0, sections=24), 0.0)


def ring(inner: float) -> Shape:
    """A flat ring of radius 1. inner: radius of its hole."""
    import trimesh

    return _standing(trimesh.creation.annulus(inner, 1.0, 1e-3, sections=64), 0.0)


def inside(points: Floats) -> Shape | None:
    """The largest shrunk convex hull of points (n, 3) that holds none of them; None if it is small."""
    import trimesh

    whole = trimesh.convex.convex_hull(points)
    middle, out = whole.centroid, whole.face_normals
    reach = np.einsum("ij,ij->i", whole.triangles_center - middle, out)
    shares = ((points - middle) @ out.T / reach).max(axis=1)  # of its way to the hull, for each point
    share = _SPARE * float(shares.min())
    if share < _LEAST:
        return None
    return Shape(middle + share * (np.asarray(whole.vertices) - middle), np.asarray(whole.faces))


def standing(normal: Floats) -> Floats:
    """(n, 4), quaternions w, x, y, z that turn z into the directions (n, 3), the short way; identity for length 0."""
    length = np.linalg.norm(normal, axis=1)
    unit = np.where(
        length[:, np.newaxis] > 0, normal / np.where(length > 0, length, 1.0)[:, np.newaxis], (0.0, 0.0, 1.0)
    )
    turns = np.stack([1.0 + unit[:, 2], -unit[:, 1], unit[:, 0], np.zeros(len(unit))], axis=1)
    turns[turns[:, 0] < 1e-9] = 0.0, 1.0, 0.0, 0.0
    quaternions: Floats = turns / np.linalg.norm(turns, axis=1, keepdims=True)
    return quaternions


def along(normal: Floats, x_axis: Floats) -> Floats:
    """(n, 4), quaternions w, x, y, z of frames with z along the normals (n, 3) and x near the directions (n, 3)."""
    from scipy.spatial.transform import Rotation

    z = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    x = x_axis - (x_axis * z).sum(axis=1, keepdims=True) * z
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    frames = np.stack([x, np.cross(z, x), z], axis=2)
    quaternions: Floats = Rotation.from_matrix(frames).as_quat()[:, (3, 0, 1, 2)]
    return quaternions


def _standing(mesh: Any, lift: float) -> Shape:
    mesh.apply_translation((0.0, 0.0, lift))
    return Shape(np.asarray(mesh.vertices), np.asarray(mesh.faces))
