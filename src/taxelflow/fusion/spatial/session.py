"""The session of the motion in space: slips of all pads and joint angles become twist and pose of the object."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.fusion.reference import UNTOLD_M_S, Reference
from taxelflow.fusion.spatial.fuse import Memory, Moving, Written, begin, fuse_scans
from taxelflow.fusion.spatial.places import Places
from taxelflow.fusion.spatial.pose import Anchor, Body
from taxelflow.fusion.spatial.roundness import centres
from taxelflow.fusion.spatial.twist import Limits, Misfit, Sixfold
from taxelflow.fusion.spatial.window import Seen, Velocities
from taxelflow.geometry import quaternion_of
from taxelflow.messages import AMBIGUOUS, UNRESOLVED, Bools, Floats, SpatialMotions, Texture
from taxelflow.numerics.records import records

if TYPE_CHECKING:
    from taxelflow.messages import Joints, Slips
    from taxelflow.sensors.sensor import Sensor

_MOST_STD = 1.0
"""Over the limit of observability: a component of the twist with a larger standard deviation is NaN."""


class SpatialSession:
    """Fuses block by block; remembers the scans of a window, and where each contact lies on the object."""

    def __init__(
        self, sensor: Sensor, joints: Joints | None, limits: Limits, *, window_s: float, edge_doubt: float
    ) -> None:
        """window_s, edge_doubt: see `SpatialField`. Raises HandModelInvalid, ExtraMissing."""
        layout = sensor.layout
        self._layout, self._limits = layout, limits
        self._window_s, self._edge_doubt = window_s, edge_doubt
        self._places = Places(sensor, joints)
        self._used: Bools = self._places.used
        self._reference = Reference(len(layout.pads))
        moving = sensor.hand is not None and sensor.hand.joint_std_rad > 0.0
        self._joint_std = sensor.hand.joint_std_rad if moving and sensor.hand is not None else 0.0
        count = len(layout.pads)
        self._coarse_m = float(np.max(layout.pitch_m[self._used], initial=0.0))
        self._memory = Memory(records(Anchor, count), records(Body, 1), records(Misfit, 2))
        begin(self._memory)
        self._past = _nothing_seen(count)

    def step(self, slips: Slips, centroid: Floats, texture: Texture | None = None) -> SpatialMotions:
        """Motion per scan. centroid: (scans, pads, 2), see `Contacts`. texture: without one every pattern is that of
        the object's surface, and tells all directions.
        """
        point = self._reference.step(slips, centroid, texture)
        lag = np.nan_to_num(slips.lag_s)
        frames = self._places.frames(slips.t_s[:, np.newaxis] - lag, point)
        self._places.count(slips.t_s)
        covariance = slips.covariance.copy()
        doubt = self._edge_doubt * (slips.border & (slips.quality == AMBIGUOUS)[..., np.newaxis])
        covariance[..., [0, 1], [0, 1]] += (doubt * self._layout.pitch_m) ** 2
        known = np.isfinite(frames).all(axis=(2, 3)) & np.isfinite(covariance[..., :2, :2]).all(axis=(2, 3))
        held = slips.contact & self._used
        noise, theta = _noise_of(slips, covariance), slips.pose[..., 2].copy()
        if texture is not None:
            covariance[~texture.turns, 2] = np.nan
            covariance[~texture.turns, :, 2] = np.nan
            theta[~texture.turns] = np.nan
        known &= held
        pitch_m = self._layout.pitch_m.max(axis=1)
        now = Seen(
            slips.t_s,
            frames,
            theta,
            covariance,
            noise,
            (self._edge_doubt * pitch_m * (slips.quality >= UNRESOLVED)) ** 2,
            known,
            held,
            held & (np.isfinite(slips.displacement[..., 0]) | ~known),
            np.zeros(held.shape),
            np.zeros((*held.shape, 3)) if texture is None else centres(frames, known, texture.smooth, self._coarse_m),
            np.zeros((*held.shape, 2, 2)) if texture is None else texture.untold,
        )
        parts: Any = (np.concatenate([before, new]) for before, new in zip(self._past, now, strict=True))
        seen = Seen(*parts)
        first = len(self._past.t_s)
        velocities = self._room(len(slips)) if self._window_s else self._from_scans(slips, now, doubt, texture)
        moving = self._moving(slips)
        out = self._written(len(slips))
        fuse_scans(seen, first, self._window_s, velocities, moving, self._limits, self._memory, out)
        keep = int(np.searchsorted(seen.t_s, seen.t_s[-1] - self._window_s)) if len(seen.t_s) else 0
        kept: Any = (part[keep:] for part in seen)
        self._past = Seen(*kept)
        return self._motions(slips.t_s, out)

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

    def _from_scans(self, slips: Slips, now: Seen, doubt: Floats, texture: Texture | None) -> Velocities:
        """Displacements of single scans over their spans, and the motion of the pads in that time."""
        end_s = slips.t_s[:, np.newaxis] - np.nan_to_num(slips.lag_s)
        span = slips.span_s
        before = self._places.frames(end_s - np.nan_to_num(span), np.nan_to_num(slips.pose[..., :2]))
        after = self._places.frames(end_s, np.nan_to_num(slips.pose[..., :2]))
        for frames in (before, after):
            frames[..., :3, 3] += np.einsum("spij,spj->spi", frames[..., :3, :3], now.under)
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
            covariance[..., :2, :2] += (UNTOLD_M_S * span[..., np.newaxis, np.newaxis]) ** 2 * texture.untold
            moved[~texture.turns, 2] = covariance[~texture.turns, 2, 2] = np.nan
        known = slips.valid & self._used & np.isfinite(now.frames).all(axis=(2, 3)) & np.isfinite(moved[..., 0])
        with np.errstate(invalid="ignore", divide="ignore"):
            rate, spread = moved / span[..., np.newaxis], covariance / span[..., np.newaxis, np.newaxis] ** 2
        deep = now.frames.copy()
        deep[..., :3, 3] += np.einsum("spij,spj->spi", deep[..., :3, :3], now.under)
        return Velocities(deep, rate, spread, known)

    def _moving(self, slips: Slips) -> Moving:
        scans, pads = slips.contact.shape
        if not self._joint_std:
            return Moving(np.zeros((scans, pads, 6, 0)), 0.0, np.zeros(scans))
        J = self._places.jacobians(slips.t_s)
        window_s = self._window_s
        if window_s:
            step_s = (
                float(np.median(np.diff(np.concatenate([self._past.t_s, slips.t_s])))) if scans > 1 else window_s / 9
            )
            rate = np.full(scans, np.sqrt(12.0 / max(window_s / step_s, 2.0)) / window_s)
        else:
            rate = np.sqrt(2.0) / np.nanmin(np.where(slips.span_s > 0, slips.span_s, np.inf), axis=1)
        return Moving(J, self._joint_std, self._joint_std * np.where(np.isfinite(rate), rate, 1.0))

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
        observed, rank = out.twists["value"].copy(), out.twists["rank"].astype(np.int64)
        deviation = np.sqrt(np.diagonal(out.twists["covariance"], axis1=1, axis2=2))
        worst = _MOST_STD * self._limits.twist_m_s * np.array([1.0] * 3 + [1.0 / self._limits.length_m] * 3)
        partly: Bools = np.asarray(rank < 6)
        none: Bools = np.asarray(out.pads == 0)
        observed[none] = np.nan
        twist = observed.copy()
        twist[(deviation > worst) & partly[:, np.newaxis]] = np.nan
        known = np.isfinite(out.body[:, 0, 0])
        pose = np.full((len(t_s), 7), np.nan)
        pose[known, :3] = out.body[known, :3, 3]
        pose[known, 3:] = quaternion_of(out.body[known, :3, :3])
        return SpatialMotions(
            t_s=t_s,
            twist=twist,
            twist_covariance=np.where(~none[:, np.newaxis, np.newaxis], out.twists["covariance"], np.nan),
            pose=pose,
            pose_covariance=np.where(known[:, np.newaxis, np.newaxis], out.poses["covariance"], np.nan),
            rank=rank,
            pose_rank=out.poses["rank"].astype(np.int64),
            blind=out.twists["blind"].copy(),
            pose_blind=out.poses["blind"].copy(),
            observed=observed,
            blamed=out.blamed,
            contradicted=out.contradicted,
            pads=out.pads.astype(np.int64),
        )


def _noise_of(slips: Slips, covariance: Floats) -> Floats:
    """(scans, pads, 3, 3): half of the covariance of a displacement at rest, where that is less than the pose's own."""
    noise = 0.5 * slips.displacement_covariance
    own, whole = (np.diagonal(one, axis1=2, axis2=3) for one in (noise, covariance))
    less: Bools = np.asarray(((own <= whole) | ~np.isfinite(whole)).all(axis=2))
    found: Floats = np.where(less[..., np.newaxis, np.newaxis], noise, covariance)
    return found


def _nothing_seen(pads: int) -> Seen:
    none = np.zeros((0, pads), dtype=np.bool_)
    return Seen(
        np.zeros(0),
        np.zeros((0, pads, 4, 4)),
        np.zeros((0, pads)),
        np.zeros((0, pads, 3, 3)),
        np.zeros((0, pads, 3, 3)),
        np.zeros((0, pads)),
        none,
        none,
        none,
        np.zeros((0, pads)),
        np.zeros((0, pads, 3)),
        np.zeros((0, pads, 2, 2)),
    )
