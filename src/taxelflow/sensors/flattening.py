"""Curved skin flattened to a plane: positions and normals in space to 2-D coordinates that keep distances.

The geodesic distance between two taxels is estimated from their positions and normals. With d the vector between them
and a the angle between the normals, the part of d along the difference of the normals is the chord of an arc of that
angle, and the rest is straight:  geodesic^2 = |d|^2 - chord^2 + (chord (a / 2) / sin(a / 2))^2.  On a plane, a cylinder
and a sphere this is exact. The coordinates are those whose distances are closest to the geodesic ones: least squares
of relative errors by majorisation (SMACOF; de Leeuw 1977), from classical multidimensional scaling. A plane and a
cylinder are thus mapped without distortion; a surface that cannot be flat, such as a dome, is distorted as little as
possible, least between near neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taxelflow.numerics.rounding import REACH

Floats = NDArray[np.float64]

MOST_CURVED = 2048
"""Taxels of a curved pad: memory and time grow with the square of their number."""


@dataclass(frozen=True, slots=True)
class _Shape:
    """What counts as flat, and when the map of a curved skin has converged."""

    flat_m: float = 1e-6
    """A skin whose height varies by less is a plane."""
    flat_normal: float = 1e-6
    """Largest difference of components between the unit normals of a plane."""
    least_mean_normal: float = 0.1
    """Norm of the mean unit normal below which the skin has no outside that one view shows."""
    most_steps: int = 500
    """Steps of SMACOF: the built-in sensors need at most about 100."""
    converged_m: float = 1e-10
    """Largest step of a coordinate at which SMACOF has converged."""
    least_geodesic_m: float = 1e-9
    """Guards the weight 1 / geodesic^2 of coincident taxels."""


_SHAPE = _Shape()


@dataclass(frozen=True, slots=True, eq=False)
class Flattening:
    """xy: (taxels, 2) in the plane, m, mean at 0; x along the table's x axis, y to the left of it seen from outside.

    stretch: largest relative error of a distance between neighbours.
    """

    xy: Floats
    stretch: float


def flatten(positions: Floats, normals: Floats) -> Flattening:
    """Flatten taxels at positions (taxels, 3) in m with unit normals (taxels, 3) out of the skin.

    Raises ValueError, with the cause and after a colon the remedy, for skin that closes around and for too many taxels.
    """
    outwards = normals.mean(axis=0)
    if np.linalg.norm(outwards) < _SHAPE.least_mean_normal:
        raise ValueError("the normals point in all directions, the skin is closed: split it into several pads")
    axes = _tangent_frame(outwards / np.linalg.norm(outwards))
    projected = (positions - positions.mean(axis=0)) @ axes.T
    if np.ptp(projected[:, 2]) < _SHAPE.flat_m and np.abs(normals - normals[:1]).max() < _SHAPE.flat_normal:
        return Flattening(projected[:, :2], 0.0)
    if len(positions) > MOST_CURVED:
        raise ValueError(f"a curved pad has at most {MOST_CURVED} taxels, this one {len(positions)}: split it")
    geodesic = _geodesic_distances(positions, normals)
    xy = _aligned(_smacof(geodesic, projected[:, :2]), projected[:, :2])
    return Flattening(xy - xy.mean(axis=0), _stretch(xy, geodesic))


def _tangent_frame(z: Floats) -> Floats:
    """(3, 3): rows x, y, z; x along the x axis where that is tangential, else along the y axis."""
    reference = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = reference - (reference @ z) * z
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def _geodesic_distances(positions: Floats, normals: Floats) -> Floats:
    """(taxels, taxels), m; the equation at the top."""
    d = positions[:, np.newaxis] - positions
    bend = normals[:, np.newaxis] - normals
    size = np.linalg.norm(bend, axis=2)
    chord = np.abs(np.einsum("ijk,ijk->ij", d, bend)) / np.where(size > 0, size, 1.0)
    sine = np.clip(size / 2, 0.0, 1.0)  # of half the angle: |bend| = 2 sin(a / 2)
    arc = chord * np.where(sine > 0, np.arcsin(sine) / np.where(sine > 0, sine, 1.0), 1.0)
    squares = np.sum(d**2, axis=2) - chord**2 + arc**2
    geodesic: Floats = np.sqrt(np.maximum(squares, 0.0))
    return geodesic


def _smacof(geodesic: Floats, fallback: Floats) -> Floats:
    """(taxels, 2): minimises the sum of (distance - geodesic)^2 / geodesic^2. fallback: (taxels, 2) to start from."""
    from scipy.linalg import cho_factor, cho_solve

    count = len(geodesic)
    weights = 1.0 / np.maximum(geodesic, _SHAPE.least_geodesic_m) ** 2
    np.fill_diagonal(weights, 0.0)
    weights /= weights.max()
    laplacian = np.diag(weights.sum(axis=1)) - weights + np.ones((count, count)) * weights.mean()
    factor = cho_factor(laplacian)
    xy = _classical_scaling(geodesic, fallback)
    for _ in range(_SHAPE.most_steps):
        distance = np.linalg.norm(xy[:, np.newaxis] - xy, axis=2)
        pull = weights * geodesic / np.where(distance > 0, distance, 1.0)
        np.fill_diagonal(pull, 0.0)
        better = cho_solve(factor, np.diag(pull.sum(axis=1)) @ xy - pull @ xy)
        step, xy = np.abs(better - xy).max(), better
        if step < _SHAPE.converged_m:
            break
    return xy


def _classical_scaling(geodesic: Floats, fallback: Floats) -> Floats:
    """Classical multidimensional scaling (Torgerson 1952), exact where the skin can be flat."""
    centred = geodesic**2
    centred = centred - centred.mean(axis=0) - centred.mean(axis=1)[:, np.newaxis] + centred.mean()
    values, vectors = np.linalg.eigh(-0.5 * centred)
    xy: Floats = vectors[:, -2:] * np.sqrt(np.maximum(values[-2:], 0.0))
    return xy if np.ptp(xy, axis=0).min() > _SHAPE.flat_m else fallback


def _aligned(xy: Floats, projected: Floats) -> Floats:
    """Rotated, and mirrored if necessary, to match the view from outside (orthogonal Procrustes problem)."""
    left, _, right = np.linalg.svd((xy - xy.mean(axis=0)).T @ projected)
    rotated: Floats = xy @ (left @ right)
    return rotated


def _stretch(xy: Floats, geodesic: Floats) -> float:
    """Largest relative error of a distance between neighbours."""
    distance = np.linalg.norm(xy[:, np.newaxis] - xy, axis=2)
    others = geodesic + np.diag(np.full(len(geodesic), np.inf))
    near = others < REACH.neighbour * np.median(others.min(axis=1))
    return float(np.max(np.abs(distance[near] / geodesic[near] - 1.0), initial=0.0))
