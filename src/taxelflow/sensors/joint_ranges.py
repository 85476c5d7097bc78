"""Notes on joint angles that lie beyond what a hand's model allows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Joints
    from taxelflow.sensors.kinematics import Kinematics

_ENCODER = 0.1
"""Amount by which an angle (rad), or a slide (m), may exceed its range: encoders and models have offsets."""


def notes_beyond_ranges(joints: Joints | None, model: Kinematics | None) -> list[str]:
    """A note for each joint whose angles lie outside its range by more than encoders are off."""
    if joints is None or model is None or not len(joints.t_s):
        return []
    notes = []
    for name, unit, (low, high) in zip(model.joints, model.units, model.ranges.tolist(), strict=True):
        if name not in joints.names:
            continue
        angles = joints.angles[:, joints.names.index(name)]
        smallest, largest = float(np.nanmin(angles)), float(np.nanmax(angles))
        if smallest < low - _ENCODER or largest > high + _ENCODER:
            seen = f"{smallest:.4g}" if smallest == largest else f"{smallest:.4g} to {largest:.4g}"
            notes.append(
                f"joint {name} is at {seen} {unit}, its range is {low:.4g} to {high:.4g} {unit}: "
                f"check that its angles are in {unit}"
            )
    return notes
