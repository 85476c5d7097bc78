"""One increasing clock from a device's stamps, across restarts and jumps of the device; and its drift.

The stamps stay as they are while they increase. A scan with the stamp of the one before, or a little older, is dropped.
Where a clock jumps back (the device has started again), time goes on from the last scan by the computer's clock, and at
least so far that conditioning finds a gap: no motion is followed across the jump.
"""

from __future__ import annotations

import math
import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.acquire.columns import epoch_units
from taxelflow.acquire.devices.time_unit import TimeUnit, unit_remedy
from taxelflow.numerics.clock import FARTHEST_S

if TYPE_CHECKING:
    from taxelflow.acquire.devices.base import Arrival, Faults


@dataclass(frozen=True, slots=True)
class _Clock:
    """When a stamp is late, ahead, or after a gap."""

    late_s: float = 1.0
    """A stamp that is up to this much older than the last one is a late scan; one that is older still, a clock set
    back."""
    most_late: int = 8
    """After this many late scans in a row the clock was set back a little."""
    jump_s: float = 1.0
    """A stamp is ahead if it has advanced by so much more than the computer's clock;"""
    jump_ratio: float = 20.0
    """... and by this many times as much: a recording may be replayed faster."""
    alike_ratio: float = 2.0
    """A step of at most this many usual ones is no jump, however soon the scan comes."""
    gap_ratio: float = 3.0
    """A step longer than this many usual ones, the median of the last ones, is a gap."""
    set_back_ratio: float = 4.0
    """A scan after a clock set back follows by this many usual steps, and so after a gap."""
    unknown_s: float = 1.0
    """That step, if none is known yet."""
    steps: int = 15
    """As many as conditioning takes the median of."""
    window_s: float = 1.0
    most_windows: int = 600


_CLOCK = _Clock()


class Timeline:
    """Puts arrivals in order. paced: whether scans arrive when the device made them; a replay's may come at any pace,
    so that the computer's clock proves nothing about their times.
    """

    def __init__(self, faults: Faults, *, paced: bool = True) -> None:
        self._faults, self._paced = faults, paced
        self._offset_s, self._former_offset_s = 0.0, math.nan
        self._last_s = -math.inf
        self._last_arrived_s = math.nan
        self._late = 0
        self._epoch_s = time.time() - time.monotonic()
        self._steps_s: deque[float] = deque(maxlen=_CLOCK.steps)
        self.dropped = self.gaps = 0
        self.skew = Skew()
        self._unit = TimeUnit()

    @property
    def usual_s(self) -> float:
        """Median of the last steps from scan to scan; NaN if there are too few."""
        steps = sorted(self._steps_s)
        return steps[len(steps) // 2] if len(steps) >= 3 else math.nan

    @property
    def jitter_s(self) -> float:
        """Standard deviation of the last steps; NaN if there are too few."""
        return float(np.std(list(self._steps_s))) if len(self._steps_s) >= 3 else math.nan

    @property
    def notes(self) -> list[str]:
        """Remarks to the user on the times."""
        return [self._unit.doubt] if self._unit.doubt else []

    @property
    def offset_s(self) -> float:
        """By how much the computer's clock (since 1970) is ahead of the device's, with the least delay; NaN early."""
        return self.skew.least_s + self._epoch_s

    def place(self, arrival: Arrival) -> float | None:
        """Time of a scan in s, later than that of all before it; None if the scan is to be dropped."""
        if arrival.t_s is None:
            t_s = arrival.arrived_s + self._epoch_s
            if t_s <= self._last_s:  # several in one piece of bytes
                t_s = math.nextafter(self._last_s, math.inf) if math.isfinite(self._last_s) else t_s
        else:
            found = self._of_device(arrival.t_s, arrival.arrived_s)
            if found is None:
                self.dropped += 1
                return None
            t_s = found
        if math.isfinite(self._last_s):
            self.gaps += t_s - self._last_s > _CLOCK.gap_ratio * self.usual_s
            self._steps_s.append(t_s - self._last_s)
        self._last_s, self._last_arrived_s = t_s, arrival.arrived_s
        return t_s

    def _of_device(self, stamp_s: float, arrived_s: float) -> float | None:
        if not abs(stamp_s) <= FARTHEST_S:  # one such stamp would leave no room for those that follow
            units = epoch_units(stamp_s)
            likely = f": the times are likely in {units[0]} ({unit_remedy(units[0])})" if units else ""
            self._faults.count("time out of range", f"{stamp_s:.6g} s; that scan is dropped{likely}")
            return None
        t_s = stamp_s + self._offset_s
        if not math.isfinite(self._last_s):
            self.skew.add(t_s, arrived_s)
            return t_s
        step_s, passed_s = t_s - self._last_s, arrived_s - self._last_arrived_s
        if step_s == 0.0:
            self._faults.count("scan repeated", f"a second one at {stamp_s:.6f} s is dropped")
            return None
        if -_CLOCK.late_s <= step_s < 0.0 and self._late < _CLOCK.most_late:
            self._late += 1
            self._faults.count("scan late", f"{stamp_s:.6f} s comes {-step_s:.3g} s too late and is dropped")
            return None
        self._late = 0
        if self._paced and self._unit.add(step_s, passed_s):
            self._faults.count("time unit doubted", self._unit.doubt)
        ahead = self._paced and step_s > passed_s + _CLOCK.jump_s and step_s > _CLOCK.jump_ratio * passed_s
        if step_s < 0.0 or (ahead and not step_s <= _CLOCK.alike_ratio * self.usual_s):
            return self._after_jump(stamp_s, step_s, passed_s)
        self.skew.add(t_s, arrived_s)
        return t_s

    def _after_jump(self, stamp_s: float, step_s: float, passed_s: float) -> float | None:
        """Time of a scan before which the device's clock has jumped; None if the scan is late."""
        step_back_s = _CLOCK.unknown_s if math.isnan(self.usual_s) else _CLOCK.set_back_ratio * self.usual_s
        again_s = stamp_s + self._former_offset_s
        if -step_back_s <= again_s - self._last_s < passed_s + _CLOCK.jump_s:  # one stamp was wrong: as before
            self._offset_s, self._former_offset_s = self._former_offset_s, self._offset_s
            if again_s > self._last_s:
                return again_s
            self._late = 1
            self._faults.count("scan late", f"{stamp_s:.6f} s comes after a wrong time and is dropped")
            return None
        self.skew.restart()
        back = step_s < 0.0
        gap = back or step_s > _CLOCK.gap_ratio * self.usual_s
        marked = "; a gap is marked" if gap else ""
        self._faults.count("clock jumped", f"by {step_s:+.3f} s at {stamp_s:.6f} s{marked}")
        if back:
            self._former_offset_s = self._offset_s
            self._offset_s = self._last_s + max(passed_s, step_back_s) - stamp_s
            self.gaps += math.isnan(self.usual_s)  # else `place` counts it
        return stamp_s + self._offset_s


class Skew:
    """Offset and drift of a device's clock against the computer's, from the least delay of each second.

    The least delay of many arrivals is that of a scan that waited nowhere; a line through these is the clock's.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget the clock: it was set again."""
        self._least: deque[tuple[float, float]] = deque(maxlen=_CLOCK.most_windows)
        self._until_s = -math.inf
        self._best = (0.0, math.inf)

    def add(self, t_s: float, arrived_s: float) -> None:
        """One scan, by both clocks."""
        if arrived_s >= self._until_s:
            if math.isfinite(self._best[1]):
                self._least.append(self._best)
            self._best, self._until_s = (0.0, math.inf), arrived_s + _CLOCK.window_s
        if arrived_s - t_s < self._best[1]:
            self._best = arrived_s, arrived_s - t_s

    @property
    def least_s(self) -> float:
        """Least time from a stamp to its arrival on the monotonic clock, in the last second; NaN in the first one."""
        return self._least[-1][1] if self._least else math.nan

    @property
    def drift_ppm(self) -> float:
        """By how much the device's clock is slow, in parts per million; NaN before 10 s have been seen."""
        if len(self._least) < 10:
            return math.nan
        when, delay = np.array(self._least).T
        slope, _ = np.polyfit(when - when.mean(), delay, 1)
        return 1e6 * float(slope)
