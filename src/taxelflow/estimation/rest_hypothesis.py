"""Poses beside the hypothesis that the object rests while its load shifts.

Every pose follows the load. A hand that swings, pulls or tilts an object shifts the load, and the object stays. So on a
sensor with an `unseen_error` the distance from where the object rested last, its reference, is a part of the covariance
until the pattern contradicts: until a slide explains its change since then at least as well as rest does, see
`rest_or_slide`. Patterns are compared from bin to bin; in a stream those of several pads one after the other, in scans
of the next bin. Where less than half of the load is still on taxels that were loaded at the reference, the object has
come that far. Until then the pose is the mean of both hypotheses, by their likelihood, unless it has slipped since.

Load that has shifted poses at rest goes on to shift when the object slides. So how far excursions went that came back,
without a slide, is learned, and is a part of the covariance of poses that have moved.

An object that has moved, and then stays, has a new reference; so has one that has moved so far that much of what is
over the pad now was not before. A batch knows how an excursion from the reference goes on: if a slide explains it
within 2 s, it was one from its beginning, or from where the slip stage dates the begin of its slip. How far the load
had shifted the pose by then stays in the covariance, see `HeldShift`.
"""

from __future__ import annotations

from collections import defaultdict, deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.held_shift import HeldShift
from taxelflow.estimation.rest_weight import Beside, weigh_rest
from taxelflow.estimation.sticking_poses import StickingPoses
from taxelflow.messages import Bools, Floats, joined
from taxelflow.numerics.bins import AHEAD_S
from taxelflow.numerics.clock import SAME_S
from taxelflow.numerics.rest_or_slide import compare, overlap
from taxelflow.numerics.rounding import BLURRED
from taxelflow.runtime.settled import Settled
from taxelflow.sensors.skins import PadNoise, skin_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Slips
    from taxelflow.numerics.bins import Bin
    from taxelflow.sensors.layout import Layout


class _Rest(NamedTuple):
    """When an object rests."""

    near: float = 0.1
    """Pitches from its reference up to which an object rests: so small a shift contradicts nothing."""
    known: float = 0.75
    """Share of the taxels that must have been over the pad at the reference; half of it is too little for a slide."""
    back: float = 0.5
    """Share of its largest distance from the reference below which an excursion has come back: a load has shifted."""
    stays_s: float = 0.4
    """Time for which an object that has moved stays within a quarter of a pitch until it rests."""


_REST = _Rest()


@dataclass(slots=True, eq=False)
class _Reference:
    """Where an object rests: pressure (taxels,), mean of some scans, and place (3,) in pitches and rad."""

    pressure: Floats
    scans: int
    place: Floats


@dataclass(slots=True, eq=False)
class _Rows:
    """Scans whose poses are not judged yet. t_s: (scans,). origin_m: (scans, pads, 2), of the reference; NaN if none.
    shifted: (scans, pads, 2, 2), see `Shifts`. moved: (scans, pads), whether a slide explains the pattern. excursion:
    (scans, pads), counts returns.
    """

    t_s: Floats
    origin_m: Floats
    shifted: Floats
    moved: Bools
    excursion: NDArray[np.int64]

    def after(self, count: int) -> _Rows:
        """Without the first scans, this many."""
        kept = self.t_s[count:], self.origin_m[count:], self.shifted[count:]
        return _Rows(*kept, self.moved[count:], self.excursion[count:])


class Shifts:
    """What the load does to the pose of an object that rests: covariance (2, 2), m^2, of excursions that came back."""

    def __init__(self) -> None:
        self.covariance = np.zeros((2, 2))
        self._bins = 0
        self.forget()

    def forget(self) -> None:
        """Leave out the present excursion: a slide explains it."""
        self._open: list[Floats] = []
        self._furthest_m = 0.0

    def see(self, away_m: Floats) -> None:
        """A bin in which no slide explains how far (2,) the pose is from its reference."""
        distance_m = float(np.hypot(*away_m))
        self._open.append(np.outer(away_m, away_m))
        self._furthest_m = max(self._furthest_m, distance_m)
        if distance_m > _REST.back * self._furthest_m:
            return
        self._bins += len(self._open)
        self.covariance = self.covariance + (sum(self._open) - len(self._open) * self.covariance) / self._bins
        self.forget()


class RestHypothesis:
    """Follows all pads. `see` gets bins of scans, `step` their poses, `weighed` the oldest of these once more."""

    def __init__(self, layout: Layout, *, stream: bool) -> None:
        self._layout, self._ahead_s, self._spreads = layout, 0.0 if stream else AHEAD_S, stream
        self._doubts = layout.unseen_error > 0.0
        self._pitch_m = np.sqrt(layout.pitch_m.prod(axis=1))
        pads = len(layout.pads)
        self._sticking, self._noise = StickingPoses(self._pitch_m), PadNoise(layout)
        self._coming: deque[Bin] = deque()
        self._due: deque[tuple[int, Bin, Floats]] = deque()  # pads to compare, the bin, and the pose at its end
        self._at_once = 0  # pads compared in one scan: all are done within a bin
        self._references: dict[int, _Reference] = {}
        self._stays: dict[int, tuple[Floats, float]] = {}  # where an object stays, and since when
        self._shifts: defaultdict[int, Shifts] = defaultdict(Shifts)
        self._shifted = np.zeros((pads, 2, 2))
        self._known = np.zeros(pads, dtype=np.bool_)
        self._origin_m = np.full((pads, 2), np.nan)
        self._moved, self._far = np.zeros((2, pads), dtype=np.bool_)
        self._excursion = np.zeros(pads, dtype=np.int64)
        self._rows: list[_Rows] = []
        self._held, self._slid = HeldShift(pads), np.full(pads, -1)
        self._weigh, none = Settled(weigh_rest), np.zeros((0, pads, 2, 2))
        flags, numbers = np.zeros((0, pads), np.bool_), np.zeros((0, pads), np.int64)
        beside = Beside(none[..., 0], none, none, flags, flags, numbers, np.zeros((0, pads)))
        self._weigh(
            beside,
            self._slid,
            self._pitch_m,
            np.zeros((0, pads, 3)),
            np.zeros((0, pads, 3, 3)),
            numbers.astype(np.uint8),
        )

    def see(self, bins: list[Bin]) -> None:
        """Bins that scans have completed, whose poses follow."""
        if self._doubts:
            self._coming += bins

    def step(self, slips: Slips) -> None:
        """Poses of scans, which follow those of the last call."""
        if not self._doubts:
            return
        known = slips.contact & np.isfinite(slips.pose[..., 0])
        origin_m, moved = np.empty((*known.shape, 2)), np.empty_like(known)
        shifted = np.empty((*known.shape, 2, 2))
        excursion = np.empty(known.shape, dtype=np.int64)
        for scan, t_s in enumerate(slips.t_s.tolist()):
            if known[scan].tobytes() != self._known.tobytes():
                self._end(known[scan])
            while self._coming and self._coming[0].until_s <= t_s:
                self._queue(self._coming.popleft(), slips.pose[scan])
            for _ in range(min(self._at_once, len(self._due))):
                self._compare(*self._due.popleft())
            origin_m[scan], moved[scan], excursion[scan] = self._origin_m, self._moved, self._excursion
            shifted[scan] = self._shifted
        self._rows.append(_Rows(slips.t_s, origin_m, shifted, moved, excursion))

    def weighed(
        self, slips: Slips, slipping: Bools, rests: Floats, sticks: Bools | None, begun_s: Floats | None
    ) -> Slips:
        """The oldest scans of `step` whose poses were not given out yet, weighed against rest.

        slipping: (scans, pads). rests: (scans, pads), log odds of rest by the pattern. sticks: (scans, pads), see
        `StickingPoses`; None where no shear is measured. begun_s: (scans, pads), see `Judged`; None in streams.
        """
        count = len(slips)
        if not self._doubts or not count:
            return slips
        rows = joined(self._rows)
        self._rows = [rows.after(count)] if len(rows.t_s) > count else []
        pose, covariance, quality = slips.pose.copy(), slips.covariance.copy(), slips.quality.copy()
        origin_m = rows.origin_m[:count]
        moved, held = rows.moved[:count], np.zeros((count, len(self._pitch_m), 2, 2))
        if begun_s is not None:
            slides, dated = begun_s <= slips.t_s[:, np.newaxis], np.isfinite(begun_s)
            held = self._held.step(slips.pose[..., :2] - origin_m, slides, moved, rows.excursion[:count])
            moved = moved | (_in_time(rows, self._ahead_s)[:count] & (slides | ~dated))
        if sticks is not None:
            origin_m = np.where(sticks[..., np.newaxis], self._sticking.touched(slips), origin_m)
            moved = moved & ~sticks
        beside = Beside(origin_m, rows.shifted[:count], held, moved, slipping, rows.excursion[:count], rests)
        self._weigh(beside, self._slid, self._pitch_m, pose, covariance, quality)
        slips = slips.judged(pose, covariance, quality)
        return slips if sticks is None else self._sticking.held(slips, origin_m, sticks)

    def _end(self, known: Bools) -> None:
        """Forget the references of objects that are lost, or have left. known: (pads,), with a pose."""
        for pad in np.flatnonzero(self._known & ~known).tolist():
            self._references.pop(pad, None)
            self._stays.pop(pad, None)
            self._shifts.pop(pad, None)
            self._shifted[pad] = 0.0
            self._origin_m[pad], self._moved[pad], self._far[pad] = np.nan, False, False
        self._due = deque(each for each in self._due if known[each[0]])
        self._excursion += known != self._known
        self._known = known.copy()

    def _queue(self, seen: Bin, pose: Floats) -> None:
        """Compare the patterns of a bin, in a stream pad by pad in the scans of the next one: no scan takes long. pose:
        (pads, 3), at its end.
        """
        pads = np.flatnonzero(seen.touching & seen.whole & self._known).tolist()
        self._due += ((pad, seen, pose[pad].copy()) for pad in pads)
        self._at_once = -(-len(self._due) // seen.scans) if self._spreads else len(self._due)

    def _compare(self, pad: int, seen: Bin, pose: Floats) -> None:
        """Does the object rest, at the end of a bin? pose: (3,)."""
        place, own = pose / (self._pitch_m[pad], self._pitch_m[pad], 1.0), self._layout.of_pad(pad)
        now = _Reference(seen.pressure[own] / seen.scans, seen.scans, np.nan_to_num(place))
        stays_at, since_s = self._stays.get(pad, (now.place, seen.until_s))
        if np.hypot(*(now.place - stays_at)[:2]) > BLURRED:
            stays_at, since_s = now.place, seen.until_s
        self._stays[pad] = stays_at, since_s
        before = self._references.get(pad)
        if before is not None:
            self._moved[pad] = self._has_moved(pad, before, now, float(self._noise.median(seen.noise)[pad]))
            shifts = self._shifts[pad]
            if self._moved[pad]:
                shifts.forget()
            else:
                shifts.see(pose[:2] - self._origin_m[pad])
            self._shifted[pad] = shifts.covariance
        rests = self._moved[pad] and seen.until_s - since_s > _REST.stays_s + SAME_S
        if before is None or rests:
            self._moved[pad] = False
            self._excursion[pad] += 1
        if before is None or rests or self._far[pad]:
            self._references[pad], self._origin_m[pad] = now, pose[:2]

    def _has_moved(self, pad: int, before: _Reference, now: _Reference, noise: float) -> bool:
        """Whether a slide explains a pattern at least as well as rest. noise: standard deviation of a reading."""
        away, skin = now.place - before.place, skin_of(self._layout, pad)
        self._far[pad] = False
        if not overlap(skin, before.pressure, now.pressure).comparable:
            return True
        if np.hypot(*away[:2]) < _REST.near:
            self._excursion[pad] += 1
            return False
        noise *= np.sqrt(1.0 / before.scans + 1.0 / now.scans)
        left = compare(skin, before.pressure, now.pressure, noise, away, sinks=True)
        moves = left.moves(away[:2])
        self._far[pad] = moves and left.known < _REST.known
        return moves


def _in_time(rows: _Rows, ahead_s: float) -> Bools:
    """(scans, pads), whether a slide explains the pattern, or will within a time, in the same excursion."""
    moved, next_s = rows.moved.copy(), np.full(rows.moved.shape[1], np.inf)
    last = np.full(rows.moved.shape[1], -1)
    for scan in range(len(moved) - 1, -1, -1):
        next_s = np.where(rows.excursion[scan] == last, next_s, np.inf)
        last = rows.excursion[scan]
        next_s = np.where(rows.moved[scan], rows.t_s[scan], next_s)
        moved[scan] |= next_s <= rows.t_s[scan] + ahead_s + SAME_S
    return moved
