"""When a slip begins that the odds decide, in a recording: with the slip of its pose, if that begins at once.

Patterns are averaged over bins, so that the odds of a slip rise up to 0.3 s before it begins. A pose of quality `ok`
dates its slip to a scan.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.bins import BIN_S
from taxelflow.slip.pattern_change import BINS

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats
    from taxelflow.slip.odds import Odds

_EARLY_S = (BINS.before + 1) * BIN_S
"""Time by which bins blur the begin of a slip."""


class Begun:
    """Follows the slips by the odds of all pads."""

    def __init__(self, pads: int) -> None:
        self._slips = np.zeros(pads, dtype=np.bool_)
        self._since_s = np.full(pads, -np.inf)

    def step(self, odds: Odds, posed: Bools, t_s: Floats) -> Floats:
        """(scans, pads), the log odds, even at best before the pose's slip begins.

        posed: (scans or more, pads), slipping by a pose that is `ok`, of later scans, too. t_s: (scans or more,).
        """
        slips = odds.restless & (odds.log_odds > 0.0)
        if not slips.any():
            self._slips = np.zeros_like(self._slips)
            return odds.log_odds
        log_odds = odds.log_odds.copy()
        for scan, now in enumerate(slips):
            for pad in np.flatnonzero(now & ~self._slips):
                end = int(np.searchsorted(t_s[: len(posed)], t_s[scan] + _EARLY_S, side="right"))
                soon = np.flatnonzero(posed[scan:end, pad])
                self._since_s[pad] = t_s[scan + soon[0]] if len(soon) else -np.inf
            self._slips = now
            early = now & (t_s[scan] < self._since_s)
            log_odds[scan, early] = 0.0
        return log_odds
