"""The object's motion in space: its twist, axis of rotation, path with its uncertainty, and what cannot be seen of it.

All is drawn at the object's point in the middle of the contacts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.numerics.geometry import hat, rotate
from taxelflow.numerics.rounding import SIGNIFICANT
from taxelflow.publish.spatial import basis_of
from taxelflow.publish.view import motion_marks as marks
from taxelflow.publish.view import shapes
from taxelflow.publish.view.batch import add_batch, put
from taxelflow.publish.view.lighting import lit
from taxelflow.publish.view.look import MOTION
from taxelflow.publish.view.palette import GREY, MAGENTA

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats, SpatialMotions

_BLIND = 6 * (MOTION.blind_ring + 1)
"""Pieces of the marks of all motions that cannot be seen, six at most."""


class SpaceMotion:
    """An arrow, a sector that shows the rate of turn, the axis of rotation, a path to the arrow, and sections of an
    ellipsoid. Grey marks: a bar along a translation that cannot be seen, an axis with a ring about it for such a turn.
    """

    def __init__(self, server: Any, size_m: float) -> None:
        self._size = size_m
        none, thick = np.zeros((MOTION.steps, 2, 3)), marks.thickness(size_m)
        lines = server.scene.add_line_segments
        self._turn = lines("/object/turn", np.zeros((MOTION.steps + 2, 2, 3)), MAGENTA, thickness=thick, visible=False)
        self._axis = lines("/object/axis", none[:1], MAGENTA, thickness=0.5 * thick, visible=False)
        self._blind = lines("/object/unseen", np.zeros((_BLIND, 2, 3)), GREY, thickness=0.7 * thick, visible=False)
        colours = np.tile(np.array(MAGENTA, dtype=np.uint8), (MOTION.steps, 2, 1))
        self._path = lines("/object/path", none, colours, thickness=0.7 * thick, visible=False)
        self._arrow = marks.twist_arrow(server, size_m)
        self._spread = add_batch(
            server, "/object/spread", shapes.ring(0.96, 1.0), MOTION.ellipses, side="double", visible=False
        )

    def show(
        self, motions: SpatialMotions | None, trail: SpatialMotions | None, middle: Floats, per_speed_s: float
    ) -> None:
        """Draw one scan. trail: of the last seconds. middle: (3,), of the contacts, NaN without any. per_speed_s:
        length of an arrow over its speed.
        """
        if motions is None or not np.isfinite(middle).all():
            for handle in (self._turn, self._axis, self._blind, self._path, self._arrow, self._spread):
                handle.visible = False
            return
        self._show_twist(motions, middle, per_speed_s)
        self._show_blind(motions.blind[0], middle)
        self._show_place(motions, middle)
        self._show_path(motions if trail is None else trail, middle)

    def _show_twist(self, motions: SpatialMotions, middle: Floats, per_speed_s: float) -> None:
        speed, omega = velocity_at(motions.observed[0], middle), motions.observed[0, 3:]
        covariance, at = motions.twist_covariance[0], _lever(middle)
        moves = _clear(speed, at @ covariance @ at.T)
        arrow = np.nan_to_num(speed) * per_speed_s
        self._arrow.points = np.array([[middle, middle + arrow]])
        self._arrow.visible = moves and float(np.linalg.norm(arrow)) > 0.03 * self._size
        turns = _clear(omega, covariance[3:, 3:])
        self._turn.visible = self._axis.visible = turns
        if not turns:
            return
        rate = float(np.linalg.norm(omega))
        arc = _arc(
            middle,
            0.1 * self._size,
            omega / rate,
            min(rate * MOTION.turn_s, MOTION.most_rad),
            MOTION.steps,
        )
        sides = np.array([[middle, arc[0, 0]], [middle, arc[-1, 1]]])
        self._turn.points = np.concatenate([arc, sides])
        through = middle + np.cross(omega, speed) / rate**2
        self._axis.visible = float(np.linalg.norm(through - middle)) < self._size
        self._axis.points = (through + 0.15 * self._size * np.outer((-1.0, 1.0), omega / rate))[np.newaxis]

    def _show_blind(self, blind: Floats, middle: Floats) -> None:
        marks = marks_of(blind, middle, self._size)
        self._blind.visible = bool(len(marks))
        segments = np.tile(middle, (_BLIND, 2, 1))
        segments[: len(marks)] = marks
        self._blind.points = segments

    def _show_place(self, motions: SpatialMotions, middle: Floats) -> None:
        covariance, at = motions.pose_covariance[0], _lever(middle)
        own = at @ covariance @ at.T
        self._spread.visible = bool(np.isfinite(own).all())
        if not self._spread.visible:
            return
        variance, axes = np.linalg.eigh(own)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        reach = MOTION.sigmas * np.sqrt(np.maximum(variance, 0.0))
        drawn = np.clip(reach, shapes.NONE, MOTION.widest * self._size)
        colour = lit(GREY if reach.max() > MOTION.widest * self._size else MAGENTA)
        put(
            self._spread,
            batched_positions=np.tile(middle, (MOTION.ellipses, 1)),
            batched_wxyzs=shapes.along(np.roll(axes.T, 1, axis=0), axes.T),
            batched_scales=np.column_stack([drawn, np.roll(drawn, -1), np.full(MOTION.ellipses, 1e-3)]),
            batched_colors=np.tile(colour, (MOTION.ellipses, 1)),
        )

    def _show_path(self, trail: SpatialMotions, middle: Floats) -> None:
        path, observed = path_of(trail, middle, MOTION.steps + 1)
        self._path.visible = bool(len(path))
        if len(path):
            known = (observed[:-1] & observed[1:])[:, np.newaxis, np.newaxis]
            colours = np.where(known, MAGENTA, GREY).astype(np.uint8).repeat(2, axis=1)
            put(self._path, points=np.stack([path[:-1], path[1:]], axis=1), colors=colours)


def velocity_at(twist: Floats, point: Floats) -> Floats:
    """(3,), of the object's point (3,) by a twist (6,)."""
    velocity: Floats = twist[:3] + np.cross(twist[3:], point)
    return velocity


def path_of(trail: SpatialMotions, middle: Floats, most: int) -> tuple[Floats, Bools]:
    """(most, 3), where the object's point that is now at `middle` was since contact began, and whether contacts
    observed that (most,); empty with less than 3 scans.
    """
    lost = np.flatnonzero(~np.isfinite(trail.pose).all(axis=1))
    first = int(lost[-1]) + 1 if len(lost) else 0
    if len(trail) - first < 3:
        return np.zeros((0, 3)), np.zeros(0, dtype=np.bool_)
    chosen = np.linspace(first, len(trail) - 1, most).astype(int)
    place, turn = trail.pose[chosen, :3], trail.pose[chosen, 3:]
    point = rotate(turn[-1] * (-1.0, -1.0, -1.0, 1.0), middle - place[-1])
    path = rotate(turn, point) + place
    hidden = trail.pose_blind[chosen, :, :3] + np.cross(trail.pose_blind[chosen, :, 3:], path[:, np.newaxis])
    observed: Bools = np.asarray(np.linalg.norm(hidden, axis=2).max(axis=1) < MOTION.hides)
    return path, observed


def marks_of(blind: Floats, middle: Floats, size_m: float) -> Floats:
    """(n, 2, 3), pieces of grey marks at `middle` for directions (6, 6) as in `SpatialMotions.blind`."""
    shifts, turns = basis_of(blind)
    marks = [np.zeros((0, 2, 3))]
    bar = 0.1 * size_m * np.array([[[-1.0], [1.0]]])
    marks.extend(middle + bar * shift / np.linalg.norm(shift) for shift in shifts)
    for twist in turns:
        rate = float(np.linalg.norm(twist[3:]))
        along = twist[3:] / rate
        point = np.cross(along, twist[:3]) / rate
        point = point + along * (along @ (middle - point))  # of the axis, the nearest to the middle
        off = point - middle
        far = float(np.linalg.norm(off))
        point = middle + off * min(1.0, 0.5 * size_m / max(far, shapes.NONE))
        marks += [point + bar * along, _arc(point, 0.05 * size_m, along, 2 * np.pi, MOTION.blind_ring)]
    return np.concatenate(marks)


def _lever(point: Floats) -> Floats:
    """(3, 6), maps a twist to the velocity of a point (3,)."""
    return np.concatenate([np.eye(3), -hat(point)], axis=1)


def _clear(velocity: Floats, covariance: Floats) -> bool:
    """Whether a velocity (3,) is clearly not 0."""
    if not (np.isfinite(velocity).all() and np.isfinite(covariance).all()):
        return False
    length = float(velocity @ velocity)
    return length**2 > SIGNIFICANT**2 * float(velocity @ covariance @ velocity)


def _arc(middle: Floats, radius: float, axis: Floats, angle_rad: float, steps: int) -> Floats:
    """(steps, 2, 3), pieces of an arc about an axis (3,) of length 1."""
    across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    across /= np.linalg.norm(across)
    turn = np.linspace(0.0, angle_rad, steps + 1)[:, np.newaxis]
    ring = middle + radius * (np.cos(turn) * across + np.sin(turn) * np.cross(axis, across))
    pieces: Floats = np.stack([ring[:-1], ring[1:]], axis=1)
    return pieces
