"""Curved skin laid flat, as the earth on a map: places and normals in space to coordinates on a plane.

The way over the skin between two taxels is taken from their places and normals. With d the straight line between them
and a the angle between the normals, the part of d along the difference of the normals is the chord of an arc of that
angle, and the rest is straight:  way^2 = |d|^2 - chord^2 + (chord (a / 2) / sin(a / 2))^2. On a plane, a cylinder and
a sphere this is exact. The map is the set of points of the plane whose distances are closest to these ways (least
squares of relative errors, by majorisation: de Leeuw's SMACOF), so a plane and a cylinder are mapped without
distortion; what can not be flat, such as a dome, is stretched as little as possible, near neighbours least.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MOST_CURVED = 2048
_FLAT_M = 1e-6
_STEPS = 500


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """xy: (taxels, 2) on the map, m, x along the table's x axis, y to the left of it seen from outside, mean at 0.

    stretch: largest relative error of a distance between near neighbours.
    """

    xy: Floats
    stretch: float


def lay_flat(places: Floats, normals: Floats) -> Chart:
    """A chart of taxels at places (taxels, 3) in m with unit normals (taxels, 3) out of the skin.

    Raises ValueError, saying what is wrong, for skin that closes around and for too many taxels.
    """
    outwards = normals.mean(axis=0)
    if np.linalg.norm(outwards) < 0.1:
        raise ValueError(
            "the normals point all around, so that the skin closes upon itself: split it into several pads"
        )
    across = _axes(outwards / np.linalg.norm(outwards))
    seen = (places - places.mean(axis=0)) @ across.T
    if np.ptp(seen[:, 2]) < _FLAT_M and np.abs(normals - normals[:1]).max() < 1e-6:
        return Chart(seen[:, :2], 0.0)
    if len(places) > MOST_CURVED:
        raise ValueError(f"a curved pad has at most {MOST_CURVED} taxels, this one {len(places)}: split it")
    ways = _ways(places, normals)
    xy = _turned_like(_spread(ways, seen[:, :2]), seen[:, :2])
    return Chart(xy - xy.mean(axis=0), _stretch(xy, ways))


def _axes(z: Floats) -> Floats:
    """(3, 3): rows x, y, z of the tangent frame, x along the x axis where it lies in the skin, else along y."""
    along = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = along - (along @ z) * z
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def _ways(places: Floats, normals: Floats) -> Floats:
    """(taxels, taxels) lengths over the skin."""
    line = places[:, np.newaxis] - places
    bend = normals[:, np.newaxis] - normals
    size = np.linalg.norm(bend, axis=2)
    chord = np.abs(np.einsum("ijk,ijk->ij", line, bend)) / np.where(size > 0, size, 1.0)
    sine = np.clip(size / 2, 0.0, 1.0)  # of half the angle: |bend| = 2 sin(a / 2)
    arc = chord * np.where(sine > 0, np.arcsin(sine) / np.where(sine > 0, sine, 1.0), 1.0)
    squares = np.sum(line**2, axis=2) - chord**2 + arc**2
    ways: Floats = np.sqrt(np.maximum(squares, 0.0))
    return ways


def _spread(ways: Floats, start: Floats) -> Floats:
    """Points (taxels, 2) whose distances are closest to the ways, each weighed by 1 / way^2."""
    from scipy.linalg import cho_factor, cho_solve

    count = len(ways)
    weights = 1.0 / np.maximum(ways, 1e-9) ** 2
    np.fill_diagonal(weights, 0.0)
    weights /= weights.max()
    laplacian = np.diag(weights.sum(axis=1)) - weights + np.ones((count, count)) * weights.mean()
    factor = cho_factor(laplacian)
    xy = _classical(ways, start)
    for _ in range(_STEPS):
        apart = np.linalg.norm(xy[:, np.newaxis] - xy, axis=2)
        pull = weights * ways / np.where(apart > 0, apart, 1.0)
        np.fill_diagonal(pull, 0.0)
        better = cho_solve(factor, np.diag(pull.sum(axis=1)) @ xy - pull @ xy)
        moved, xy = np.abs(better - xy).max(), better
        if moved < 1e-10:
            break
    return xy


def _classical(ways: Floats, start: Floats) -> Floats:
    """Where to begin: classical scaling, exact where the skin can be flat."""
    centred = ways**2
    centred = centred - centred.mean(axis=0) - centred.mean(axis=1)[:, np.newaxis] + centred.mean()
    values, vectors = np.linalg.eigh(-0.5 * centred)
    xy: Floats = vectors[:, -2:] * np.sqrt(np.maximum(values[-2:], 0.0))
    return xy if np.ptp(xy, axis=0).min() > _FLAT_M else start


def _turned_like(xy: Floats, seen: Floats) -> Floats:
    """Turned and, if need be, mirrored to lie as it is seen from outside."""
    left, _, right = np.linalg.svd((xy - xy.mean(axis=0)).T @ seen)
    turned: Floats = xy @ (left @ right)
    return turned


def _stretch(xy: Floats, ways: Floats) -> float:
    apart = np.linalg.norm(xy[:, np.newaxis] - xy, axis=2)
    far = ways + np.diag(np.full(len(ways), np.inf))
    near = far < 1.6 * np.median(far.min(axis=1))
    return float(np.max(np.abs(apart[near] / ways[near] - 1.0), initial=0.0))
