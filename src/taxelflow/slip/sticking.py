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

    def __init__(self, pads: int) -> None:
        self._sticks, self._witnessed = np.ones(pads, dtype=np.bool_), np.zeros(pads, dtype=np.bool_)

    def see(self, spread: Floats) -> None:
        """Changes of shear of scans that are judged next, see `shear_change`. spread: (scans, pads); NaN if none."""
        self._witnessed |= np.isfinite(spread).any(axis=0)

    def step(self, contact: Bools, slipping: Bools, log_odds: Floats) -> Bools:
        """(scans, pads), whether an object sticks.

        slipping: (scans, pads). log_odds: (scans, pads), of a slip; NaN where unknown.
        """
        sticks = np.empty_like(contact)
        shown = slipping | (log_odds > AGAINST)
        for scan, touching in enumerate(contact):
            self._sticks = ~touching | (self._sticks & ~shown[scan])
            sticks[scan] = self._sticks
        return sticks & contact & np.isfinite(log_odds) & self._witnessed
