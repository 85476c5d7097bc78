"""Which pads are restless: their contacts' patterns change while the object rests, more than noise and creep explain.

On such a skin a pose moves although the object does not, and its covariance does not hold it. There the evidence
of the patterns decides what is a slip; elsewhere the pose does. An object is taken to rest where the pose has it rest,
or has had it slip for longer than objects do in a hand while rest explains the patterns, those of the last 0.3 s, and
clearly better than a slide those since the slip began: poses may drift on. In 0.3 s alone a smooth object that slides
slowly changes no more than one at rest.

Where the pose has it rest, the change of the pattern with its load is learned, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import Bools, Floats
from taxelflow.numerics.bins import BIN_S
from taxelflow.slip.evidence import CHANGE, REST_S, first_growths
from taxelflow.slip.pattern_change import STEADY_RISE

if TYPE_CHECKING:
    from taxelflow.slip.pattern_change import PatternChanges

RESTLESS_SHARE = 0.25
"""Share of stirred bins at rest above which a pad is restless. Noise alone stirs 0.4 % of them."""


@dataclass(frozen=True, slots=True)
class _Stirred:
    """Bins at rest that are stirred."""

    prior: float = 4.0
    """Bins that were not stirred, in advance: two stirred ones are no accident, one may be."""
    memory: float = 1000.0
    """Bins at rest that are remembered, 100 s: restlessness is a property of skin and arm, not of a contact."""


_STIRRED = _Stirred()
_LONG_BINS = REST_S / BIN_S
"""A slip by the pose that lasts longer than objects rest is in doubt."""


class RestlessPads:
    """Counts bins at rest: those without a slip by the pose until one bin after them, and doubtful ones."""

    def __init__(self, pads: int, window_bins: int) -> None:
        """window_bins: bins in which a pattern is compared."""
        self._needed = window_bins + 1
        self._stirred, self._rest = np.zeros(pads), np.zeros(pads)
        self._calm, self._slipped = np.zeros(pads, dtype=np.int64), np.zeros(pads, dtype=np.int64)
        self._last = np.full(pads, np.nan)
        self._growths = [first_growths() for _ in range(pads)]
        self._growth = np.full(pads, CHANGE.growth)

    @property
    def growth(self) -> Floats:
        """(pads,), see `log_likelihood_ratio`."""
        return self._growth.copy()

    @property
    def restless(self) -> Bools:
        """(pads,)."""
        found: Bools = self._stirred > RESTLESS_SHARE * (self._rest + _STIRRED.prior)
        return found

    def update(self, slipped: Bools, changes: PatternChanges, scan: int, log_ratio: Floats, rests: Bools) -> None:
        """One more bin, that of a scan. slipped: (pads,), by the pose in any scan of it. log_ratio: (pads,).

        rests: (pads,), see `Consent`.
        """
        self._calm = np.where(slipped, 0, self._calm + 1)
        self._slipped = np.where(slipped, self._slipped + 1, 0)
        calm = self._calm > self._needed
        counts = (calm | ((self._slipped > _LONG_BINS) & (log_ratio < 0) & rests)) & ~np.isnan(self._last)
        forget = np.where(counts & (self._rest >= _STIRRED.memory), 1 - 1 / _STIRRED.memory, 1.0)
        self._rest = forget * self._rest + counts
        self._stirred = forget * self._stirred + np.where(counts, np.nan_to_num(self._last), 0.0)
        self._last = changes.stirred[scan]
        for pad in np.flatnonzero(calm & (np.abs(changes.rise[scan]) > STEADY_RISE)).tolist():
            grown = changes.unexplained[scan, pad] - changes.noise[scan, pad] - CHANGE.at_rest**2
            self._growths[pad].append(float(np.sqrt(max(grown, 0.0)) / abs(changes.rise[scan, pad])))
            self._growth[pad] = np.median(self._growths[pad])
