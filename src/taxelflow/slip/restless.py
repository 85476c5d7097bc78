"""Which pads are restless: their contacts' patterns change while the object rests, more than noise and creep explain.

On such a skin a pose moves although the object does not, and its covariance does not hold it. There the evidence
of the patterns decides what is a slip; elsewhere the pose does. An object is taken to rest where the pose has it rest,
or has had it slip for longer than objects do in a hand while rest explains the patterns, those of the last 0.3 s, and
clearly better than a slide those since the slip began: poses may drift on. In 0.3 s alone a smooth object that slides
slowly changes no more than one at rest.

Where the pose has it rest, the change of the pattern with its load is learned, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.messages import Bools, Floats
from taxelflow.numerics.bins import BIN_S
from taxelflow.numerics.records import Records, records
from taxelflow.runtime.compiling import kernel
from taxelflow.slip.evidence import CHANGE, REST_S, first_growths
from taxelflow.slip.unexplained import STEADY_RISE

if TYPE_CHECKING:
    from taxelflow.slip.pattern_change import PatternChanges

RESTLESS_SHARE = 0.25
"""Share of stirred bins at rest above which a pad is restless. Noise alone stirs 0.4 % of them."""


class _Stirred(NamedTuple):
    """Bins at rest that are stirred."""

    prior: float = 4.0
    """Bins that were not stirred, in advance: two stirred ones are no accident, one may be."""
    memory: float = 1000.0
    """Bins at rest that are remembered, 100 s: restlessness is a property of skin and arm, not of a contact."""


_STIRRED = _Stirred()
_LONG_BINS = REST_S / BIN_S
"""A slip by the pose that lasts longer than objects rest is in doubt."""


class _Watched:
    """Of a pad: bins at rest and those of them that were stirred, with less weight the older they are; whether the last
    one was, NaN if unknown; the latest bins without and with a slip by the pose.
    """

    rest: float
    stirred: float
    last: float
    calm: int
    slipped: int


class RestlessPads:
    """Counts bins at rest: those without a slip by the pose until one bin after them, and doubtful ones."""

    def __init__(self, pads: int, window_bins: int) -> None:
        """window_bins: bins in which a pattern is compared."""
        self._needed = window_bins + 1
        self._watched = records(_Watched, pads)
        self._watched["last"] = np.nan
        self._growths = [first_growths() for _ in range(pads)]
        self._growth = np.full(pads, CHANGE.growth)

    @property
    def growth(self) -> Floats:
        """(pads,), see `log_likelihood_ratio`."""
        return self._growth.copy()

    @property
    def restless(self) -> Bools:
        """(pads,)."""
        found: Bools = self._watched["stirred"] > RESTLESS_SHARE * (self._watched["rest"] + _STIRRED.prior)
        return found

    def update(self, slipped: Bools, changes: PatternChanges, scan: int, log_ratio: Floats, rests: Bools) -> None:
        """One more bin, that of a scan. slipped: (pads,), by the pose in any scan of it. log_ratio: (pads,).

        rests: (pads,), see `Consent`.
        """
        _count(slipped, changes.stirred[scan], log_ratio, rests, self._needed, self._watched)
        changing = np.abs(changes.rise[scan]) > STEADY_RISE
        for pad in np.flatnonzero(changing & (self._watched["calm"] > self._needed)).tolist():
            grown = changes.unexplained[scan, pad] - changes.noise[scan, pad] - CHANGE.at_rest**2
            self._growths[pad].append(float(np.sqrt(max(grown, 0.0)) / abs(changes.rise[scan, pad])))
            self._growth[pad] = np.median(self._growths[pad])


@kernel
def _count(slipped: Bools, stirred: Floats, log_ratio: Floats, rests: Bools, needed: int, watched: Records) -> None:
    """One more bin, (pads,) each. needed: bins without a slip by the pose after which the next one is at rest."""
    for pad in range(len(watched)):
        w: _Watched = watched[pad]
        w.calm = 0 if slipped[pad] else w.calm + 1
        w.slipped = w.slipped + 1 if slipped[pad] else 0
        doubtful = w.slipped > _LONG_BINS and log_ratio[pad] < 0.0 and rests[pad]
        if (w.calm > needed or doubtful) and not np.isnan(w.last):
            keep = 1.0 - 1.0 / _STIRRED.memory if w.rest >= _STIRRED.memory else 1.0
            w.rest, w.stirred = keep * w.rest + 1.0, keep * w.stirred + w.last
        w.last = stirred[pad]
