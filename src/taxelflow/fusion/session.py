"""The field at work: resultant, rotor, centre of rotation, and how far the object has come.

Slip vectors S_i at places r_i on the flattened hand, the paper's section on rotation:
    resultant and rotation    S_i = v + omega x r_i, weighted least squares; v is the velocity at the hand's origin
    rotor, equation (8)       dS_y/dx - dS_x/dy of the affine field that fits the vectors best; 2 omega if rigid
    no rotation, equation (9) for a rigid motion the rotor is the same everywhere, so that no place is without it
                              unless all are; what the hand can use is the centre, where the velocity is 0
Position and turn since first contact are a rigid fit of the places where the contacts were, not a sum of increments.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.fusion.pose import MEMORY, follow_pose
from taxelflow.fusion.twist import (
    CENTRE_X,
    COLUMNS,
    COUNT,
    COV_POSE,
    COV_TWIST,
    POSE,
    ROTOR,
    STD_CENTRE_X,
    STD_ROTOR,
    TWIST,
    fuse_twists,
)
from taxelflow.geometry import rotation
from taxelflow.messages import Bools, Floats, Motions, Slips

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
        self._memory = np.zeros((len(layout.pads), MEMORY))
        self._object = np.zeros(13)
        self.step(_nothing(len(layout.pads)))  # compiles, or loads, before the loop begins

    def step(self, slips: Slips) -> Motions:
        """Motion per scan; unknown (NaN) while nothing touches."""
        place, place_cov, moved, moved_cov, turn = self._in_hand(slips)
        rows = np.full((len(slips), COLUMNS), np.nan)
        known: Bools = slips.valid & self._used
        fuse_twists(place, moved, moved_cov, turn, slips.span_s, known, self._turns, rows)
        touching: Bools = np.isfinite(place[..., 0]) & slips.contact & self._used
        any_contact: Bools = np.asarray((slips.contact & self._used).any(axis=1))
        spin = np.stack([slips.pose[..., 2], slips.covariance[..., 2, 2]], axis=-1)
        follow_pose(place, place_cov, spin, touching, any_contact, self._turns, self._memory, self._object, rows)
        return Motions(
            t_s=slips.t_s,
            velocity=rows[:, TWIST : TWIST + 3],
            velocity_covariance=rows[:, COV_TWIST : COV_TWIST + 9].reshape(-1, 3, 3),
            rotor=rows[:, ROTOR],
            rotor_std=rows[:, STD_ROTOR],
            centre=rows[:, CENTRE_X : CENTRE_X + 2],
            centre_std=rows[:, STD_CENTRE_X : STD_CENTRE_X + 2],
            pose=rows[:, POSE : POSE + 3],
            pose_covariance=rows[:, COV_POSE : COV_POSE + 9].reshape(-1, 3, 3),
            pads=np.nan_to_num(rows[:, COUNT]).astype(np.int64),
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
