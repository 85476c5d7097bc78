"""Positions of the taxels at the joint angles of each scan, for fingers that move."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow.errors import ExtraMissing
from taxelflow.publish.view.hand_links import Skin
from taxelflow.publish.view.look import CAMERA
from taxelflow.publish.view.placement import ON_LINKS, Placement, corners_of, tangents
from taxelflow.sensors.kinematics import PadKinematics
from taxelflow.sensors.pad_geometry import geometry_of

if TYPE_CHECKING:
    from taxelflow.messages import Floats, Joints
    from taxelflow.sensors.sensor import Sensor


def fingers_of(sensor: Sensor, joints: Joints | None) -> tuple[Fingers | None, str]:
    """The fingers, and why they do not move; None unless all pads have a place at known joint angles."""
    if joints is None or sensor.hand is None:
        return None, ""
    try:
        kinematics = PadKinematics(sensor)
    except ExtraMissing as error:
        return None, f"the fingers do not move: {error}"
    unknown = [joint for joint in kinematics.joints if joint not in joints.names]
    if not kinematics.joints or not kinematics.placed.all():
        return None, ""
    if unknown or not len(joints.t_s):
        return None, f"the fingers do not move: no angles of {', '.join(unknown) or 'any joint'}"
    if not len(_known_times(joints, kinematics)):
        return None, "the fingers do not move: no time at which the angles of all joints are known"
    return Fingers(sensor, joints, kinematics), ""


def _known_times(joints: Joints, kinematics: PadKinematics) -> Floats:
    """Times at which the angles of all joints of the hand are known."""
    return joints.t_s[np.isfinite(kinematics.angles_at(joints, joints.t_s)).all(axis=1)]


class Fingers:
    """Places of all pads by time. Between known angles the hand stays as it was.

    links: joints and skin of each link of the hand, by its number, see `Kinematics.ends`. reach: (n, 3), places of
    taxels at some times.
    """

    def __init__(self, sensor: Sensor, joints: Joints, kinematics: PadKinematics) -> None:
        self._layout, self._joints, self._kinematics = sensor.layout, joints, kinematics
        layout = self._layout
        local = [geometry_of(msgspec.structs.replace(pad, pose=None)) for pad in sensor.pads]
        pitch_m = layout.pitch_m[: layout.pad_count].max(axis=1)
        self._pad = np.repeat(np.arange(layout.pad_count), [len(own.xy) for own in local])
        self._place = np.concatenate([own.place_m for own in local])
        self._normal = np.concatenate([own.normal for own in local])
        self._tangent = np.concatenate(
            [tangents(own.xy, own.place_m, pitch) for own, pitch in zip(local, pitch_m, strict=True)]
        )
        known_s = _known_times(joints, kinematics)
        times = known_s[np.linspace(0, len(known_s) - 1, min(len(known_s), CAMERA.hand_poses)).astype(int)]
        self._angles = kinematics.angles_at(joints, times[:1])[0]
        places = [self._moved(angles).place for angles in kinematics.angles_at(joints, times)]
        self.reach = np.concatenate(places)
        self.box = corners_of(self.reach, layout)
        self.moving = len(known_s) > 1
        self.links = self._skins()

    def at(self, t_s: float) -> Placement:
        """The pads at a time."""
        angles = self._kinematics.angles_at(self._joints, np.array([t_s]))[0]
        if np.isfinite(angles).all():
            self._angles = angles
        return self._moved(self._angles)

    def link_poses(self) -> dict[int, Floats]:
        """T_hand_link (4, 4) of each link, when `at` was called last."""
        model, links = self._kinematics.model, [*self.links]
        return {} if model is None else dict(zip(links, model.poses(self._angles[np.newaxis], links)[0], strict=True))

    def _skins(self) -> dict[int, tuple[Floats, Skin]]:
        kinematics = self._kinematics
        if kinematics.model is None:
            return {}
        ends, T = kinematics.model.ends(), kinematics.fixed[self._pad]
        home = np.full(len(kinematics.placed), next(iter(ends)))  # the base carries pads without a link
        home[kinematics.linked] = kinematics.links
        R = T[:, :3, :3]
        place = np.einsum("nij,nj->ni", R, self._place) + T[:, :3, 3]
        normal = np.einsum("nij,nj->ni", R, self._normal)
        across = R @ self._tangent * self._layout.pitch_m[self._pad][:, np.newaxis]
        on = home[self._pad]
        return {
            link: (joints, Skin(place[on == link], normal[on == link], across[on == link]))
            for link, joints in ends.items()
        }

    def _moved(self, angles: Floats) -> Placement:
        T = self._kinematics.poses(angles[np.newaxis])[0]
        R = T[self._pad, :3, :3]
        place = np.einsum("nij,nj->ni", R, self._place) + T[self._pad, :3, 3]
        box = getattr(self, "box", None)
        return Placement(
            place,
            np.einsum("nij,nj->ni", R, self._normal),
            R @ self._tangent,
            (ON_LINKS,) * self._layout.pad_count,
            corners_of(place, self._layout) if box is None else box,
        )
