"""The point of a round object whose motion a smooth contact observes: the centre of curvature, not the surface point.

Where a smooth object touches a pad, its normal is that of the pad. So the contact's place shows how the centre of
curvature moves along the pad, but not how the surface rotates about it (Montana 1988, The kinematics of contact and
grasp). A round object that several pads touch has one centre, where the normals of its contacts meet, or an axis that
all normals cross. With contacts placed at these points, rotations about them are not observable, as they should be.
"""

from __future__ import annotations

import numpy as np

from taxelflow.messages import Bools, Floats
from taxelflow.numerics.rounding import PARALLEL


def centres(frames: Floats, known: Bools, smooth: Bools, pitch_m: float) -> Floats:
    """(scans, pads, 3), m, in the axes of each contact: from it to the observed point; 0 if it is not smooth.

    frames: (scans, pads, 4, 4), of the contacts in the hand, z into the object. known, smooth: (scans, pads). pitch_m:
    error of a contact's place: points closer together than this are one point, or lie on one line.
    """
    found = np.zeros((*known.shape, 3))
    use = known & smooth
    some = use.any(axis=1)
    if not some.any():
        return found
    frames, weight, use = np.nan_to_num(frames[some]), known[some][..., np.newaxis].astype(np.float64), use[some]
    place, normal = weight * frames[..., :3, 3], weight * frames[..., :3, 2]
    count = np.maximum(weight.sum(axis=1), 1.0)
    off = place - weight * (place.sum(axis=1) / count)[:, np.newaxis]
    across = weight[..., np.newaxis] * np.eye(3) - normal[..., :, np.newaxis] * normal[..., np.newaxis, :]
    # Parallel normals meet at the height of the contacts' mean.
    information = across.sum(axis=1) + PARALLEL * count[..., np.newaxis] * np.eye(3)
    meeting = np.linalg.solve(information, np.einsum("spij,spj->si", across, off)[..., np.newaxis])[:, np.newaxis, :, 0]
    under = np.maximum(np.einsum("spi,spi->sp", normal, meeting - off), 0.0)[..., np.newaxis]
    point = np.where(use[..., np.newaxis], off + under * normal - meeting, 0.0)
    spread, axes = np.linalg.eigh(np.swapaxes(point, 1, 2) @ point / np.maximum(use.sum(axis=1), 1)[:, None, None])
    apart = axes * (spread > pitch_m**2)[:, np.newaxis]
    point = point @ apart @ np.swapaxes(axes, 1, 2)
    to_point = np.einsum("spji,spj->spi", frames[..., :3, :3], meeting + point - off)
    found[some] = np.where(use[..., np.newaxis], to_point, 0.0)
    return found
