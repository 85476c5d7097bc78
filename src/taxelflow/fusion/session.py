"""The session of the rigid field: slips of all pads, brought to the hand frame, become one motion of the object.

Velocity, rotor and centre are a fit of the displacements (`twist`). Position and turn since first contact are a rigid
fit of the places where the contacts are (`pose`), not a sum of displacements.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.fusion.pose import Anchor, Body, follow_pose
from taxelflow.fusion.twist import Row, fuse_twists
from taxelflow.geometry import rotation
from taxelflow.messages import Bools, Floats, Motions, Slips
from taxelflow.numerics.records import records, unknown

if TYPE_CHECKING:
    from taxelflow.sensors.layout import Layout


class FieldSession:
    """Fuses block by block; remembers where each contact lay on the object."""

    def __init__(self, layout: Layout, edge_doubt: float) -> None:
        """edge_doubt: see `RigidField`."""
        self._doubt = edge_doubt
        placed: Bools = np.asarray(np.isfinite(layout.T_hand).all(axis=1))
        self._turns = bool(placed.any())  # where no pad has a place, the mean translation is all there is
        home = np.where(placed[:, np.newaxis], layout.T_hand, 0.0)
        self._used: Bools = layout.independent & (placed if self._turns else True)
        self._R, self._origin = rotation(home[:, 2]), home[:, :2]
        self._pitch_m = layout.pitch_m
        self._anchors, self._body = records(Anchor, len(layout.pads)), records(Body, 1)
        self.step(_nothing(len(layout.pads)))  # compiles, or loads, before the loop begins

    def step(self, slips: Slips) -> Motions:
        """Motion per scan; unknown (NaN) while nothing touches."""
        place, place_cov, moved, moved_cov, turn = self._in_hand(slips)
        rows = unknown(Row, len(slips))
        known: Bools = slips.valid & self._used
        fuse_twists(place, moved, moved_cov, turn, slips.span_s, known, self._turns, rows)
        touching: Bools = np.isfinite(place[..., 0]) & slips.contact & self._used
        any_contact: Bools = np.asarray((slips.contact & self._used).any(axis=1))
        own_turn = np.stack([slips.pose[..., 2], slips.covariance[..., 2, 2]], axis=-1)
        follow_pose(place, place_cov, own_turn, touching, any_contact, self._turns, self._anchors, self._body, rows)
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

    def _in_hand(self, slips: Slips) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Places, displacements and their covariances (scans, pads, 2[, 2]) in the hand; turns (scans, pads, 2)."""
        doubt = self._doubt * slips.border
        across = np.zeros((*slips.contact.shape, 2, 2))
        moved = slips.displacement[..., :2]
        most = np.max(np.nan_to_num(np.hypot(moved[..., 0], moved[..., 1])), axis=1)  # what an edge may have hidden
        across[..., [0, 1], [0, 1]] = (doubt * most[:, np.newaxis, np.newaxis]) ** 2
        moved_cov = slips.displacement_covariance[..., :2, :2] + across
        across[..., [0, 1], [0, 1]] = (doubt * self._pitch_m) ** 2
        place_cov = slips.covariance[..., :2, :2] + across
        R = self._R
        turn = np.stack([slips.displacement[..., 2], slips.displacement_covariance[..., 2, 2]], axis=-1)
        return (
            np.einsum("pij,spj->spi", R, slips.pose[..., :2]) + self._origin,
            np.ascontiguousarray(R @ place_cov @ R.transpose(0, 2, 1)),
            np.einsum("pij,spj->spi", R, moved),
            np.ascontiguousarray(R @ moved_cov @ R.transpose(0, 2, 1)),
            turn,
        )


def _nothing(pads: int) -> Slips:
    """A block of no scans."""
    three, matrix, one = np.zeros((0, pads, 3)), np.zeros((0, pads, 3, 3)), np.zeros((0, pads))
    none, border = np.zeros((0, pads), dtype=np.bool_), np.zeros((0, pads, 2), dtype=np.bool_)
    quality = np.zeros((0, pads), dtype=np.uint8)
    return Slips(np.zeros(0), none, border, three, three, matrix, matrix, one, one, one, one, quality)
