"""Unit shapes that the scene repeats, and rotations that stand them up."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from taxelflow.publish.view.look import BODY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.messages import Floats

NONE = 1e-9
"""Scale of what is not drawn: three.js cannot invert a scale of 0."""


class Shape(NamedTuple):
    """Triangles. vertices: (v, 3), of size 1 along z from 0 to 1. faces: (f, 3)."""

    vertices: NDArray[Any]
    faces: NDArray[Any]


def box() -> Shape:
    """A cube that stands on the origin."""
    x, y, z = np.meshgrid((-0.5, 0.5), (-0.5, 0.5), (0.0, 1.0), indexing="ij")
    corners = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))  # anticlockwise
    return Shape(corners, np.array([(side[0], *pair) for side in sides for pair in (side[1:3], side[2:])]))


def disc() -> Shape:
    """A cylinder of diameter 1 that stands on the origin."""
    return _turned(((0.0, 0.0), (0.5, 0.0), (0.5, 1.0), (0.0, 1.0)))


def arrow(head: float, shaft: float) -> Shape:
    """An arrow that stands on the origin, tip up, its head of diameter 1. head: length. shaft: diameter."""
    thin, neck = 0.5 * shaft, 1.0 - head
    return _turned(((0.0, 0.0), (thin, 0.0), (thin, neck), (0.5, neck), (0.0, 1.0)))


def ring(inner: float, high: float) -> Shape:
    """A ring of radius 1 and this height, which is still seen from its side. inner: radius of its hole."""
    low, top = -0.5 * high, 0.5 * high
    return _turned(((inner, low), (1.0, low), (1.0, top), (inner, top), (inner, low)), 64)


def inside(points: Floats) -> Shape | None:
    """The largest shrunk convex hull of points (n, 3) that holds none of them; None if it is small."""
    import trimesh

    whole = trimesh.convex.convex_hull(points)
    middle, out = whole.centroid, whole.face_normals
    reach = np.einsum("ij,ij->i", whole.triangles_center - middle, out)
    shares = ((points - middle) @ out.T / reach).max(axis=1)  # of its way to the hull, for each point
    share = BODY.spare * float(shares.min())
    if share < BODY.least:
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
    z = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    x = x_axis - (x_axis * z).sum(axis=1, keepdims=True) * z
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    frames = np.stack([x, np.cross(z, x), z], axis=2)
    from viser.transforms import SO3

    return SO3.from_matrix(frames).wxyz.astype(np.float64)


def _turned(outline: Sequence[tuple[float, float]], sections: int = 24) -> Shape:
    """An outline of (radius, height), with its solid to the left, turned about the z axis in a number of sections."""
    radius, height = np.array(outline).T
    turn = 2 * np.pi * np.arange(sections) / sections
    places = np.stack(
        np.broadcast_arrays(radius * np.cos(turn)[:, np.newaxis], radius * np.sin(turn)[:, np.newaxis], height), axis=2
    )
    count = len(outline)
    here = np.arange(sections)[:, np.newaxis] * count + np.arange(count - 1)
    there = (here + count) % (sections * count)
    quads = np.stack([here, there, there + 1, here + 1], axis=2).reshape(-1, 4)
    vertices = places.reshape(-1, 3)
    faces = quads[:, [(0, 1, 2), (0, 2, 3)]].reshape(-1, 3)
    sides = vertices[faces]
    area = np.linalg.norm(np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]), axis=1)
    return Shape(vertices, faces[area > 1e-12 * area.max()])  # those at the axis have none
