"""Objects that have not slipped since they were touched: pattern and shear have spoken against a slip all the time.

Only on pads that measure shear: where the pattern does not show a motion, it is the second witness.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.slip.odds import AGAINST

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats


class Sticking:
    """Follows the contacts of all pads."""

    def __init__(self, pads: int, ahead_s: float = 0.0) -> None:
        """ahead_s: how far ahead of a scan that is judged others may have been seen. Half of it counts: that much has
        been seen whatever the blocks.
        """
        self._sticks, self._ahead_s = np.ones(pads, dtype=np.bool_), 0.5 * ahead_s
        self._witnessed_s = np.full(pads, np.inf)
        """Since when shear has changed."""

    def see(self, t_s: Floats, spread: Floats) -> None:
        """Changes of shear of scans that are judged next, see `shear_change`. spread: (scans, pads); NaN if none."""
        times = np.where(np.isfinite(spread), t_s[:, np.newaxis], np.inf)
        self._witnessed_s = np.minimum(self._witnessed_s, times.min(axis=0, initial=np.inf))

    def step(self, t_s: Floats, contact: Bools, slipping: Bools, log_odds: Floats) -> Bools:
        """(scans, pads), whether an object sticks.

        slipping: (scans, pads). log_odds: (scans, pads), of a slip; NaN where unknown.
        """
        sticks = np.empty_like(contact)
        shown = slipping | (log_odds > AGAINST)
        for scan, touching in enumerate(contact):
            self._sticks = ~touching | (self._sticks & ~shown[scan])
            sticks[scan] = self._sticks
        return sticks & contact & np.isfinite(log_odds) & (self._witnessed_s <= t_s[:, np.newaxis] + self._ahead_s)
