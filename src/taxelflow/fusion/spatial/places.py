"""Contact frames in space, from joint angles and the pads' skins, and the note on missing angles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.fusion.spatial.window_rows import along_planes
from taxelflow.messages import Joints
from taxelflow.sensors.hand import JointsInvalid
from taxelflow.sensors.joint_ranges import notes_beyond_ranges
from taxelflow.sensors.kinematics import PadKinematics
from taxelflow.sensors.surface import PadSurface

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.sensors.layout import Layout
    from taxelflow.sensors.sensor import Sensor


class Places:
    """Contact frames in the hand. home: number of the pad on which each pad, group (its first) and separate contact
    lies. used: (pads,), whether it has one frame in space.
    """

    def __init__(self, sensor: Sensor, joints: Joints | None) -> None:
        """Raises HandModelInvalid, ExtraMissing."""
        layout = sensor.layout
        self._sensor, self._joints = sensor, joints
        self._kinematics = PadKinematics(sensor)
        self.home = _home_of(layout)
        self.used = layout.independent & self._kinematics.placed[self.home] & _single(layout, self.home)
        self._surfaces = [PadSurface(sensor.pads[pad]) for pad in self.home]
        flat = all(surface.flat for surface in self._surfaces)
        self._planes = np.array([surface.plane for surface in self._surfaces]) if flat else None
        self._still: Floats | None = None
        if joints is None or len(joints.t_s) == 1:  # they never move
            self._still = self._kinematics.poses(self._kinematics.angles_at(joints, np.zeros(1)))
        self._last: tuple[bytes, Floats] = b"", np.zeros(0)
        self._scans, self._span_s = 0, (np.inf, -np.inf)
        self._unplaced = np.zeros(len(sensor.pads), dtype=np.int64)

    def frames(self, t_s: Floats, point: Floats) -> Floats:
        """Contact frames (scans, pads, 4, 4) in the hand at times (scans, pads) of points (scans, pads, 2)."""
        if self._planes is not None:
            frames = np.empty((*point.shape[:2], 4, 4))
            along_planes(self._at_own_times(t_s), self._planes, point, frames)
            frames[:, ~self.used] = np.nan
            return frames
        frames = np.full((*point.shape[:2], 4, 4), np.nan)
        for number in np.flatnonzero(self.used).tolist():
            T = self._placed(np.ascontiguousarray(t_s[:, number]))
            frames[:, number] = T[:, self.home[number]] @ self._surfaces[number].frames(point[:, number])
        return frames

    def _at_own_times(self, t_s: Floats) -> Floats:
        """(scans, pads, 4, 4), of pads in the hand at times (scans, pads); in C order, as kernels are compiled for."""
        if (t_s == t_s[:, :1]).all():
            return np.take(self._placed(t_s[:, 0]), self.home, axis=1)
        T = np.empty((*t_s.shape, 4, 4))
        for number, pad in enumerate(self.home):
            T[:, number] = self._placed(np.ascontiguousarray(t_s[:, number]))[:, pad]
        return T

    def _placed(self, t_s: Floats) -> Floats:
        """(scans, pads, 4, 4), of the pads in the hand at times (scans,); pads are mostly read at one time."""
        if self._still is not None:
            return np.broadcast_to(self._still, (len(t_s), *self._still.shape[1:]))
        key = t_s.tobytes()
        if self._last[0] != key:
            self._last = key, self._kinematics.poses(self._kinematics.angles_at(self._joints, t_s))
        return self._last[1]

    def jacobians(self, t_s: Floats) -> Floats:
        """Twists (scans, pads, 6, joints) of the pads per rate of each joint, 0 where unknown."""
        J = np.nan_to_num(self._kinematics.jacobians(self._kinematics.angles_at(self._joints, t_s)))
        return np.ascontiguousarray(J[:, self.home])

    def count(self, t_s: Floats) -> None:
        """Remember at which of the scans at times (scans,) pads have no place."""
        if not len(t_s) or not self._kinematics.joints:
            return
        self._scans += len(t_s)
        self._span_s = min(self._span_s[0], float(t_s[0])), max(self._span_s[1], float(t_s[-1]))
        self._unplaced += np.isnan(self._placed(t_s)[:, :, 0, 0]).sum(axis=0)

    @property
    def notes(self) -> list[str]:
        """What joint angles were missing, or beyond the joints' ranges, in words."""
        missing = self._unplaced * self._kinematics.placed
        if not missing.any():
            return self._beyond()
        names = ", ".join(self._sensor.pads[pad].name for pad in np.flatnonzero(missing))
        counts = _up_to(missing[missing > 0])
        return [f"no place in space in {counts} of {self._scans} scans for {names}: {self._lack()}", *self._beyond()]

    def _beyond(self) -> list[str]:
        return notes_beyond_ranges(self._joints, self._kinematics.model)

    def check(self) -> None:
        """Raises JointsInvalid if angles that the user gave place no pad that joints move, in any scan."""
        joints, scans = self._joints, self._scans
        if joints is None or not joints.given or not scans:
            return
        still = self._kinematics.poses(self._kinematics.angles_at(None, np.zeros(1)))[0, :, 0, 0]
        moved = self._kinematics.placed & np.isnan(still)
        if moved.any() and (self._unplaced[moved] == scans).all():
            raise JointsInvalid(joints.given, f"no moving pad has a place in any of {scans} scans: {self._lack()}")

    def _lack(self) -> str:
        """Which joint angles are missing."""
        joints, known = self._joints, () if self._joints is None else self._joints.names
        absent = [name for name in self._kinematics.joints if name not in known]
        parts = [f"no angles of {', '.join(absent)}"] if absent else []
        parts += [f"those given are of {', '.join(known)}"] if absent and known else []
        if joints is not None and len(joints.t_s) > 1 and len(absent) < len(self._kinematics.joints):
            parts += self._times_that_lack(_common_times(joints, self._kinematics.joints), explained=bool(absent))
        return "; ".join(parts)

    def _times_that_lack(self, own: Floats, *, explained: bool) -> list[str]:
        """From when to when all given angles are known, and the longest gap that is not bridged; nothing if they are in
        all scans, and the lack is explained.
        """
        first_s, last_s = self._span_s
        gap_s, most_s = float(np.diff(own).max(initial=0.0)), Joints.bridged_s()
        gap = f" with gaps of up to {gap_s:.3g} s ({most_s:g} s at most are interpolated)" if gap_s > most_s else ""
        if explained and not gap and len(own) and own[0] <= first_s and last_s <= own[-1]:
            return []
        seen = f"angles are from {own[0]:.3f} to {own[-1]:.3f} s{gap}" if len(own) else "never are all angles known"
        return [f"{seen}, scans from {first_s:.3f} to {last_s:.3f} s"]


def _common_times(joints: Joints, needed: tuple[str, ...]) -> Floats:
    """Times at which all the angles are known that the hand needs and the recording has."""
    own = [column for name, column in zip(joints.names, joints.angles.T, strict=True) if name in needed]
    return joints.t_s[np.isfinite(own).all(axis=0)]


def _up_to(counts: Floats) -> str:
    low, high = int(counts.min()), int(counts.max())
    return f"{high}" if low == high else f"{low} to {high}"


def _home_of(layout: Layout) -> list[int]:
    first_taxel = layout.source[layout.starts[:-1]]
    home: list[int] = (np.searchsorted(layout.starts[: layout.pad_count + 1], first_taxel, side="right") - 1).tolist()
    return home


def _single(layout: Layout, home: list[int]) -> Floats:
    """(pads,): False for groups across pads, which have no frame in space."""
    ends = layout.starts[: layout.pad_count + 1]
    own = [layout.source[layout.of_pad(number)] for number in range(len(layout.pads))]
    return np.array([one.max() < ends[pad + 1] and one.min() >= ends[pad] for one, pad in zip(own, home, strict=True)])
