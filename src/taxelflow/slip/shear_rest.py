"""What the spread of the change of shear is at rest, learned per pad where the pattern speaks for rest.

Shear and pressure of a sensor have scales of their own, and a skin spreads shear in its own way: only rest shows them.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.slip.evidence import CHANGE, first_growths
from taxelflow.slip.unexplained import STEADY_RISE

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.slip.pattern_change import PatternChanges


@dataclass(frozen=True, slots=True)
class _Usual:
    """Spread of the change of shear at rest."""

    spread: float = 0.01
    """Of a pad that is not known yet: the median of ten recordings of one sensor."""
    bins: int = 100
    prior_bins: int = 10
    """Bins at rest whose median it is, and how many have the usual value at first."""


_USUAL = _Usual()


class ShearRest:
    """Medians of bins that the pattern takes for rest: at a steady load the spread, at a changing one its growth."""

    def __init__(self, pads: int) -> None:
        self._spreads = [deque([_USUAL.spread] * _USUAL.prior_bins, maxlen=_USUAL.bins) for _ in range(pads)]
        self._growths = [first_growths() for _ in range(pads)]
        self.spread, self.growth = np.full(pads, _USUAL.spread), np.full(pads, CHANGE.growth)

    def update(self, changes: PatternChanges, scan: int, log_ratio: Floats) -> None:
        """One more bin, that of a scan. log_ratio: (pads,), by the pattern alone."""
        power = np.maximum(changes.spread[scan] - changes.spread_noise[scan], 0.0)
        rise = np.abs(changes.rise[scan])
        for pad in np.flatnonzero((log_ratio < 0) & np.isfinite(power)).tolist():
            if rise[pad] < STEADY_RISE:
                self._spreads[pad].append(float(np.sqrt(power[pad])))
                self.spread[pad] = np.median(self._spreads[pad])
            else:
                grown = max(float(power[pad] - self.spread[pad] ** 2), 0.0)
                self._growths[pad].append(float(np.sqrt(grown) / rise[pad]))
                self.growth[pad] = np.median(self._growths[pad])
