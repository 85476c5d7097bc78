"""The session of the motion in space: slips of all pads and joint angles become twist and pose of the object."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.fusion.forming import Forming
from taxelflow.fusion.reference import UNOBSERVABLE_M_S, Reference
from taxelflow.fusion.spatial.fuse import Memory, Moving, Written, begin, fuse_scans
from taxelflow.fusion.spatial.places import Places
from taxelflow.fusion.spatial.pose import Anchor, Body
from taxelflow.fusion.spatial.roundness import centres
from taxelflow.fusion.spatial.twist import Limits, Misfit, Sixfold
from taxelflow.fusion.spatial.window import Seen, Velocities
from taxelflow.fusion.spatial.window_rows import MotionFields, PadSlips, Rules, fill_motions, fill_rows
from taxelflow.messages import AMBIGUOUS, Bools, Floats, SpatialMotions, Texture
from taxelflow.numerics.records import records
from taxelflow.runtime.settled import Settled

if TYPE_CHECKING:
    from taxelflow.messages import Joints, Slips
    from taxelflow.sensors.layout import Layout
    from taxelflow.sensors.sensor import Sensor

_SPARE = 256
"""Scans that fit into the arrays after a window, before the window is moved to their begin."""
_MOST_STD = 1.0
"""Standard deviation, over the limit of observability, above which a component of the twist is NaN."""


class Prepared(NamedTuple):
    """Arguments of the kernel. first: number of the new scans' first one in seen. out: to be filled."""

    seen: Seen
    first: int
    velocities: Velocities
    moving: Moving
    out: Written


class SpatialSession:
    """Fuses block by block; keeps the scans of a window, and the anchor of each contact on the object."""

    def __init__(
        self, sensor: Sensor, joints: Joints | None, limits: Limits, *, window_s: float, edge_doubt: float
    ) -> None:
        """window_s, edge_doubt: see `SpatialField`. Raises HandModelInvalid, ExtraMissing."""
        layout = sensor.layout
        self._layout, self._limits = layout, limits
        self._window_s, self._edge_doubt = window_s, edge_doubt
        self._worst = _MOST_STD * limits.twist_m_s * np.array([1.0] * 3 + [1.0 / limits.length_m] * 3)
        self._places = Places(sensor, joints)
        self._used: Bools = self._places.used
        self._reference = Reference(len(layout.pads))
        moving = sensor.hand is not None and sensor.hand.joint_std_rad > 0.0
        self._joint_std = sensor.hand.joint_std_rad if moving and sensor.hand is not None else 0.0
        count = len(layout.pads)
        self._coarse_m = float(np.max(layout.pitch_m[self._used], initial=0.0))
        self._memory = Memory(records(Anchor, count), records(Body, 1), records(Misfit, 2))
        begin(self._memory)
        self._fill_rows, self._fuse, self._fill_motions = Settled(fill_rows), Settled(fuse_scans), Settled(fill_motions)
        self._seen, self._begin, self._end = _nothing_seen(layout, _SPARE), 0, 0
        self._forming = Forming(layout)
        self._rules = records(Rules, count)
        self._rules["used"], self._rules["edge_m"] = self._used, edge_doubt * layout.pitch_m
        self._rules["anchor_m"] = edge_doubt * layout.pitch_m.max(axis=1)
        self._rules["patience_s"], self._rules["since_s"] = window_s, np.nan

    def step(self, slips: Slips, centroid: Floats, texture: Texture | None = None) -> SpatialMotions:
        """Motion per scan. centroid: (scans, pads, 2), see `Contacts`. texture: without one every pattern is that of
        the object's surface, and shows all directions.
        """
        prepared = self.prepare(slips, centroid, texture)
        self.fuse(prepared)
        return self._motions(slips.t_s, prepared.out)

    def prepare(self, slips: Slips, centroid: Floats, texture: Texture | None = None) -> Prepared:
        """The arguments of the kernel; see `step`."""
        point = self._reference.step(slips, centroid, texture)
        frames = self._places.frames(slips.t_s[:, np.newaxis] - np.nan_to_num(slips.lag_s), point)
        self._places.count(slips.t_s)
        scans, pads = slips.contact.shape
        seen, first = self._room_for(slips.t_s)
        pads_slips = PadSlips(
            slips.contact,
            slips.border,
            slips.quality,
            slips.displacement,
            slips.pose,
            slips.covariance,
            slips.displacement_covariance,
            np.ones((scans, pads), dtype=np.bool_) if texture is None else texture.turns,
            np.zeros((scans, pads, 2, 2)) if texture is None else texture.unobservable,
            self._forming.step(slips),
        )
        self._fill_rows(pads_slips, frames, self._rules, first, seen)
        now = slice(first, first + scans)
        if texture is not None and texture.smooth.any():
            seen.under[now] = centres(frames, seen.known[now], texture.smooth, self._coarse_m)
        velocities = self._room(scans) if self._window_s else self._from_scans(slips, frames, seen.under[now], texture)
        return Prepared(seen, first, velocities, self._moving(slips), self._written(scans))

    def fuse(self, prepared: Prepared) -> None:
        """The kernel alone."""
        seen, first, velocities, moving, out = prepared
        self._fuse(seen, first, self._window_s, velocities, moving, self._limits, self._memory, out)

    def _room_for(self, t_s: Floats) -> tuple[Seen, int]:
        """What was seen, with room for scans at t_s, and the first of these; only a window of scans before is kept."""
        seen, begin, end = self._seen, self._begin, self._end
        if end > begin:
            begin += int(np.searchsorted(seen.t_s[begin:end], seen.t_s[end - 1] - self._window_s))
        if end + len(t_s) > len(seen.t_s):
            kept = slice(begin, end)
            held = end - begin
            seen = _nothing_seen(self._layout, 2 * held + len(t_s) + _SPARE)
            for before, after in zip(self._seen, seen, strict=True):
                after[:held] = before[kept]
            self._seen, begin, end = seen, 0, held
        seen.t_s[end : end + len(t_s)] = t_s
        self._begin, self._end = begin, end + len(t_s)
        return seen, end

    @property
    def notes(self) -> list[str]:
        """Which pads had no place in space, and why."""
        return self._places.notes

    def finish(self) -> None:
        """No scan follows. Raises JointsInvalid if joint angles that the user gave fit no scan."""
        self._places.check()

    def _room(self, scans: int) -> Velocities:
        """For the velocities of windows."""
        pads = len(self._layout.pads)
        return Velocities(
            np.zeros((scans, pads, 4, 4)),
            np.zeros((scans, pads, 3)),
            np.zeros((scans, pads, 3, 3)),
            np.zeros((scans, pads), dtype=np.bool_),
        )

    def _from_scans(self, slips: Slips, deep: Floats, under: Floats, texture: Texture | None) -> Velocities:
        """Displacements of single scans over their spans, and the motion of the pads in that time."""
        end_s = slips.t_s[:, np.newaxis] - np.nan_to_num(slips.lag_s)
        span, at = slips.span_s, np.nan_to_num(slips.pose[..., :2])
        doubt = self._edge_doubt * (slips.border & (slips.quality == AMBIGUOUS)[..., np.newaxis])
        before = self._places.frames(end_s - np.nan_to_num(span), at)
        after = self._places.frames(end_s, at)
        for frames in (before, after):
            frames[..., :3, 3] += np.einsum("spij,spj->spi", frames[..., :3, :3], under)
        carried = np.einsum("spji,spj->spi", after[..., :3, :3], after[..., :3, 3] - before[..., :3, 3])
        turn = np.arctan2(
            np.einsum("spi,spi->sp", before[..., :3, 1], after[..., :3, 0]),
            np.einsum("spi,spi->sp", before[..., :3, 0], after[..., :3, 0]),
        )
        moved = slips.displacement.copy()
        moved[..., :2] += carried[..., :2]
        moved[..., 2] += turn
        most = np.max(np.nan_to_num(np.hypot(moved[..., 0], moved[..., 1])), axis=1, initial=0.0)
        covariance = slips.displacement_covariance.copy()
        covariance[..., [0, 1], [0, 1]] += (doubt * most[:, np.newaxis, np.newaxis]) ** 2
        if texture is not None:
            covariance[..., :2, :2] += (
                UNOBSERVABLE_M_S * span[..., np.newaxis, np.newaxis]
            ) ** 2 * texture.unobservable
            moved[~texture.turns, 2] = covariance[~texture.turns, 2, 2] = np.nan
        known = slips.valid & self._used & np.isfinite(deep).all(axis=(2, 3)) & np.isfinite(moved[..., 0])
        with np.errstate(invalid="ignore", divide="ignore"):
            rate, spread = moved / span[..., np.newaxis], covariance / span[..., np.newaxis, np.newaxis] ** 2
        deep = deep.copy()
        deep[..., :3, 3] += np.einsum("spij,spj->spi", deep[..., :3, :3], under)
        half = 0.5 * np.nan_to_num(moved[..., :2])  # a rigid motion moves the middle of the way along it, not its end
        deep[..., :3, 3] -= np.einsum("spij,spj->spi", deep[..., :3, :2], half)
        return Velocities(deep, rate, spread, known)

    def _moving(self, slips: Slips) -> Moving:
        scans, pads = slips.contact.shape
        if not self._joint_std:
            return Moving(np.zeros((scans, pads, 6, 0)), 0.0, np.zeros(scans))
        J = self._places.jacobians(slips.t_s)
        window_s = self._window_s
        if window_s:
            steps = window_s / self._usual_steps_s(scans)
            rate = np.sqrt(12.0 / np.maximum(steps, 2.0)) / window_s
        else:
            rate = np.sqrt(2.0) / np.nanmin(np.where(slips.span_s > 0, slips.span_s, np.inf), axis=1)
        return Moving(J, self._joint_std, self._joint_std * np.where(np.isfinite(rate), rate, 1.0))

    def _usual_steps_s(self, scans: int) -> Floats:
        """(scans,), the median step of the window that ends with each of the last scans; all of it without a step."""
        t_s = self._seen.t_s[self._begin : self._end]
        usual_s = np.full(scans, self._window_s)
        for number, last in enumerate(range(len(t_s) - scans, len(t_s))):
            first = int(np.searchsorted(t_s, t_s[last] - self._window_s))
            if first < last:
                usual_s[number] = np.median(np.diff(t_s[first : last + 1]))
        return usual_s

    def _written(self, scans: int) -> Written:
        pads = len(self._layout.pads)
        return Written(
            records(Sixfold, scans),
            records(Sixfold, scans),
            np.full((scans, 4, 4), np.nan),
            np.zeros((scans, pads), dtype=np.bool_),
            np.zeros(scans, dtype=np.bool_),
            np.zeros(scans),
        )

    def _motions(self, t_s: Floats, out: Written) -> SpatialMotions:
        scans = len(t_s)
        answers = MotionFields(
            np.empty((scans, 6)),
            np.empty((scans, 6, 6)),
            np.empty((scans, 7)),
            np.empty((scans, 6, 6)),
            np.empty((scans, 6)),
        )
        self._fill_motions(out.twists, out.poses, out.body, out.pads, self._worst, answers)
        return SpatialMotions(
            t_s=t_s,
            twist=answers.twist,
            twist_covariance=answers.twist_covariance,
            pose=answers.pose,
            pose_covariance=answers.pose_covariance,
            rank=out.twists["rank"].astype(np.int64),
            pose_rank=out.poses["rank"].astype(np.int64),
            blind=out.twists["blind"].copy(),
            pose_blind=out.poses["blind"].copy(),
            observed=answers.observed,
            blamed=out.blamed,
            contradicted=out.contradicted,
            pads=out.pads.astype(np.int64),
        )


def _nothing_seen(layout: Layout, scans: int) -> Seen:
    pads = len(layout.pads)
    unknown: Bools = np.zeros((scans, pads), dtype=np.bool_)
    return Seen(
        np.zeros(scans),
        np.zeros((scans, pads, 4, 4)),
        np.zeros((scans, pads)),
        np.zeros((scans, pads, 3, 3)),
        np.zeros((scans, pads, 3, 3)),
        np.zeros((scans, pads)),
        unknown,
        unknown.copy(),
        unknown.copy(),
        np.zeros((scans, pads)),
        np.zeros((scans, pads, 3)),
        np.zeros((scans, pads, 2, 2)),
    )
