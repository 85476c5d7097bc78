"""Which point of a round object a smooth contact follows: the centre of its curvature, not the surface.

Where a smooth object touches a pad, its normal is that of the pad. The place of the contact shows how the centre of
curvature moves along the pad, and nothing of how the surface turns about it (Montana 1988, The kinematics of contact
and grasp). A round object that several pads touch has one centre, where the normals of its contacts meet, or an axis,
which they all cross. With contacts taken at these points, spins about them come out as not observable.
"""

from __future__ import annotations

import numpy as np

from taxelflow.messages import Bools, Floats

_PARALLEL = 1e-3
"""Information on where along parallel normals they meet: they do not, and the contacts' mean is taken."""


def centres(frames: Floats, known: Bools, smooth: Bools, pitch_m: float) -> Floats:
    """(scans, pads, 3), m, in the axes of each contact: from it to the point that it shows; 0 if it is not smooth.

    frames: (scans, pads, 4, 4), of the contacts in the hand, z into the object. known, smooth: (scans, pads). pitch_m:
    how well a contact's place is known, so that points closer together than this are one, or lie on one line.
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
    information = across.sum(axis=1) + _PARALLEL * count[..., np.newaxis] * np.eye(3)
    meeting = np.linalg.solve(information, np.einsum("spij,spj->si", across, off)[..., np.newaxis])[:, np.newaxis, :, 0]
    under = np.maximum(np.einsum("spi,spi->sp", normal, meeting - off), 0.0)[..., np.newaxis]
    point = np.where(use[..., np.newaxis], off + under * normal - meeting, 0.0)
    spread, axes = np.linalg.eigh(np.swapaxes(point, 1, 2) @ point / np.maximum(use.sum(axis=1), 1)[:, None, None])
    apart = axes * (spread > pitch_m**2)[:, np.newaxis]
    point = point @ apart @ np.swapaxes(axes, 1, 2)
    to_point = np.einsum("spji,spj->spi", frames[..., :3, :3], meeting + point - off)
    found[some] = np.where(use[..., np.newaxis], to_point, 0.0)
    return found
