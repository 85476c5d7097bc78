"""Events of slips completed by the motion of the whole slip, as fitted to its poses.

In a recording begin and end of a slip both carry its motion: events from the begin of a slip on wait for its end. A
stream gives each event at once, so that only the end carries the motion, from the scans since the slip was reported.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from math import isnan, nan
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np

from taxelflow.messages import LOST, Floats
from taxelflow.numerics.records import Records, Vector, record_dtype, records
from taxelflow.slip.slip_fit import SlipMotion, fit_slip, integrate_slip

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Event, Slips

_MOST_ROWS = 512
"""Rows of a slip that are held. Of a longer slip neighbours are averaged, so that memory and time are bounded."""
_MIN_POSES = 3
"""Poses for a fit of position and velocity with one to spare."""
_SAME_S = 1e-9
"""Rounding of a clock."""


class _Row:
    """What is held of a scan: time of the pose, the pose, the displacement."""

    t_s: float
    pose: Vector
    covariance: Annotated[Floats, 3, 3]
    displacement: Vector
    displacement_covariance: Annotated[Floats, 3, 3]


@dataclass(slots=True, eq=False)
class _Held:
    """An event on its way to the output. waits: for the end of its slip."""

    event: Event
    waits: bool = False


@dataclass(slots=True, eq=False)
class _Slip:
    """A slip that goes on. room: (_MOST_ROWS,) of `_Row`, of which `held` are used. lost: its poses are in more than
    one frame.
    """

    start: _Held
    room: Records = field(default_factory=lambda: records(_Row, _MOST_ROWS))
    held: int = 0
    last_s: float = nan
    lost: bool = False

    @property
    def rows(self) -> Records:
        """(held,)."""
        return self.room[: self.held]

    def add(self, new: Records) -> None:
        """Add scans (scans,) that slip; the result does not depend on how they are cut into blocks."""
        while len(new):
            count = min(len(new), _MOST_ROWS - self.held)
            self.room[self.held : self.held + count] = new[:count]
            self.held, new = self.held + count, new[count:]
            if self.held == _MOST_ROWS:
                self.held = _MOST_ROWS // 2
                self.room[: self.held] = _in_pairs(self.room)

    def motion(self, end_s: float) -> SlipMotion:
        """From the slip's onset to a time, s."""
        start_s, rows = self.start.event.onset_s, self.rows
        inside = (rows["t_s"] >= start_s - _SAME_S) & (rows["t_s"] <= end_s + _SAME_S)
        inside &= _has_place(rows)
        if not self.lost and inside.sum() >= _MIN_POSES:
            known = rows[inside]
            with suppress(np.linalg.LinAlgError):  # a method from elsewhere may give poses without covariance
                return fit_slip(known["t_s"].copy(), known["pose"].copy(), known["covariance"].copy(), start_s, end_s)
        return integrate_slip(rows["displacement"], rows["displacement_covariance"], start_s, end_s)


class _Block(NamedTuple):
    """Scans of one call. slipping: (scans, pads). rows: (scans, pads), of `_Row`."""

    slips: Slips
    slipping: Bools
    rows: Records


class SlipEvents:
    """Completes the events of all pads, block by block."""

    def __init__(self, pads: tuple[str, ...], *, stream: bool) -> None:
        self._numbers = {name: number for number, name in enumerate(pads)}
        self._stream = stream
        self._open: dict[int, _Slip] = {}
        self._held: list[_Held] = []

    def step(self, slips: Slips, slipping: Bools, events: list[Event]) -> list[Event]:
        """Events that are complete, in time order. slipping: (scans, pads). events: of these scans, in time order."""
        if not events:
            if len(slips) == 1 and self._open:
                self._add_one(slips, slipping)
            if len(slips) < 2 or not self._open:  # nothing is complete but for events
                return []
        own: dict[int, list[_Held]] = {number: [] for number in self._open}
        for event in events:
            held = _Held(event)
            self._held.append(held)
            if event.event in ("slip_start", "slip_stop"):
                own.setdefault(self._numbers[event.pad], []).append(held)
        if not own:
            return self._complete()
        block = _Block(slips, slipping, _rows(slips))
        for pad, changes in own.items():
            done = 0
            for held in changes:
                scan = int(np.searchsorted(slips.t_s, held.event.t_s))
                self._add(block, pad, done, scan)
                if pad in self._open:  # the slip's last displacement ends in the scan that no longer slips
                    self._hold(block, pad, scan, scan + 1)
                self._change(pad, held)
                done = scan
            self._add(block, pad, done, len(slips))
        return self._complete()

    def finish(self) -> list[Event]:
        """Events that `step` has held back; slips that go on end with the last scan."""
        for slip in self._open.values():
            if slip.start.waits:
                slip.start.event = _with_motion(slip.start.event, slip.motion(slip.last_s))
                slip.start.waits = False
        self._open = {}
        return self._complete()

    def _add_one(self, slips: Slips, slipping: Bools) -> None:
        """The same for a single scan without events, as a live loop gives it."""
        now, lost = slipping[0].tolist(), (slips.quality[0] == LOST).tolist()
        rows = _rows(slips)[0]
        for pad, slip in self._open.items():
            if now[pad]:
                slip.last_s = float(slips.t_s[0])
                slip.lost = slip.lost or lost[pad]
                slip.add(rows[pad : pad + 1])

    def _add(self, block: _Block, pad: int, start: int, stop: int) -> None:
        """Add the scans from start up to the last before stop that slips."""
        if pad not in self._open:
            return
        while stop > start and not block.slipping[stop - 1, pad]:
            stop -= 1
        if stop > start:
            self._hold(block, pad, start, stop)

    def _hold(self, block: _Block, pad: int, start: int, stop: int) -> None:
        slip = self._open[pad]
        if start < len(block.rows):
            slip.last_s = float(block.slips.t_s[min(stop, len(block.rows)) - 1])
            slip.lost = slip.lost or LOST in block.slips.quality[start:stop, pad].tolist()
            slip.add(block.rows[start:stop, pad])

    def _change(self, pad: int, held: _Held) -> None:
        """Begin or end a slip."""
        slip = self._open.pop(pad, None)
        if slip is not None:
            motion = slip.motion(held.event.onset_s)
            if slip.start.waits:
                slip.start.event, slip.start.waits = _with_motion(slip.start.event, motion), False
            if held.event.event == "slip_stop":
                held.event = _with_motion(held.event, motion)
        if held.event.event == "slip_start":
            held.waits = not self._stream
            self._open[pad] = _Slip(held)

    def _complete(self) -> list[Event]:
        """The oldest events, up to the first that waits."""
        count = next((number for number, held in enumerate(self._held) if held.waits), len(self._held))
        done, self._held = self._held[:count], self._held[count:]
        return [held.event for held in done]


def _with_motion(event: Event, motion: SlipMotion) -> Event:
    """An event with the motion of its slip; what the detector saw of it stays where the motion is unknown."""
    if isnan(motion.speed_m_s):
        return replace(event, duration_s=motion.duration_s, std_duration_s=motion.std_duration_s)
    return replace(
        event,
        direction_rad=motion.direction_rad,
        speed_m_s=motion.speed_m_s,
        turn_rad_s=motion.turn_rad / motion.duration_s if not isnan(motion.turn_rad) else nan,
        path_m=motion.path_m,
        turn_rad=motion.turn_rad,
        duration_s=motion.duration_s,
        std_speed_m_s=motion.std_speed_m_s,
        std_path_m=motion.std_path_m,
        std_turn_rad=motion.std_turn_rad,
        std_duration_s=motion.std_duration_s,
    )


def _rows(slips: Slips) -> Records:
    """(scans, pads), what is held of each scan."""
    rows = np.empty(slips.contact.shape, dtype=record_dtype(_Row))
    rows["t_s"] = slips.t_s[:, np.newaxis] - np.where(np.isnan(slips.lag_s), 0.0, slips.lag_s)
    rows["pose"], rows["covariance"] = slips.pose, slips.covariance
    rows["displacement"], rows["displacement_covariance"] = slips.displacement, slips.displacement_covariance
    return rows


def _has_place(rows: Records) -> Bools:
    """(rows,), whether the place is known."""
    known: Bools = np.isfinite(rows["pose"][:, 0])
    return known


def _in_pairs(rows: Records) -> Records:
    """(rows / 2,): means of neighbouring poses, with their covariance, and sums of displacements."""
    one, other = rows[::2], rows[1::2]
    pairs = np.empty_like(one)
    for name, share in (("t_s", 0.5), ("pose", 0.5), ("covariance", 0.25)):
        pairs[name] = share * (one[name] + other[name])
        for known, lacks in ((one, other), (other, one)):
            alone = ~_has_place(lacks) & _has_place(known)
            pairs[name][alone] = known[name][alone]
    for name in ("displacement", "displacement_covariance"):
        pairs[name] = np.where(np.isnan(one[name]), other[name], one[name] + np.nan_to_num(other[name]))
    return pairs
