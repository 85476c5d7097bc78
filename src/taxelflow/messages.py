"""Messages between the stages: raw scans, joints, scans, estimates, slips, motions, contacts, events, patterns.

A message holds a block of one or more scans in time order, so that the same kernels process a live stream (blocks of
one scan) and a recording (blocks of thousands). No result depends on the sizes of the blocks.
Unknown numbers are NaN. Three components are always in the order (x, y, theta), in m, m, rad. In the shapes below,
`pads` counts pads, groups and separate contacts, `entries` their taxels (see `Layout`).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import nan
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from _typeshed import DataclassInstance

    Joined = TypeVar("Joined", bound=DataclassInstance)
    Block = TypeVar(
        "Block",
        "RawScans",
        "Scans",
        "Footprint",
        "Estimates",
        "Slips",
        "Motions",
        "SpatialMotions",
        "Contacts",
        "Texture",
    )

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class _Joints:
    """Joint angles at the time of a scan."""

    gap_s: float = 0.5
    """Longest time between two joint angles over which they are interpolated."""
    late_s: float = 0.05
    """Time before the first and after the last joint angle in which that one holds."""


_JOINTS = _Joints()

NO_POSE, OK, AMBIGUOUS, UNRESOLVED, LOST = range(5)
QUALITY = ("", "ok", "ambiguous", "unresolved", "lost")
"""Quality of a pose. Empty: no pose. ok: the covariance describes its error. ambiguous: a change of the contact other
than motion (cut by a border, tilt, growth) may have the same effect, or a direction is not observable. unresolved: the
scan contradicts the method's model (chi-square above its gate), or contacts on the pad move independently. lost: the
method starts again."""


@dataclass(frozen=True, slots=True)
class RawScans:
    """Scans in the sensor's own unit.

    t_s: (scans,), sensor's clock in s, strictly increasing.
    values: (scans, taxels); NaN where a taxel is missing in a scan.
    shear: (scans, taxels, 2), load along x (right) and y (up) of each taxel's pad, in the same unit; NaN where missing.
    None for sensors without it, and in the columns of a source, which hold it.
    """

    t_s: Floats
    values: Floats
    shear: Floats | None = None

    def __len__(self) -> int:
        return len(self.t_s)

    def in_order(self) -> RawScans:
        """Row by row in memory, in 64 bits, whatever a source gave."""
        shear = None if self.shear is None else _in_order(self.shear)
        return RawScans(_in_order(self.t_s), _in_order(self.values), shear)


@dataclass(frozen=True, slots=True, eq=False)
class Joints:
    """Joint angles of the hand over time, from the recording or constant.

    names: of the joints. t_s: (times,), sensor's clock in s, strictly increasing; a single time stands for all times.
    angles: (times, joints), rad (m for a slide), NaN where unknown. given: the option by which the user gave them,
    empty for those of the recording and of the sensor file.
    """

    names: tuple[str, ...]
    t_s: Floats
    angles: Floats
    given: str = ""

    def at(self, t_s: Floats, names: Sequence[str]) -> Floats:
        """(n, names) angles at times (n,), interpolated linearly; NaN before the first and after the last time, in
        gaps of more than `_JOINTS.gap_s`, beside unknown angles, and for names that are not known.

        Between angles more than pi apart the shorter way is taken, as of a joint that turns on and on and whose
        encoder starts again at -pi. No finger goes further from one time to the next.
        """
        found = np.full((len(t_s), len(names)), np.nan)
        if not len(self.t_s):
            return found
        if len(self.t_s) > 1:
            after = np.clip(np.searchsorted(self.t_s, t_s), 1, len(self.t_s) - 1)
            inside = (t_s >= self.t_s[0] - _JOINTS.late_s) & (t_s <= self.t_s[-1] + _JOINTS.late_s)
            first, last = self.t_s[after - 1], self.t_s[after]
            inside &= (last - first <= _JOINTS.gap_s) | (t_s == first) | (t_s == last)
        near = slice(0, 1) if len(self.t_s) == 1 or not len(t_s) else slice(after.min() - 1, after.max() + 1)
        for column, name in enumerate(names):
            if name in self.names:
                own = self.angles[:, self.names.index(name)]
                angles = np.interp(t_s, self.t_s[near], own[near])
                if len(self.t_s) > 1:
                    angles -= self._wrapped(t_s, own, after)
                if np.isnan(own[near]).any():
                    self._hold_ends(t_s, own, angles)
                found[:, column] = angles if len(self.t_s) == 1 else np.where(inside, angles, np.nan)
        return found

    def _wrapped(self, t_s: Floats, own: Floats, after: NDArray[np.intp]) -> Floats:
        """(n,): what whole turns between two angles add to the interpolation. own: (times,). after: (n,), the next."""
        turns = np.round(np.nan_to_num(own[after] - own[after - 1]) / (2.0 * np.pi))
        first, last = self.t_s[after - 1], self.t_s[after]
        share = np.where((t_s > first) & (t_s < last), (t_s - first) / (last - first), 0.0)
        added: Floats = 2.0 * np.pi * turns * share
        return added

    @staticmethod
    def bridged_s() -> float:
        """Longest gap in time over which angles are interpolated, s."""
        return _JOINTS.gap_s

    def _hold_ends(self, t_s: Floats, own: Floats, angles: Floats) -> None:
        """Let a joint's first and last known angle hold around the times that it shares with others. own: (times,)."""
        known = np.flatnonzero(np.isfinite(own))
        for end, sign in ((known[:1], -1.0), (known[-1:], 1.0)):
            beyond = sign * (t_s[:, np.newaxis] - self.t_s[end])
            angles[((beyond > 0.0) & (beyond <= _JOINTS.late_s)).any(axis=1)] = own[end]


@dataclass(frozen=True, slots=True)
class Scans:
    """Conditioned scans: tared, in Pa (counts for a sensor without a scale), free of NaN.

    t_s: (scans,). pressure: (scans, entries), 0 where a taxel is masked or missing.
    noise: (entries,), standard deviation of one reading, same unit; 0 for a masked taxel. A reading of exactly 0 has no
    noise: the taxel is masked, missing, or clipped by the sensor while it is idle.
    ceiling: (entries,), a reading at or above it is saturated; inf where the full scale is unknown.
    contact: (scans, pads). complete: (scans, pads), False where a loaded taxel is missing in that scan, and in the
    first scan after a gap in time or a change of masks: no motion can be estimated from the previous scan.
    shear: (scans, entries, 2), along x (right) and y (up) of the entry's pad or group, less that of idle scans, in the
    unit of pressure, 0 where a taxel is masked or missing; None for sensors without it.
    """

    t_s: Floats
    pressure: Floats
    noise: Floats
    ceiling: Floats
    contact: Bools
    complete: Bools
    shear: Floats | None = None

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(frozen=True, slots=True)
class Footprint:
    """Contact, border, load and unseen error per scan and pad, which depend on scan and layout only.

    t_s: (scans,). contact: (scans, pads). border: (scans, pads, 2), whether a loaded taxel lies at a border of the pad
    that faces x (left, right), y. load: (scans, pads), sum of the pad's pressures, Pa (counts without a scale).
    unseen: (scans, pads, 3, 3), covariance of a pose by what the sensor does not show; None if the sensor declares no
    unseen error, or the method allows for it.
    """

    t_s: Floats
    contact: Bools
    border: Bools
    load: Floats
    unseen: Floats | None = None

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(slots=True)  # to make a frozen one takes longer than all of its arrays, in each scan
class Estimates:
    """Results of an estimator per scan and pad, in each pad's frame; NaN where unknown.

    t_s: (scans,). displacement: (scans, pads, 3), since the pad's previous scan, m, m, rad. pose: (scans, pads, 3).
    covariance: (scans, pads, 3, 3) of the pose. displacement_covariance: (scans, pads, 3, 3), from noise alone.
    span_s: (scans, pads), duration of the displacement. lag_s: (scans, pads), age of the pose at t_s.
    disturbance: (scans, pads), for methods without direction: evidence of slip in standard deviations of noise.
    quality: (scans, pads), index in `QUALITY` where the method itself judges its pose, such as AMBIGUOUS for a
    direction that it cannot observe; NO_POSE elsewhere, and the pipeline judges: ambiguous where the contact is cut by
    the pad's border, else ok. unseen: (scans, pads, 3, 3), what summed steps add to the covariance by errors that the
    sensor does not show; None elsewhere.
    """

    t_s: Floats
    displacement: Floats
    pose: Floats
    covariance: Floats
    displacement_covariance: Floats
    span_s: Floats
    lag_s: Floats
    disturbance: Floats
    quality: Bytes
    unseen: Floats | None = None

    @classmethod
    def unknown(cls, scans: Scans, unseen: Floats | None = None) -> Estimates:
        """Arrays of NaN for these scans, for an estimator to fill in. unseen: see above."""
        shape = scans.contact.shape
        return cls(
            t_s=scans.t_s,
            displacement=_unknown(*shape, 3),
            pose=_unknown(*shape, 3),
            covariance=_unknown(*shape, 3, 3),
            displacement_covariance=_unknown(*shape, 3, 3),
            span_s=_unknown(*shape),
            lag_s=_unknown(*shape),
            disturbance=_unknown(*shape),
            quality=np.zeros(shape, dtype=np.uint8),
            unseen=unseen,
        )

    @classmethod
    def of(cls, t_s: Floats, vectors: Floats, matrices: Floats, scalars: Floats, quality: Bytes) -> Estimates:
        """Those that share the memory of arrays: of pose and displacement, vectors (2, scans, pads, 3) and matrices
        (2, scans, pads, 3, 3); of span, lag and disturbance, scalars (3, scans, pads).
        """
        (pose, displacement), (covariance, of_displacement), (span_s, lag_s, disturbance) = vectors, matrices, scalars
        return cls(t_s, displacement, pose, covariance, of_displacement, span_s, lag_s, disturbance, quality)

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(frozen=True, slots=True)
class Slips:
    """Motion of the object relative to the skin, per scan and pad, in each pad's frame.

    t_s: (scans,). contact: (scans, pads).
    border: (scans, pads, 2), whether the contact reaches a border of the pad that faces x (left, right), y.
    displacement: (scans, pads, 3), since the pad's previous scan. pose: (scans, pads, 3).
    covariance: (scans, pads, 3, 3) of the pose.
    displacement_covariance: (scans, pads, 3, 3), of the estimate for an object at rest, from noise alone.
    span_s: (scans, pads), duration of the displacement, s. lag_s: (scans, pads), age of the pose at t_s, s.
    load: (scans, pads), sum of the pad's pressures, Pa (counts for a sensor without a scale).
    disturbance: (scans, pads), for methods without direction: evidence of slip in standard deviations of noise; NaN for
    all others. quality: (scans, pads), index in `QUALITY`. unseen: (scans, pads, 3, 3), what errors that the sensor
    does not show add to the covariance, which is by noise alone then; None if that holds them: see `whole`.
    """

    t_s: Floats
    contact: Bools
    border: Bools
    displacement: Floats
    pose: Floats
    covariance: Floats
    displacement_covariance: Floats
    span_s: Floats
    lag_s: Floats
    load: Floats
    disturbance: Floats
    quality: Bytes
    unseen: Floats | None = None

    @classmethod
    def of(cls, footprint: Footprint, estimates: Estimates) -> Slips:
        """Slips of the same scans, as their method has judged them."""
        return cls(
            t_s=footprint.t_s,
            contact=footprint.contact,
            border=footprint.border,
            displacement=_in_order(estimates.displacement),
            pose=_in_order(estimates.pose),
            covariance=_in_order(estimates.covariance),
            displacement_covariance=_in_order(estimates.displacement_covariance),
            span_s=_in_order(estimates.span_s),
            lag_s=_in_order(estimates.lag_s),
            load=footprint.load,
            disturbance=_in_order(estimates.disturbance),
            quality=np.array(estimates.quality, dtype=np.uint8),
            unseen=_sum(footprint.unseen, estimates.unseen),
        )

    def whole(self) -> Slips:
        """The same with a covariance that holds unseen errors."""
        return self if self.unseen is None else self.judged(self.pose, self.covariance + self.unseen, self.quality)

    def judged(self, pose: Floats, covariance: Floats, quality: Bytes) -> Slips:
        """The same with judged poses, and a covariance that holds unseen errors: half of the time of `replace`."""
        return Slips(
            t_s=self.t_s,
            contact=self.contact,
            border=self.border,
            displacement=self.displacement,
            pose=pose,
            covariance=covariance,
            displacement_covariance=self.displacement_covariance,
            span_s=self.span_s,
            lag_s=self.lag_s,
            load=self.load,
            disturbance=self.disturbance,
            quality=quality,
        )

    @property
    def velocity(self) -> Floats:
        """(scans, pads, 3), in m/s and rad/s."""
        velocity: Floats = self.displacement / self.span_s[..., np.newaxis]
        return velocity

    @property
    def valid(self) -> Bools:
        """(scans, pads), whether the displacement is known."""
        known: Bools = np.isfinite(self.displacement[..., 0])
        return known

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(frozen=True, slots=True)
class Motions:
    """Motion of the object over the hand, one row per scan, in the hand frame.

    t_s: (scans,). velocity: (scans, 3), of the object's point at the hand's origin, m/s, and turn rate, rad/s.
    velocity_covariance: (scans, 3, 3). rotor, rotor_std: (scans,), curl of the field of velocities, 1/s.
    centre, centre_std: (scans, 2), centre of rotation, m. pose: (scans, 3), displacement of the point that was at the
    hand's origin at first contact, and rotation since then. pose_covariance: (scans, 3, 3).
    pads: (scans,), number of pads and groups from which the velocity is computed.
    """

    t_s: Floats
    velocity: Floats
    velocity_covariance: Floats
    rotor: Floats
    rotor_std: Floats
    centre: Floats
    centre_std: Floats
    pose: Floats
    pose_covariance: Floats
    pads: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(frozen=True, slots=True)
class SpatialMotions:
    """Motion of the object in space, one row per scan, in the hand's 3-D frame.

    Twists are (vx, vy, vz, wx, wy, wz), m/s and rad/s, v that of the object's point at the hand's origin.
    t_s: (scans,). twist: (scans, 6), mean of the window that ends at t_s; a component is NaN where it is not
    observable. twist_covariance: (scans, 6, 6). pose: (scans, 7), [x, y, z, qx, qy, qz, qw] that takes the object's
    points from where they were at first contact. pose_covariance: (scans, 6, 6), of a small motion from the left
    (dx, dy, dz, rotation vector) at the hand's origin. rank, pose_rank: (scans,), observable directions of 6, 0 without
    contact. blind, pose_blind: (scans, 6, 6), directions that are not observable, as rows; rows of 0 follow. observed:
    (scans, 6), the twist less its part along them, without NaN for what they leave unknown.
    blamed: (scans, pads), whether the pad contradicts the others and was left out. contradicted: (scans,), whether
    pads contradict each other and none could be blamed. pads: (scans,), number that contribute to the twist.
    """

    t_s: Floats
    twist: Floats
    twist_covariance: Floats
    pose: Floats
    pose_covariance: Floats
    rank: NDArray[np.int64]
    pose_rank: NDArray[np.int64]
    blind: Floats
    pose_blind: Floats
    observed: Floats
    blamed: Bools
    contradicted: Bools
    pads: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(frozen=True, slots=True)
class Contacts:
    """Features of the contact per scan and pad, in each pad's frame; NaN without contact, or where a loaded taxel is
    missing.

    t_s: (scans,). contact: (scans, pads). force, force_std: (scans, pads), N, normal to the skin; NaN for a sensor
    without a scale. area: (scans, pads), m^2, of the taxels above the noise. peak: (scans, pads), Pa or counts.
    centroid: (scans, pads, 2), m. axes: (scans, pads, 2), m, full length and width of the uniform ellipse with the
    same second moments. eccentricity: (scans, pads), from 0 (circle) to 1 (line). orientation, orientation_std: (scans,
    pads), rad, of the long axis, from -pi/2 to pi/2 anticlockwise from x; NaN where the contact is nearly round.
    """

    t_s: Floats
    contact: Bools
    force: Floats
    area: Floats
    peak: Floats
    centroid: Floats
    axes: Floats
    eccentricity: Floats
    orientation: Floats
    force_std: Floats
    orientation_std: Floats

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(frozen=True, slots=True)
class Texture:
    """What the pattern of each contact shows of the motion of the surface on it.

    t_s: (scans,). smooth: (scans, pads), whether the pattern is that of a smooth contact: it shows where the object
    touches, and stays where it is when a round object spins. turns: (scans, pads), whether the pattern changes when it
    is turned about the pad's normal; False for a smooth round one. unobservable: (scans, pads, 2, 2), b b^T + e^2 a a^T
    of a direction b along the pad, in its frame, in which the pattern has no gradient, and the one across it, a, with
    the variance e^2 of their angle; 1 where neither is observable, 0 where both are.
    """

    t_s: Floats
    smooth: Bools
    turns: Bools
    unobservable: Floats

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(frozen=True, slots=True)
class Event:
    """An event on a pad: `contact`, `release`, `slip_start`, `slip_stop` or `slip_suspected`.

    slip_suspected: the pose moves as in a slip, but load and tilt explain the change of the pattern as well.

    t_s: time of the scan in which it was detected; in a recording, where slips are dated offline, of the first scan
    after it. onset_s: its estimated time.
    direction_rad, speed_m_s, turn_rad_s: motion of the slip in the pad's frame: direction of the net displacement, path
    and turn over duration. path_m, turn_rad, duration_s: length of the path, net rotation, time from begin to end.
    std_*: standard deviations. All of the whole slip, at slip_start and at slip_stop; in a stream slip_start has the
    speed so far and no path. NaN where unknown, and for contact and release.
    evidence: log odds of a slip by the change of the pattern, NaN where unknown. quality: of the pose, in `QUALITY`.
    Both of slips only.
    """

    t_s: float
    pad: str
    event: str
    onset_s: float = nan
    direction_rad: float = nan
    speed_m_s: float = nan
    turn_rad_s: float = nan
    evidence: float = nan
    quality: str = ""
    path_m: float = nan
    turn_rad: float = nan
    duration_s: float = nan
    std_speed_m_s: float = nan
    std_path_m: float = nan
    std_turn_rad: float = nan
    std_duration_s: float = nan

    def withdraws(self, stop_s: float) -> bool:
        """Whether this `slip_start` withdraws the stop at a time, s: it began before, so the same slip goes on."""
        return self.onset_s < stop_s


@dataclass(frozen=True, slots=True, eq=False)
class Output:
    """Results of some scans: motion and quality of every pad, whether it slips (scans, pads), the object's motion, what
    the contacts are like, the events that are complete (in a batch, those from a slip's begin on wait for its end),
    evidence (scans, pads): log odds of a slip by the pattern's change, statistic (scans, pads): see
    `slip.stage.Judged`, and motion in space where pads have places.
    """

    slips: Slips
    slipping: Bools
    motions: Motions
    events: list[Event]
    contacts: Contacts
    evidence: Floats
    statistic: Floats
    spatial: SpatialMotions | None = None

    def __len__(self) -> int:
        return len(self.slips)

    @property
    def suspected(self) -> Bools:
        """(scans, pads), whether a pad slips, or its pose does without its pattern's consent; a grip acts on both."""
        suspected: Bools = self.slipping | (self.statistic > 1.0)
        return suspected


@dataclass(frozen=True, slots=True, eq=False)
class LearnedPattern:
    """Pressure map of an object, estimated from many scans, finer than the taxels.

    In the object's frame: a point u of it lies on the pad at pose_xy + R(theta) u, with the pose of `Slips` (theta 0
    where it is unknown); in a stream, with the last poses.
    pad: name. t_first_s, t_last_s: times of the first and last of the `scans` scans that it is estimated from.
    x_m: (nx,), y_m: (ny,), coordinates. pressure: (ny, nx), predicted reading of a taxel there at their mean load, Pa
    (counts for a sensor without a scale); NaN where no taxel has been. std: (ny, nx), standard deviation of the
    pressure for exact poses.
    turns: whether its rotation is observable. dead: numbers of taxels in the scan that were masked as dead.
    """

    pad: str
    t_first_s: float
    t_last_s: float
    scans: int
    x_m: Floats
    y_m: Floats
    pressure: Floats
    std: Floats
    turns: bool
    dead: NDArray[np.int64]


_SHARED = ("noise", "ceiling")
"""Fields without an axis of scans."""


def no_scans(entries: int, pads: int, scans: int = 0) -> Scans:
    """A block of scans without contact, none by default: the start and end of a session."""
    noise, ceiling = np.zeros(entries), np.full(entries, np.inf)
    untouched = np.zeros((scans, pads), dtype=np.bool_)
    return Scans(np.zeros(scans), np.zeros((scans, entries)), noise, ceiling, untouched, ~untouched)


def joined(blocks: Sequence[Joined]) -> Joined:
    """One or more consecutive blocks of one kind as a single block, field by field.

    Arrays and lists are joined, blocks within blocks as well; a field that is None in all stays None. Scans must have
    the same noise and ceiling.
    """
    first = blocks[0]
    if len(blocks) == 1:
        return first
    shared = _SHARED if isinstance(first, Scans) else ()
    parts = {
        field.name: getattr(first, field.name)
        if field.name in shared
        else _joined_field([getattr(block, field.name) for block in blocks])
        for field in fields(first)
    }
    return type(first)(**parts)


def _joined_field(parts: list[Any]) -> Any:
    known = [part for part in parts if part is not None]
    if not known:
        return None
    if isinstance(known[0], np.ndarray):
        return np.concatenate(known)
    return [item for part in known for item in part] if isinstance(known[0], list) else joined(known)


def cut(block: Block, start: int, stop: int) -> Block:
    """Scans `start` to `stop` (excluded) of a block, as views."""
    return of_scans(block, slice(start, stop))


def of_scans(block: Block, scans: slice | Bools) -> Block:
    """Some scans of a block: a slice as views, others, by (scans,), as copies."""
    kind = type(block)
    names = kind.__match_args__  # of the dataclass; `fields` builds its answer each time
    return kind(*(part if (part := getattr(block, name)) is None or name in _SHARED else part[scans] for name in names))


def _sum(first: Floats | None, second: Floats | None) -> Floats | None:
    """Of what is known."""
    if first is None or second is None:
        return second if first is None else first
    return first + second


def split(blocks: Sequence[Block], count: int) -> tuple[Block, list[Block]]:
    """The first `count` scans of one or more consecutive blocks as one block, and what is left."""
    block = joined(blocks)
    return (block, []) if len(block) == count else (cut(block, 0, count), [cut(block, count, len(block))])


def _in_order(array: Floats) -> Floats:
    """Row by row in memory, as all kernels are compiled for."""
    return np.ascontiguousarray(array, dtype=np.float64)


def _unknown(*shape: int) -> Floats:
    """Array of NaN; several times faster than `np.full` for a single scan."""
    array: Floats = np.empty(shape)
    array.fill(np.nan)
    return array
