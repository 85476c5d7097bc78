"""A slip by the pose that waits for its pattern's consent, see `shifting_load`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import Floats
from taxelflow.numerics.bins import BIN_S
from taxelflow.numerics.robust import CLEARLY
from taxelflow.slip.evidence import CHANGE, log_likelihood_ratio

if TYPE_CHECKING:
    from taxelflow.numerics.rest_or_slide import Unexplained

WINDOW_S = 3 * BIN_S
"""From the first scan of a bin to the end of those after it."""


@dataclass(slots=True, eq=False)
class Pattern:
    """Mean of some scans of a pad: time of the last, pressure (taxels,), scans, and path of the pose (2,), m."""

    until_s: float
    pressure: Floats
    scans: int
    path_m: Floats


@dataclass(slots=True, eq=False)
class Claim:
    """A slip by the pose. still: whether the contact was still before. before: the pattern that its interval begins
    with; None if there was none. rested_s: end of the last bin that rest explained clearly better. compared: whether
    bins were. scans_s: from and up to when single scans may be. shown: a slide explained the change clearly better.
    since_s: since when the pattern consents; inf if it does not. rests: whether rest explains the change clearly
    better, since the slip began or it last did.
    """

    onset_s: float
    still: bool
    before: Pattern | None = None
    rested_s: float = -np.inf
    compared: bool = False
    scans_s: tuple[float, float] = (np.inf, -np.inf)
    since_s: float = np.inf
    shown: bool = False
    rests: bool = False

    def show(self) -> None:
        """The object has slid, or has come further than its pattern can be compared."""
        self.shown, self.since_s, self.rests = True, min(self.since_s, self.rested_s), False

    def judge(self, now: Pattern, left: Unexplained, noise: float, *, covers: bool, is_bin: bool) -> None:
        """Take in what rest and a slide leave of a pattern.

        noise: standard deviation of its difference to the one before. covers: whether all taxels are loaded in both.
        is_bin: a mean of a bin, by which the object may rest, too.
        """
        if left.slides():
            self.show()
            return
        rests = left.rests()
        decides = self.still and not rests and not (is_bin and self.compared)
        if decides and self._has_steady_load(now) and left.shifts(noise):
            self.since_s = min(self.since_s, self.rested_s)
        if not is_bin:
            return
        if self.since_s == np.inf and covers and self._is_odd(now, left.rest, noise):
            self.since_s = self.rested_s
        self.compared, self.rests = True, rests
        if rests:
            self.before, self.rested_s = now, now.until_s

    def _has_steady_load(self, now: Pattern) -> bool:
        """Whether the load has not clearly changed."""
        loads = (self.before or now).pressure.sum(), now.pressure.sum()
        return bool(max(loads) <= CLEARLY * min(loads))

    def _is_odd(self, now: Pattern, rest: float, noise: float) -> bool:
        """Whether the squares that rest leaves of a pattern are rather those of a slip."""
        before = self.before or now
        power = float(now.pressure @ now.pressure)
        usual = CHANGE.at_rest * ((now.until_s - before.until_s) / WINDOW_S) ** CHANGE.exponent
        rise = np.log(now.pressure.sum() / before.pressure.sum())
        share, noise_power = np.array([rest, len(now.pressure) * noise**2]) / power
        return bool(log_likelihood_ratio(share, noise_power, rise, np.array(CHANGE.growth), usual) > 0.0)
