"""The point of the object that a pad's pose stands for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.runtime.compiling import kernel

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats, Slips, Texture


UNOBSERVABLE_M, UNOBSERVABLE_M_S = 0.05, 0.2
"""Standard deviations of place and velocity in a direction that a contact's pattern does not tell, m and m/s: ten times
those from which the motion in space calls a direction not observable."""


class Reference:
    """Points of the object by pad, block by block; remembers each contact's offset."""

    def __init__(self, pads: int) -> None:
        self._offset = np.full((pads, 2), np.nan)

    def step(self, slips: Slips, centroid: Floats, texture: Texture | None = None) -> Floats:
        """(scans, pads, 2) in the pads' frames, m; NaN where the pose is unknown. centroid: (scans, pads, 2).

        With a known turn the pose is that of a point of the object. Without, or if the pattern does not tell it, the
        point is the contact's centroid in the first scan of the contact that has both, moved with the pose.
        """
        turns = slips.contact if texture is None else texture.turns
        point = np.empty(centroid.shape)
        marks = (turns, slips.contact)
        place_points(slips.pose, texture is not None, marks, np.ascontiguousarray(centroid), self._offset, point)
        return point


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
                told = np.isfinite(pose[scan, pad, 2]) and (not judged or turns[scan, pad])
                plain = told or not np.isfinite(centroid[scan, pad, 0])
                own[0] = 0.0 if plain else centroid[scan, pad, 0] - pose[scan, pad, 0]
                own[1] = 0.0 if plain else centroid[scan, pad, 1] - pose[scan, pad, 1]
            if not contact[scan, pad]:
                own[0] = own[1] = np.nan
            known = np.isfinite(own[0])
            point[scan, pad, 0] = pose[scan, pad, 0] + (own[0] if known else 0.0)
            point[scan, pad, 1] = pose[scan, pad, 1] + (own[1] if known else 0.0)
