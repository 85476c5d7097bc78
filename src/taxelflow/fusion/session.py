"""The session of the rigid field: slips of all pads, brought to the hand frame, become one motion of the object.

Velocity, rotor and centre are a fit of the displacements (`twist`). Position and turn since first contact are a rigid
fit of the places where the contacts are (`pose`), not a sum of displacements.

A pose whose turn is known is that of a point of the object. One without a turn moves with the contact, at a constant
offset in the pad's frame: the point of the object is then the contact's centroid, where it began, moved with the pose.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.fusion.anchors import Anchor, Body
from taxelflow.fusion.forming import Forming
from taxelflow.fusion.hand_frame import Carrier, Home
from taxelflow.fusion.pose import follow_pose
from taxelflow.fusion.reference import Reference
from taxelflow.fusion.twist import Equations, Row, fuse_twists
from taxelflow.messages import Bools, Floats, Motions, Slips, Texture
from taxelflow.numerics.geometry import rotation
from taxelflow.numerics.records import records, unknown
from taxelflow.runtime.settled import Settled

if TYPE_CHECKING:
    from taxelflow.sensors.layout import Layout


class FieldSession:
    """Fuses block by block; remembers where each contact lay on the object."""

    def __init__(self, layout: Layout, edge_doubt: float) -> None:
        """edge_doubt: see `RigidField`."""
        placed: Bools = np.asarray(np.isfinite(layout.T_hand).all(axis=1))
        self._turns = bool(placed.any())  # where no pad has a place, the mean translation is all there is
        home = np.where(placed[:, np.newaxis], layout.T_hand, 0.0)
        used: Bools = layout.independent & (placed if self._turns else True)
        origin, pitch_m = np.ascontiguousarray(home[:, :2]), np.ascontiguousarray(layout.pitch_m)
        self._carrier = Carrier(Home(rotation(home[:, 2]), origin, pitch_m, used, edge_doubt))
        self._fuse, self._follow = Settled(fuse_twists), Settled(follow_pose)
        self._anchors, self._body = records(Anchor, len(layout.pads)), records(Body, 1)
        self._scratch = records(Equations, 1)
        self._reference, self._forming = Reference(len(layout.pads)), Forming(layout)
        self.step(nothing(len(layout.pads)), np.zeros((0, len(layout.pads), 2)))  # compiles before the loop begins

    def step(self, slips: Slips, centroid: Floats, texture: Texture | None = None) -> Motions:
        """Motion per scan; unknown (NaN) while nothing touches. centroid: (scans, pads, 2), see `Contacts`. texture:
        without one every pattern shows all directions.
        """
        point = self._reference.step(slips, centroid, texture)
        here, place_cov, moved_cov = self._carrier.step(slips, point, self._forming.step(slips), texture)
        rows = unknown(Row, len(slips))
        turns, scratch = self._turns, self._scratch
        self._fuse(here, moved_cov, slips.span_s, turns, scratch, rows)
        self._follow(here, place_cov, turns, self._anchors, self._body, scratch, rows)
        return Motions(
            t_s=slips.t_s,
            velocity=rows["velocity"],
            velocity_covariance=rows["velocity_covariance"],
            rotor=rows["rotor"],
            rotor_std=rows["rotor_std"],
            centre=rows["centre"],
            centre_std=rows["centre_std"],
            pose=rows["pose"],
            pose_covariance=rows["pose_covariance"],
            pads=rows["pads"].astype(np.int64),
        )


def nothing(pads: int) -> Slips:
    """A block of no scans."""
    three, matrix, one = np.zeros((0, pads, 3)), np.zeros((0, pads, 3, 3)), np.zeros((0, pads))
    none, border = np.zeros((0, pads), dtype=np.bool_), np.zeros((0, pads, 2), dtype=np.bool_)
    quality = np.zeros((0, pads), dtype=np.uint8)
    return Slips(np.zeros(0), none, border, three, three, matrix, matrix, one, one, one, one, quality)
