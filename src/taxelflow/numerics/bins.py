"""Scans averaged over bins of 0.1 s, whose patterns are compared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.clock import SAME_S

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats, Scans

BIN_S = 0.1
"""Duration of a bin. The slowest of the soft skins scan ten times a second."""
AHEAD_BINS = 20
"""Bins that a recording knows beyond what it judges: three slips long."""
AHEAD_S = AHEAD_BINS * BIN_S
_LONGEST_S = 0.25
"""A longer time between two scans is a gap. Sensors that scan that slowly complete no bins."""


@dataclass(slots=True, eq=False)
class Bin:
    """Sum of scans. touching, whole: (pads,), contact and no missing taxel in all of them. clipped: (entries,), at the
    end of its range in any of them. noise: (entries,), standard deviation of one reading.
    """

    since_s: float
    until_s: float
    pressure: Floats
    clipped: Bools
    touching: Bools
    whole: Bools
    shear: Floats | None
    noise: Floats
    scans: int = 1


class Binning:
    """Adds scans up to bins; the result does not depend on how the scans are cut into blocks."""

    def __init__(self) -> None:
        self._open: Bin | None = None
        self._last_s = -np.inf
        self.after_gap = False
        """Whether a gap came before the scan that was added last; the bin that was open then is given up."""

    def add(self, scans: Scans, scan: int) -> Bin | None:
        """The bin that a scan completes, if it does."""
        t_s = float(scans.t_s[scan])
        step_s, self._last_s = t_s - self._last_s, t_s
        self.after_gap = step_s > _LONGEST_S
        if self.after_gap:
            self._open = None
        pressure, touching, whole = scans.pressure[scan], scans.contact[scan], scans.complete[scan]
        shear, clipped = None if scans.shear is None else scans.shear[scan], pressure >= scans.ceiling
        if self._open is None:
            shear = None if shear is None else shear.copy()
            self._open = Bin(t_s, t_s, pressure.copy(), clipped, touching, whole, shear, scans.noise)
        else:
            self._open.pressure += pressure
            self._open.clipped |= clipped
            if self._open.shear is not None and shear is not None:
                self._open.shear += shear
            self._open.touching = self._open.touching & touching
            self._open.whole = self._open.whole & whole
            self._open.scans, self._open.until_s = self._open.scans + 1, t_s
        if t_s - self._open.since_s + 1.5 * min(step_s, _LONGEST_S) < BIN_S - SAME_S:
            return None
        found, self._open = self._open, None
        return found
