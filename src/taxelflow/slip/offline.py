"""Offline change-point refinement: begin and end of each slip of a recording, from the scans before and after.

A stream reports a slip from the scans so far, a scan or two late. In a recording the scans that follow are known. Near
each begin and end the path is constant on one side and has a constant velocity on the other; least squares estimates
the time of the change to a fraction of a scan. The detector decides what is a slip, with one exception: a short slip
that returns to its start was an outlier. So a recording has no more false alarms than a stream.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import Event, Floats, Slips
from taxelflow.numerics.clock import SAME_S
from taxelflow.numerics.rounding import ROUNDING
from taxelflow.slip.measurement import LEAST_STD
from taxelflow.slip.onset import RAMPS
from taxelflow.slip.session import Detected, SlipSession

if TYPE_CHECKING:
    from taxelflow.numerics.records import Records


@dataclass(frozen=True, slots=True)
class _Search:
    """Where a change is searched, and with which scans."""

    span_s: float = RAMPS.age_s
    """A change lies at most this long before its report, the largest age of a ramp of the onset detector; and a report
    is withdrawn at most this long after it. Where scans are few, both are as many scans as the next two."""
    back_scans: int = RAMPS.age_scans
    ahead_scans: int = 20
    """The fit uses at most the second number of scans after the report."""
    side_scans: int = 20
    least_side_scans: int = 2
    """Most and fewest scans on each side of a change that the fit uses."""
    scans: float = 8.0
    steps_per_scan: int = 10
    """The change is searched within this many scans of the detector's estimate, on a grid of this many points per
    scan."""


_SEARCH = _Search()
_RETURN_SIGMAS = 4.0
"""A short slip counts if its end is this many standard deviations away from its start."""


@dataclass(slots=True, eq=False)
class _PadEvents:
    """Events of one pad on their way to the output."""

    pending: list[tuple[int, Event]] = field(default_factory=list)
    """Reported by the detector, not refined yet, each with its scan."""
    refined: list[Event] = field(default_factory=list)
    """Refined, not given yet."""
    last_s: float = -np.inf
    """Time of the last refined event."""
    slipping: bool = False
    """After the last event given."""
    jumped: bool = False
    """The slip was over before it was reported."""


class OfflineSlipSession:
    """Slip detection in a recording: like `SlipSession`, with a delay. The result does not depend on the blocks."""

    def __init__(self, pads: tuple[str, ...], parameters: Records) -> None:
        """parameters: (1,) of `Parameters`."""
        self._detector = SlipSession(pads, parameters)
        self._numbers = {name: number for number, name in enumerate(pads)}
        self._pads = [_PadEvents() for _ in pads]
        self._first = self._given = 0  # number of the first scan held, and of scans given
        # Of the scans held: time, time of the pose (pads,), displacement and variance of the pose (pads, 3).
        self._t, self._pose_t = np.zeros(0), np.zeros((0, len(pads)))
        self._moved, self._variance = np.zeros((0, len(pads), 3)), np.zeros((0, len(pads), 3))
        self._statistic = np.zeros((0, len(pads)))  # of the detector

    @property
    def scatter(self) -> Floats:
        """(pads,), see `SlipSession.scatter`."""
        return self._detector.scatter

    def step(self, slips: Slips) -> Detected:
        """Slips of the next scans that are final, possibly none.

        `t_s` of a slip's event is the first scan that slips, or no longer slips.
        """
        _, events, statistic = self._detector.step(slips)
        new = (
            slips.t_s,
            slips.t_s[:, np.newaxis] - np.nan_to_num(slips.lag_s),
            np.where(slips.contact[..., np.newaxis], slips.displacement, np.nan),
            np.einsum("kpii,kp->kpi", slips.displacement_covariance, np.where(slips.lag_s > 0, 1.0, 0.5)),
        )
        held = (self._t, self._pose_t, self._moved, self._variance, self._statistic)
        whole = map(np.concatenate, zip(held, (*new, statistic), strict=True))
        self._t, self._pose_t, self._moved, self._variance, self._statistic = whole
        for event in events:
            scan = self._first + int(np.searchsorted(self._t, event.t_s))
            self._pads[self._numbers[event.pad]].pending.append((scan, event))
        return self._advance(last=False)

    def finish(self) -> Detected:
        """The scans and events that `step` has held back."""
        return self._advance(last=True)

    def _advance(self, *, last: bool) -> Detected:
        """Refine the events that are due, and give the scans that are final."""
        seen = self._first + len(self._t)
        due = seen if last else self._earlier(seen - 1, _SEARCH.ahead_scans)
        for number, pad in enumerate(self._pads):
            while pad.pending and pad.pending[0][0] < due:
                self._refine(number, pad)
        start, stop = self._given, max(seen if last else self._earlier(due, _SEARCH.back_scans), self._given)
        times, is_last = self._t[start - self._first : stop - self._first], stop - self._first >= len(self._t)
        slipping = np.zeros((len(times), len(self._pads)), dtype=np.bool_)
        found: list[tuple[int, int, Event]] = []
        for number, pad in enumerate(self._pads):
            done, began = 0, -1
            while pad.refined and len(times) and pad.refined[0].onset_s <= times[-1] + SAME_S:
                event = pad.refined[0]
                least = began + 1 if event.event == "slip_stop" else done  # a slip has a scan, however short it is
                scan = max(int(np.searchsorted(times, event.onset_s - SAME_S)), least)
                if scan == len(times) and not is_last:
                    break
                scan = min(scan, len(times) - 1)
                pad.refined.pop(0)
                slipping[done:scan, number], done = pad.slipping, scan
                found.append((scan, number, _at_scan(event, float(times[scan]))))
                pad.slipping = {"slip_start": True, "slip_stop": False}.get(event.event, pad.slipping)
                began = scan if event.event == "slip_start" else began
            slipping[done:, number] = pad.slipping
        statistic = self._statistic[start - self._first : stop - self._first].copy()
        self._given = stop
        self._drop_before(stop - _SEARCH.back_scans - _SEARCH.side_scans)
        return Detected(slipping, [event for _, _, event in sorted(found, key=lambda one: one[:2])], statistic)

    def _earlier(self, scan: int, scans: int) -> int:
        """The scan that is this many before another, or `_SEARCH.span_s`, whichever is longer; the first one held."""
        place = scan - self._first
        if not 0 <= place < len(self._t):
            return self._first
        in_time = int(np.searchsorted(self._t, self._t[place] - _SEARCH.span_s - SAME_S))
        return self._first + max(min(place - scans, in_time), 0)

    def _drop_before(self, scan: int) -> None:
        """Drop the scans held before this one."""
        old = max(scan - self._first, 0)
        self._first += old
        self._t, self._pose_t = self._t[old:], self._pose_t[old:]
        self._moved, self._variance = self._moved[old:], self._variance[old:]
        self._statistic = self._statistic[old:]

    def _refine(self, number: int, pad: _PadEvents) -> None:
        """Refine the oldest pending event of a pad, or drop it with the one that cancels it.

        A slip that was over before it was reported is one of the jump test: it has no path to be refined by.
        """
        scan, event = pad.pending.pop(0)
        near = self._t[scan - self._first] + _SEARCH.span_s
        following = [other for k, other in pad.pending if k <= scan + _SEARCH.ahead_scans or other.t_s <= near][:1]
        later = [(k, other) for k, other in pad.pending if k <= scan + _SEARCH.ahead_scans]
        if event.event in ("contact", "release"):
            pad.refined.append(replace(event, onset_s=event.t_s))
            pad.last_s = event.t_s
            return
        withdrawn = event.event == "slip_stop" and following and following[0].onset_s < event.onset_s
        if withdrawn or (event.event == "slip_start" and later and self._returns(number, scan, event, later[0][1])):
            pad.pending.pop(0)
            return
        next_s = later[0][1].onset_s if later else np.inf
        starts = event.event == "slip_start"
        jumped = next_s < event.t_s if starts else pad.jumped
        pad.jumped = starts and jumped
        keep = jumped or np.isnan(event.speed_m_s)
        onset_s = event.onset_s if keep else self._change_point(number, scan, event, pad.last_s, next_s)
        earliest = self._t[self._earlier(scan, _SEARCH.back_scans) - self._first]
        pad.last_s = float(max(onset_s, earliest, pad.last_s))
        pad.refined.append(replace(event, onset_s=pad.last_s))

    def _returns(self, number: int, scan: int, start: Event, end: Event) -> bool:
        """Whether a short slip, reported at a scan, ended where it started."""
        if np.isnan(start.speed_m_s) or np.isnan(end.speed_m_s):
            return False
        t, first = self._pose_t[:, number], self._first
        low = self._earlier(scan, _SEARCH.back_scans) - first
        begin, stop = (int(np.searchsorted(t, one.onset_s, side="right")) for one in (start, end))
        last = min(scan + _SEARCH.ahead_scans + 1 - first, len(t))
        moved, variance = self._moved[:, number], self._variance[:, number]
        before, after = slice(max(begin - _SEARCH.side_scans, low), begin), slice(stop, last)
        if (
            begin - before.start < _SEARCH.least_side_scans
            or last - stop < _SEARCH.least_side_scans
            or np.isnan(moved[before.start + 1 : last, :2]).any()
        ):
            return False
        path = np.cumsum(np.where(np.arange(last)[:, np.newaxis] > before.start, moved[:last], 0.0), axis=0)
        distance = path[after].mean(axis=0) - path[before].mean(axis=0)
        noise = sum(variance[side].mean(axis=0) / len(path[side]) for side in (before, after))
        known = np.isfinite(distance) & np.isfinite(noise)
        return bool((np.abs(distance[known]) < _RETURN_SIGMAS * np.sqrt(noise[known])).all())

    def _change_point(self, number: int, scan: int, event: Event, since_s: float, until_s: float) -> float:
        """Time of an event that was reported at a scan, s, by the path between the events before and after it."""
        start = self._earlier(scan, _SEARCH.back_scans) - self._first
        stop = scan + _SEARCH.ahead_scans + 1 - self._first
        t, moved = self._pose_t[start:stop, number], self._moved[start:stop, number]
        near = int(np.searchsorted(t, event.onset_s))
        broken = np.flatnonzero(np.isnan(moved[:, 0]))
        low = max(near - _SEARCH.side_scans, int(np.searchsorted(t, since_s)), *broken[broken <= near].tolist(), 0)
        high = min(near + _SEARCH.side_scans, int(np.searchsorted(t, until_s)), *broken[broken > near].tolist(), len(t))
        if near - low < _SEARCH.least_side_scans or high - near < _SEARCH.least_side_scans:
            return event.onset_s
        here = slice(low, high)
        path = np.cumsum(np.where(np.arange(high - low)[:, np.newaxis] > 0, moved[here], 0.0), axis=0)
        weight = 1.0 / np.maximum(self._variance[start:stop, number][here], LEAST_STD.m**2)
        known = np.isfinite(path).all(axis=0) & np.isfinite(weight).all(axis=0)
        side = 1 if event.event == "slip_start" else -1
        return _fit_change_point(t[here], path[:, known], weight[:, known], event.onset_s, side)


def _fit_change_point(t: Floats, path: Floats, weight: Floats, near_s: float, side: int) -> float:
    """Time, s, at which a path (scans, axes) changes between rest and a constant velocity, by weighted least squares.

    side: 1 if it moves after the change, -1 if before. At each time of the grid the fit of rest position and velocity
    has a closed form; the best time explains most of the weighted squares. `near_s` if nothing is explained.
    """
    scan_s = float(np.median(np.diff(t)))
    grid = near_s + scan_s * np.arange(
        -_SEARCH.scans, _SEARCH.scans + 0.5 / _SEARCH.steps_per_scan, 1.0 / _SEARCH.steps_per_scan
    )
    grid = grid[(grid >= t[0]) & (grid <= t[-1])]
    ramp = np.maximum(side * (t - grid[:, np.newaxis]), 0.0)
    total = weight.sum(axis=0)
    mean = ramp @ weight / total
    cross = ramp @ (weight * path) - mean * (weight * path).sum(axis=0)
    square = ramp**2 @ weight - mean**2 * total
    explained = (cross**2 / np.where(square > 0, square, np.inf)).sum(axis=1)
    if not len(grid) or not explained.max() > 0:
        return near_s
    alike = explained >= (1 - ROUNDING) * explained.max()  # a path in whole pitches has many
    return float(grid[np.argmax(alike)])


def _at_scan(event: Event, t_s: float) -> Event:
    """The event at its first scan; contact and release have no onset of their own."""
    if event.event in ("contact", "release"):
        return Event(t_s, event.pad, event.event)
    return replace(event, t_s=t_s)
