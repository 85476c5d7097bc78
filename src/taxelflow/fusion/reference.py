"""The point of the object that a pad's pose refers to."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.fusion.observability import BLIND
from taxelflow.numerics.rounding import BLIND_M
from taxelflow.runtime.blocks import is_block
from taxelflow.runtime.compiling import kernel

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats, Slips, Texture

UNOBSERVABLE_M, UNOBSERVABLE_M_S = BLIND.far * BLIND_M, BLIND.far * BLIND.m_s
"""Standard deviations of position and velocity in a direction that a contact's pattern does not show, m and m/s: as
large as those of a direction that is not observable in space."""


class Reference:
    """Points of the object by pad, block by block; remembers each contact's offset."""

    def __init__(self, pads: int) -> None:
        self._offset = np.full((pads, 2), np.nan)

    def step(self, slips: Slips, centroid: Floats, texture: Texture | None = None) -> Floats:
        """(scans, pads, 2) in the pads' frames, m; NaN where the pose is unknown. centroid: (scans, pads, 2).

        With a known rotation the pose is that of a fixed point of the object. Otherwise the point is the contact's
        centroid in the first scan with a pose and a centroid, moved with the pose.
        """
        turns = slips.contact if texture is None else texture.turns
        point = np.empty(centroid.shape)
        marks = (turns, slips.contact)
        place = place_block if is_block(len(slips), place_points) else place_points
        place(slips.pose, texture is not None, marks, np.ascontiguousarray(centroid), self._offset, point)
        return point


def place_block(
    pose: Floats, judged: bool, marks: tuple[Bools, Bools], centroid: Floats, offset: Floats, point: Floats
) -> None:
    """`place_points` in NumPy."""
    if not len(pose):
        return
    turns, contact = marks
    turn_known = np.isfinite(pose[..., 2]) & (turns if judged else True)
    plain = turn_known | ~np.isfinite(centroid[..., 0])
    own = np.where(plain[..., np.newaxis], 0.0, centroid - pose[..., :2])
    scan = np.arange(len(pose))[:, np.newaxis]
    begin = np.maximum.accumulate(np.where(contact, 0, scan + 1), axis=0)  # of the contact
    posed = np.where(np.isfinite(pose[..., 0]), scan, len(pose))
    first = np.minimum.accumulate(posed[::-1], axis=0)[::-1]  # scan from each on that has a pose
    chosen = np.take_along_axis(first, np.minimum(begin, len(pose) - 1), axis=0)
    own = np.take_along_axis(own, np.minimum(chosen, len(pose) - 1)[..., np.newaxis], axis=0)
    held = np.isfinite(offset[:, 0]) & (begin == 0)  # from the block before
    own = np.where(held[..., np.newaxis], offset, own)
    known = contact & (held | (chosen <= scan))
    point[...] = pose[..., :2] + np.where(known[..., np.newaxis], own, 0.0)
    offset[...] = np.where(known[-1, :, np.newaxis], own[-1], np.nan)


@kernel
def place_points(
    pose: Floats, judged: bool, marks: tuple[Bools, Bools], centroid: Floats, offset: Floats, point: Floats
) -> None:
    """Fill point (scans, pads, 2). pose: (scans, pads, 3). judged: whether there is a texture. marks: (scans, pads),
    its `turns` and contact. offset: (pads, 2), NaN where there is none yet, updated.
    """
    turns, contact = marks
    for scan in range(len(pose)):
        for pad in range(len(offset)):
            own = offset[pad]
            if np.isfinite(pose[scan, pad, 0]) and not np.isfinite(own[0]):
                turn_known = np.isfinite(pose[scan, pad, 2]) and (not judged or turns[scan, pad])
                plain = turn_known or not np.isfinite(centroid[scan, pad, 0])
                own[0] = 0.0 if plain else centroid[scan, pad, 0] - pose[scan, pad, 0]
                own[1] = 0.0 if plain else centroid[scan, pad, 1] - pose[scan, pad, 1]
            if not contact[scan, pad]:
                own[0] = own[1] = np.nan
            known = np.isfinite(own[0])
            point[scan, pad, 0] = pose[scan, pad, 0] + (own[0] if known else 0.0)
            point[scan, pad, 1] = pose[scan, pad, 1] + (own[1] if known else 0.0)
