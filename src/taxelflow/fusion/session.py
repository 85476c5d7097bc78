"""The session of the rigid field: slips of all pads, brought to the hand frame, become one motion of the object.

Velocity, rotor and centre are a fit of the displacements (`twist`). Position and turn since first contact are a rigid
fit of the places where the contacts are (`pose`), not a sum of displacements.

A pose whose turn is known is that of a point of the object. One without a turn moves with the contact, at a constant
offset in the pad's frame: the point of the object is then the contact's centroid, where it began, moved with the pose.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.fusion.pose import Anchor, Body, follow_pose
from taxelflow.fusion.reference import UNTOLD_M, UNTOLD_M_S, Reference
from taxelflow.fusion.twist import Equations, Row, fuse_twists
from taxelflow.geometry import rotation
from taxelflow.messages import AMBIGUOUS, Bools, Floats, Motions, Slips, Texture
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
        self._R_back = self._R.transpose(0, 2, 1)
        self._pitch_m = layout.pitch_m
        self._anchors, self._body = records(Anchor, len(layout.pads)), records(Body, 1)
        self._scratch = records(Equations, 1)
        self._reference = Reference(len(layout.pads))
        self.step(nothing(len(layout.pads)), np.zeros((0, len(layout.pads), 2)))  # compiles before the loop begins

    def step(self, slips: Slips, centroid: Floats, texture: Texture | None = None) -> Motions:
        """Motion per scan; unknown (NaN) while nothing touches. centroid: (scans, pads, 2), see `Contacts`. texture:
        without one every pattern tells all directions.
        """
        point = self._reference.step(slips, centroid, texture)
        place, place_cov, moved, moved_cov, turn = self._in_hand(slips, point, texture)
        rows = unknown(Row, len(slips))
        known: Bools = slips.valid & self._used
        span_s = np.ascontiguousarray(slips.span_s)  # kernels are compiled for one layout only
        fuse_twists(place, moved, moved_cov, turn, span_s, known, self._turns, self._scratch, rows)
        held: Bools = slips.contact & self._used
        told: Bools = np.isfinite(place[..., 0]) & held
        kept: Bools = held & (np.isfinite(slips.displacement[..., 0]) | ~told)
        own_turn = _turn(slips.pose, slips.covariance, texture)
        anchors, body, turns = self._anchors, self._body, self._turns
        follow_pose(place, place_cov, own_turn, told, kept, turns, anchors, body, self._scratch, rows)
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

    def _in_hand(
        self, slips: Slips, point: Floats, texture: Texture | None
    ) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Places, displacements and their covariances (scans, pads, 2[, 2]) in the hand; turns (scans, pads, 2)."""
        moved = slips.displacement[..., :2]
        own = np.empty((2, *slips.contact.shape, 2, 2))
        own[0], own[1] = slips.covariance[..., :2, :2], slips.displacement_covariance[..., :2, :2]
        cut_off = slips.border & (slips.quality == AMBIGUOUS)[..., np.newaxis]
        if cut_off.any():
            doubt = self._doubt * cut_off
            most = np.fmax.reduce(
                np.hypot(moved[..., 0], moved[..., 1]), axis=1, initial=0.0
            )  # an edge may have hidden
            along = own.reshape(2, *slips.contact.shape, 4)[..., ::3]
            along[0] += (doubt * self._pitch_m) ** 2
            along[1] += (doubt * most[:, np.newaxis, np.newaxis]) ** 2
        if texture is not None:
            span_s = np.nan_to_num(slips.span_s)[..., np.newaxis, np.newaxis]
            own[0] += UNTOLD_M**2 * texture.untold
            own[1] += (UNTOLD_M_S * span_s) ** 2 * texture.untold
        place_cov, moved_cov = self._R @ own @ self._R_back
        return (
            np.einsum("pij,spj->spi", self._R, point) + self._origin,
            place_cov,
            np.einsum("pij,spj->spi", self._R, moved),
            moved_cov,
            _turn(slips.displacement, slips.displacement_covariance, texture),
        )


def _turn(vector: Floats, covariance: Floats, texture: Texture | None) -> Floats:
    """(scans, pads, 2), the turn of (scans, pads, 3) and its variance; NaN where the pattern does not change by it."""
    turn = np.empty((*vector.shape[:2], 2))
    turn[..., 0], turn[..., 1] = vector[..., 2], covariance[..., 2, 2]
    if texture is not None:
        turn[~texture.turns] = np.nan
    return turn


def nothing(pads: int) -> Slips:
    """A block of no scans."""
    three, matrix, one = np.zeros((0, pads, 3)), np.zeros((0, pads, 3, 3)), np.zeros((0, pads))
    none, border = np.zeros((0, pads), dtype=np.bool_), np.zeros((0, pads, 2), dtype=np.bool_)
    quality = np.zeros((0, pads), dtype=np.uint8)
    return Slips(np.zeros(0), none, border, three, three, matrix, matrix, one, one, one, one, quality)
