"""The object's motion over the hand laid flat: its twist, centre of rotation, and path with its uncertainty."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.numerics.rounding import SIGNIFICANT
from taxelflow.publish.view import motion_marks as marks
from taxelflow.publish.view import shapes
from taxelflow.publish.view.batch import add_batch, put
from taxelflow.publish.view.lighting import lit
from taxelflow.publish.view.look import MOTION
from taxelflow.publish.view.palette import GREY, MAGENTA

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.publish.view.history import Results


class ObjectMotion:
    """An arrow and an arc at the object's point that lay at the hand's origin at first contact, the path of that point
    with an ellipse, and a cross at the centre of rotation.
    """

    def __init__(self, server: Any, size_m: float) -> None:
        self._size = size_m
        none, thick = np.zeros((MOTION.steps, 2, 3)), marks.thickness(size_m)
        lines = server.scene.add_line_segments
        self._arc = lines("/object/turn", none, MAGENTA, thickness=thick, visible=False)
        self._path = lines("/object/path", none, MAGENTA, thickness=0.7 * thick, visible=False)
        self._cross = lines("/object/centre", none[:2], MAGENTA, thickness=thick, visible=False)
        self._arrow = marks.twist_arrow(server, size_m)
        self._spread = add_batch(server, "/object/spread", shapes.ring(0.94, 1.0), 1, side="double", visible=False)

    def show(self, results: Results | None, trail: Results | None, height_m: float, per_speed_s: float) -> None:
        """Draw one scan. height_m: above the skin. per_speed_s: length of an arrow over its speed."""
        if results is None:
            for handle in (self._arc, self._path, self._cross, self._arrow, self._spread):
                handle.visible = False
            return
        motions = results.motions
        omega, pose = float(np.nan_to_num(motions.velocity[0, 2])), np.nan_to_num(motions.pose[0])
        origin = np.array([*pose[:2], height_m])  # the point that lay at the hand's origin at first contact
        speed = np.nan_to_num(motions.velocity[0, :2]) + omega * np.array([-pose[1], pose[0]])
        arrow = np.array([*speed, 0.0]) * per_speed_s
        moves = _clear(motions.velocity[0, :2], motions.velocity_covariance[0, :2, :2])
        self._arrow.points = np.array([[origin, origin + arrow]])
        self._arrow.visible = moves and float(np.hypot(*arrow[:2])) > 0.03 * self._size
        turns = _clear(motions.velocity[0, 2:], motions.velocity_covariance[0, 2:, 2:])
        self._arc.points = _arc(
            origin,
            0.07 * self._size,
            float(np.clip(omega * MOTION.turn_s, -MOTION.most_rad, MOTION.most_rad)),
        )
        self._arc.visible = turns
        centre = motions.centre[0]
        within = bool(np.isfinite(centre).all()) and float(np.hypot(*centre)) < 2 * self._size
        self._cross.visible = within and turns
        if within:
            at, arm = np.array([*centre, height_m]), 0.02 * self._size
            self._cross.points = at + arm * np.array([[[-1, 0, 0], [1, 0, 0]], [[0, -1, 0], [0, 1, 0]]])
        self._draw_path(trail, results, height_m)

    def _draw_path(self, trail: Results | None, results: Results, height_m: float) -> None:
        pose = np.zeros((0, 3)) if trail is None else trail.motions.pose
        points = pose[np.isfinite(pose[:, :2]).all(axis=1), :2]
        here = results.motions.pose[0, :2]
        self._draw_spread(here, results.motions.pose_covariance[0, :2, :2], height_m)
        self._path.visible = len(points) > 2
        if len(points) > 2:
            chosen = points[np.linspace(0, len(points) - 1, MOTION.steps + 1).astype(int)]
            places = np.column_stack([chosen, np.full(MOTION.steps + 1, height_m)])
            self._path.points = np.stack([places[:-1], places[1:]], axis=1)

    def _draw_spread(self, here: Floats, covariance: Floats, height_m: float) -> None:
        """The ellipse of 2 standard deviations; grey where it is larger than what is drawn."""
        self._spread.visible = bool(np.isfinite(here).all() and np.isfinite(covariance).all())
        if not self._spread.visible:
            return
        variance, axes = np.linalg.eigh(covariance)
        reach = MOTION.sigmas * np.sqrt(np.maximum(variance, 0.0))
        most = MOTION.widest * self._size
        angle = 0.5 * np.arctan2(axes[1, 0], axes[0, 0])
        put(
            self._spread,
            batched_positions=np.array([[*here, height_m]]),
            batched_wxyzs=np.array([[np.cos(angle), 0.0, 0.0, np.sin(angle)]]),
            batched_scales=np.array([[*np.clip(reach, shapes.NONE, most), 1e-3]]),
            batched_colors=lit(GREY if (reach > most).any() else MAGENTA)[np.newaxis],
        )


def _clear(velocity: Floats, covariance: Floats) -> bool:
    """Whether a velocity is clearly not 0."""
    if not (np.isfinite(velocity).all() and np.isfinite(covariance).all()):
        return False
    return bool(velocity @ velocity > SIGNIFICANT**2 * np.trace(covariance))


def _arc(origin: Floats, radius: float, angle_rad: float) -> Floats:
    turn = np.linspace(0.0, angle_rad, MOTION.steps + 1)
    ring = origin + radius * np.stack([np.cos(turn), np.sin(turn), np.zeros(MOTION.steps + 1)], axis=1)
    segments: Floats = np.stack([ring[:-1], ring[1:]], axis=1)
    return segments
