"""Slips of a recording: when each began and ended, dated from the scans before and after.

A stream must call a slip from what it has seen so far, a scan or two late. In a recording the scans that follow are
known too: around each begin and end the path of the object is at rest on one side and at one speed on the other, with a
bend between them whose time is found by least squares, to a fraction of a scan. What counts as a slip is decided by the
live monitor, but for one thing: what comes back at once to where it was, was a pose gone wrong. So there are never more
false alarms than live.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import Bools, Event, Floats, Slips
from taxelflow.slip.session import SlipSession

if TYPE_CHECKING:
    from taxelflow.slip.parameters import SlipMonitor

_BACK, _AHEAD = 64, 20
"""A change is dated at most so many scans before the one that told of it, with what was seen up to so many after it."""
_SIDE = 20
"""Scans on each side of a bend that are looked at."""
_SEARCH, _STEPS = 8.0, 10
"""A bend is looked for within so many scans of where the monitor thinks it is, in steps of a scan over the second."""
_FEWEST = 2
"""Scans that there must be on each side of a bend."""
_AWAY = 4.0
"""A short slip ends at least so many standard deviations from where it began."""


@dataclass(slots=True, eq=False)
class _Pad:
    """What was told of a pad and is not dated yet, each with its scan; what is dated; the last date; does it slip?

    leapt: its slip was over before it was told.
    """

    told: list[tuple[int, Event]] = field(default_factory=list)
    dated: list[Event] = field(default_factory=list)
    last_s: float = -np.inf
    slipping: bool = False
    leapt: bool = False


class HindsightSession:
    """Like `SlipSession`, but what is said of a scan is said later, and does not change with how scans are cut."""

    def __init__(self, parameters: SlipMonitor, pads: tuple[str, ...]) -> None:
        self._live = SlipSession(parameters, pads)
        self._numbers = {name: number for number, name in enumerate(pads)}
        self._pads = [_Pad() for _ in pads]
        # Of the scans from `_first` on: time, of the pose (pads,) too, displacement and pose's variance (pads, 3).
        self._first = self._given = 0
        self._t, self._when = np.zeros(0), np.zeros((0, len(pads)))
        self._moved, self._variance = np.zeros((0, len(pads), 3)), np.zeros((0, len(pads), 3))

    @property
    def scatter(self) -> Floats:
        """(pads,), see `SlipSession.scatter`."""
        return self._live.scatter

    def step(self, slips: Slips) -> tuple[Bools, list[Event]]:
        """Slipping (scans, pads) of the next scans that nothing to come can change, which may be none; and what began
        or ended in them. `t_s` of a slip's events is the first scan that does, or no longer does, slip.
        """
        _, events = self._live.step(slips)
        seen = (
            slips.t_s,
            slips.t_s[:, np.newaxis] - np.nan_to_num(slips.lag_s),
            np.where(slips.contact[..., np.newaxis], slips.displacement, np.nan),
            np.einsum("kpii,kp->kpi", slips.displacement_covariance, np.where(slips.lag_s > 0, 1.0, 0.5)),
        )
        held = (self._t, self._when, self._moved, self._variance)
        self._t, self._when, self._moved, self._variance = map(np.concatenate, zip(held, seen, strict=True))
        for event in events:
            scan = self._first + int(np.searchsorted(self._t, event.t_s))
            self._pads[self._numbers[event.pad]].told.append((scan, event))
        return self._settle(self._first + len(self._t))

    def finish(self) -> tuple[Bools, list[Event]]:
        """What `step` has held back."""
        return self._settle(self._first + len(self._t) + _BACK + _AHEAD)

    def _settle(self, seen: int) -> tuple[Bools, list[Event]]:
        """Date what is due after so many scans, and give the scans that nothing to come can change."""
        for number, pad in enumerate(self._pads):
            while pad.told and pad.told[0][0] + _AHEAD < seen:
                self._date(number, pad)
        start, stop = self._given, max(seen - _BACK - _AHEAD, self._given)
        times = self._t[start - self._first : stop - self._first]
        slipping = np.zeros((len(times), len(self._pads)), dtype=np.bool_)
        found: list[tuple[int, int, Event]] = []
        for number, pad in enumerate(self._pads):
            done = 0
            while pad.dated and len(times) and pad.dated[0].onset_s <= times[-1]:
                event = pad.dated.pop(0)
                scan = int(np.searchsorted(times, event.onset_s))
                slipping[done:scan, number], done = pad.slipping, scan
                found.append((scan, number, _as_told(event, float(times[scan]))))
                pad.slipping = {"slip_start": True, "slip_stop": False}.get(event.event, pad.slipping)
            slipping[done:, number] = pad.slipping
        self._given = stop
        self._forget(stop - _BACK - _SIDE)
        return slipping, [event for _, _, event in sorted(found, key=lambda one: one[:2])]

    def _forget(self, scan: int) -> None:
        """Drop what was seen before this scan."""
        old = max(scan - self._first, 0)
        self._first += old
        self._t, self._when = self._t[old:], self._when[old:]
        self._moved, self._variance = self._moved[old:], self._variance[old:]

    def _date(self, number: int, pad: _Pad) -> None:
        """Date the oldest thing told of a pad; a stop that is soon taken back was none.

        A slip that was over before it was told is one of `leap`, faster than the scans: there is no way to be dated by.
        """
        scan, event = pad.told.pop(0)
        later = [(k, other) for k, other in pad.told if k <= scan + _AHEAD]
        if event.event in ("contact", "release"):
            pad.dated.append(replace(event, onset_s=event.t_s))
            pad.last_s = event.t_s
            return
        taken_back = event.event == "slip_stop" and later and later[0][1].onset_s < event.onset_s
        if taken_back or (event.event == "slip_start" and later and self._returns(number, scan, event, later[0])):
            pad.told.pop(0)
            return
        until = later[0][1].onset_s if later else np.inf
        starts = event.event == "slip_start"
        leapt = until < event.t_s if starts else pad.leapt
        pad.leapt = starts and leapt
        as_told = leapt or np.isnan(event.speed_m_s)
        when = event.onset_s if as_told else self._bend(number, scan, event, pad.last_s, until)
        earliest = self._t[max(scan - _BACK - self._first, 0)]
        pad.last_s = float(max(when, earliest, pad.last_s))
        pad.dated.append(replace(event, onset_s=pad.last_s))

    def _returns(self, number: int, scan: int, start: Event, end: tuple[int, Event]) -> bool:
        """Whether a short slip has led nowhere: what was told at a scan, and its stop."""
        if np.isnan(start.speed_m_s) or np.isnan(end[1].speed_m_s):
            return False
        when, first = self._when[:, number], self._first
        low = max(scan - _BACK - first, 0)
        begin, stop = (int(np.searchsorted(when, one.onset_s, side="right")) for one in (start, end[1]))
        last = min(scan + _AHEAD + 1 - first, len(when))
        moved, variance = self._moved[:, number], self._variance[:, number]
        before, after = slice(max(begin - _SIDE, low), begin), slice(stop, last)
        if (
            begin - before.start < _FEWEST
            or last - stop < _FEWEST
            or np.isnan(moved[before.start + 1 : last, :2]).any()
        ):
            return False
        place = np.cumsum(np.where(np.arange(last)[:, np.newaxis] > before.start, moved[:last], 0.0), axis=0)
        away = place[after].mean(axis=0) - place[before].mean(axis=0)
        unsure = sum(variance[side].mean(axis=0) / len(place[side]) for side in (before, after))
        known = np.isfinite(away) & np.isfinite(unsure)
        return bool((np.abs(away[known]) < _AWAY * np.sqrt(unsure[known])).all())

    def _bend(self, number: int, scan: int, event: Event, since_s: float, until_s: float) -> float:
        """Where a pad's path bends, near the onset_s of an event told at a scan; it did not before since_s, it does
        again at until_s.
        """
        start, stop = max(scan - _BACK - self._first, 0), scan + _AHEAD + 1 - self._first
        when, moved = self._when[start:stop, number], self._moved[start:stop, number]
        near = int(np.searchsorted(when, event.onset_s))
        broken = np.flatnonzero(np.isnan(moved[:, 0]))
        low = max(near - _SIDE, int(np.searchsorted(when, since_s)), *broken[broken <= near].tolist(), 0)
        high = min(near + _SIDE, int(np.searchsorted(when, until_s)), *broken[broken > near].tolist(), len(when))
        if near - low < _FEWEST or high - near < _FEWEST:
            return event.onset_s
        here = slice(low, high)
        place = np.cumsum(np.where(np.arange(high - low)[:, np.newaxis] > 0, moved[here], 0.0), axis=0)
        weight = 1.0 / np.maximum(self._variance[start:stop, number][here], 1e-12)
        known = np.isfinite(place).all(axis=0) & np.isfinite(weight).all(axis=0)
        return _bent(
            when[here], place[:, known], weight[:, known], event.onset_s, 1 if event.event == "slip_start" else -1
        )


def _bent(t: Floats, place: Floats, weight: Floats, near_s: float, side: int) -> float:
    """Time at which a path (scans, axes) that rests, and moves at one speed after it (side 1) or before it (-1), bends.

    For each time tried, what the speed explains of the weighted squares has a closed form.
    """
    scan_s = float(np.median(np.diff(t)))
    tries = near_s + scan_s * np.arange(-_SEARCH, _SEARCH + 0.5 / _STEPS, 1.0 / _STEPS)
    tries = tries[(tries >= t[0]) & (tries <= t[-1])]
    ramp = np.maximum(side * (t - tries[:, np.newaxis]), 0.0)
    total = weight.sum(axis=0)
    mean = ramp @ weight / total
    along = ramp @ (weight * place) - mean * (weight * place).sum(axis=0)
    spread = ramp**2 @ weight - mean**2 * total
    explained = (along**2 / np.where(spread > 0, spread, np.inf)).sum(axis=1)
    return float(tries[np.argmax(explained)]) if len(tries) and explained.max() > 0 else near_s


def _as_told(event: Event, t_s: float) -> Event:
    """An event as it is given: at the first scan that is different; contact and release have no onset of their own."""
    if event.event in ("contact", "release"):
        return Event(t_s, event.pad, event.event)
    return replace(event, t_s=t_s)
