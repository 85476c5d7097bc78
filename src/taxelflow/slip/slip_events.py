"""Events of slips completed by the motion of the whole slip, as fitted to its poses.

In a recording begin and end of a slip both carry its motion: events from the begin of a slip on wait for its end. A
stream gives each event at once, so that only the end carries the motion, from the scans since the slip was reported. A
slip of fewer than three of them, or without poses, has the motion that the detector saw before them. A slip whose stop
was withdrawn keeps the scans before that stop.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from math import cos, isnan, nan, sin
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.clock import ROUNDING_S
from taxelflow.numerics.records import records
from taxelflow.numerics.rounding import LINE_POINTS
from taxelflow.runtime.blocks import is_block
from taxelflow.runtime.settled import Settled
from taxelflow.slip.cut_contact import Steps, at_velocity, joined_steps, steady_velocity, steps_of, within
from taxelflow.slip.slip_fit import SlipMotion, fit_slip, integrate_slip
from taxelflow.slip.slip_rows import MOST_ROWS, Progress, Row, hold_block, hold_scans

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.messages import Bools, Event, Floats, Slips
    from taxelflow.numerics.records import Records


@dataclass(slots=True, eq=False)
class _Held:
    """An event on its way to the output. waits: for the end of its slip."""

    event: Event
    waits: bool = False


class SlipEvents:
    """Completes the events of all pads, block by block."""

    def __init__(self, pads: tuple[str, ...], *, stream: bool) -> None:
        self._numbers = {name: number for number, name in enumerate(pads)}
        self._stream = stream
        self._open: dict[int, _Held] = {}
        """Begins of the slips that go on, by pad."""
        self._end_s: dict[int, float] = {}
        """Latest stop, by pad, s."""
        self._loss: Floats | None = None
        self._steps: dict[int, Steps] = {}
        """Of the slips that go on, in a recording."""
        self._progress, self._room = records(Progress, len(pads)), records(Row, len(pads), MOST_ROWS)
        self._held: list[_Held] = []
        self._before_s = self._scan_s = 0.0
        """Time of the scan before this block, and between the scan in which a slip ends and the one before it."""
        self._hold_scans = Settled(hold_scans)

    def step(self, slips: Slips, slipping: Bools, events: list[Event], loss: Floats | None = None) -> list[Event]:
        """Events that are complete, in time order. slipping: (scans, pads). events: of these scans, in time order.

        loss: (scans, pads, 2, 2), see `cut_contact`, of a recording.
        """
        self._loss = loss
        if not events:
            if self._open:
                self._hold(slips, slipping, tuple(self._open), 0, len(slips))
            self._pass(slips)
            return []
        own: dict[int, list[_Held]] = {}
        for event in events:
            held = _Held(event)
            self._held.append(held)
            if event.event in ("slip_start", "slip_stop"):
                own.setdefault(self._numbers[event.pad], []).append(held)
        self._hold(slips, slipping, tuple(self._open.keys() - own.keys()), 0, len(slips))
        for pad, changes in own.items():
            done = 0
            for held in changes:
                scan = int(np.searchsorted(slips.t_s, held.event.t_s))
                self._hold(slips, slipping, (pad,), done, scan)
                # The slip's last displacement ends in the scan that no longer slips.
                self._hold(slips, np.ones_like(slipping), (pad,), scan, scan + 1)
                self._scan_s = float(slips.t_s[scan] - (slips.t_s[scan - 1] if scan else self._before_s))
                self._change(pad, held)
                done = scan
            self._hold(slips, slipping, (pad,), done, len(slips))
        self._pass(slips)
        return self._complete()

    def finish(self) -> list[Event]:
        """Events that `step` has held back; slips that go on end with the last scan."""
        for pad, start in self._open.items():
            if start.waits:
                start.event, start.waits = _with_motion(start.event, self._motion(pad, start, None)), False
        self._open = {}
        return self._complete()

    def _pass(self, slips: Slips) -> None:
        """Keep the times of the last two scans, for a slip that ends in the next block, or with the recording."""
        if len(slips):
            before_s, self._before_s = (slips.t_s[-2] if len(slips) > 1 else self._before_s), float(slips.t_s[-1])
            self._scan_s = float(self._before_s - before_s)

    def _hold(self, slips: Slips, slipping: Bools, pads: Sequence[int], start: int, stop: int) -> None:
        """Hold the scans from start up to the last before stop that slips, of those of the pads whose slip goes on."""
        chosen = np.array([pad for pad in pads if pad in self._open], dtype=np.int64)
        if len(chosen) and start < min(stop, len(slips)):
            seen = (slips.pose, slips.covariance, slips.displacement, slips.displacement_covariance)
            self._keep(slips, slipping, chosen.tolist(), start, min(stop, len(slips)))
            times = (slips.t_s, slips.lag_s)
            marks = (slipping, slips.quality)
            hold = hold_block if is_block(len(slips), hold_scans) else self._hold_scans
            hold(times, seen, marks, chosen, (start, min(stop, len(slips))), self._progress, self._room)

    def _keep(self, slips: Slips, slipping: Bools, pads: list[int], start: int, stop: int) -> None:
        """Keep the displacements of these scans of a recording, up to the last that slips."""
        if self._loss is None:  # a stream has no losses at borders: this is a tenth of its step otherwise
            return
        for pad in pads:
            count = int(np.max(np.flatnonzero(slipping[start:stop, pad]), initial=-1)) + 1
            before = [self._steps[pad]] if pad in self._steps else []
            new = steps_of(slips, self._loss, pad, start, start + count)
            self._steps[pad] = within(joined_steps([*before, new]), MOST_ROWS)

    def _change(self, pad: int, held: _Held) -> None:
        """Begin or end a slip."""
        start = self._open.pop(pad, None)
        if start is not None:
            motion = self._motion(pad, start, held.event.onset_s)
            if start.waits:
                start.event, start.waits = _with_motion(start.event, motion), False
            if held.event.event == "slip_stop":
                held.event, self._end_s[pad] = _with_motion(held.event, motion), held.event.onset_s
        if held.event.event == "slip_start":
            held.waits = not self._stream
            self._open[pad] = held
            if not held.event.withdraws(self._end_s.get(pad, -np.inf)):
                self._progress[pad] = (0, nan, False)
                self._steps.pop(pad, None)

    def _motion(self, pad: int, start: _Held, end_s: float | None) -> SlipMotion:
        """Of a slip from its onset to a time, s; to its last scan if None."""
        progress = self._progress[pad]
        start_s, rows = start.event.onset_s, self._room[pad, : progress["held"]]
        end_s = float(progress["last_s"]) if end_s is None else end_s
        inside = (rows["t_s"] >= start_s - ROUNDING_S) & (rows["t_s"] <= end_s + ROUNDING_S)
        inside &= np.isfinite(rows["pose"][:, 0])
        if not progress["lost"] and inside.sum() >= LINE_POINTS:
            known: Records = rows if inside.all() else rows[inside]
            with suppress(np.linalg.LinAlgError):  # a method from elsewhere may give poses without covariance
                motion = fit_slip(known["t_s"].copy(), known["pose"].copy(), known["covariance"].copy(), start_s, end_s)
                velocity = steady_velocity(self._steps.get(pad))
                return motion if velocity is None else at_velocity(motion, velocity)
        displacement, covariance = rows["displacement"], rows["displacement_covariance"]
        if self._stream and len(rows) and not isnan(start.event.speed_m_s):
            begun_s = min(float(rows["t_s"][0]), end_s) - start_s
            if begun_s > ROUNDING_S:
                before = _begun(start.event, begun_s)
                displacement = np.vstack([before, displacement[1:]])
                covariance = np.vstack([[_unsure(before)], covariance[1:]])
        return integrate_slip(displacement, covariance, start_s, end_s, self._scan_s)

    def _complete(self) -> list[Event]:
        """The oldest events, up to the first that waits."""
        count = next((number for number, held in enumerate(self._held) if held.waits), len(self._held))
        done, self._held = self._held[:count], self._held[count:]
        return [held.event for held in done]


def _begun(start: Event, time_s: float) -> Floats:
    """Displacement (3,) of a stream's slip up to the first scan that is held, as the detector saw it."""
    way = time_s * start.speed_m_s
    return np.array([way * cos(start.direction_rad), way * sin(start.direction_rad), time_s * start.turn_rad_s])


def _unsure(displacement: Floats) -> Floats:
    """Covariance (3, 3) of a displacement (3,) that may be wrong by all of itself."""
    length_m, turn_rad = np.hypot(displacement[0], displacement[1]), displacement[2]
    return np.diag([length_m**2, length_m**2, turn_rad**2])


def _with_motion(event: Event, motion: SlipMotion) -> Event:
    """An event with the motion of its slip; what the detector saw of it stays where the motion is unknown."""
    if isnan(motion.speed_m_s):
        return replace(event, duration_s=motion.duration_s, std_duration_s=motion.std_duration_s)
    turn_rad_s = motion.turn_rad / motion.duration_s if not isnan(motion.turn_rad) else nan
    known = {name: getattr(motion, name) for name in SlipMotion.__match_args__}  # `asdict` takes ten times as long
    return replace(event, turn_rad_s=turn_rad_s, **known)
