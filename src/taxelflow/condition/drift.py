"""Following the offset drift of idle pads, without following a contact.

The offset of a pad is updated only after a block of scans in which it was idle: the pad is tared, has not been in
contact, no reading was missing, no time lost, no taxel changed suddenly, and the total drift, that block included, has
no spatial structure by the test of the tare (`tare.py`). A contact, however light or slow, has one, unless it covers
the whole pad evenly; and a pad in contact keeps its offset for as long as the contact lasts. What can be followed is
about one standard deviation of noise in 250 scans.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.condition.tare import is_unstructured

if TYPE_CHECKING:
    from taxelflow.condition.baseline import Baseline
    from taxelflow.messages import Bools, Floats, Scans
    from taxelflow.sensors.layout import Layout


@dataclass(frozen=True, slots=True)
class _Block:
    """A block of idle scans."""

    scans: int = 64
    """Scans of a block: the standard deviation of its mean is an eighth of that of a reading."""
    share: float = 0.5
    """Share of a block's mean that is added to the offset: the noise left in the mean hardly moves it."""
    most_sigmas: float = 8.0
    """A block in which some taxel's mean differs from 0 by more standard deviations of the mean changed too
    suddenly."""


BLOCK = _Block()


class DriftTracker:
    """Collects blocks of tared readings, at most BLOCK.scans long, and updates the offsets of idle pads."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._block = np.zeros((BLOCK.scans, layout.taxels))
        self._scans = 0
        self._idle = np.ones(layout.pad_count, dtype=np.bool_)
        self._tare: Floats | None = None
        taxels = np.zeros((len(layout.pads), layout.taxels), dtype=np.bool_)
        for pad, own in enumerate(taxels):
            own[layout.source[layout.of_pad(pad)]] = True
        self._overlap = (taxels[: layout.pad_count].astype(int) @ taxels.T) > 0  # (pads, pads and groups), share taxels

    @property
    def remaining(self) -> int:
        """Scans until the block is full."""
        return BLOCK.scans - self._scans

    def restart(self, baseline: Baseline) -> None:
        """Follow new offsets from here on: drift counts from them."""
        self._tare, self._scans = baseline.offset, 0
        self._idle[:] = True

    def update(self, scans: Scans, gap: Bools, baseline: Baseline) -> Baseline:
        """Take at most `remaining` scans. Returns the baseline, with new offsets if a block has ended idle."""
        if self._tare is None:
            self._tare = baseline.offset
        self._block[self._scans : self._scans + len(scans)] = scans.pressure[:, : self._layout.taxels]
        self._scans += len(scans)
        quiet = ~scans.contact & scans.complete & ~gap[:, np.newaxis]
        self._idle &= (quiet.all(axis=0) | ~self._overlap).all(axis=1)
        if self.remaining:
            return baseline
        offset = baseline.offset.copy()
        for pad in np.flatnonzero(self._idle & baseline.tared):
            offset[self._layout.of_pad(int(pad))] += self._drift_of(int(pad), baseline, self._tare)
        self._scans = 0
        self._idle[:] = True
        return baseline if np.array_equal(offset, baseline.offset) else replace(baseline, offset=offset)

    def _drift_of(self, pad: int, baseline: Baseline, tare: Floats) -> Floats:
        """(taxels of the pad,), what to add to its offset after an idle block: 0 if it may be a contact."""
        own = self._layout.of_pad(pad)
        live = ~baseline.masked[own]
        mean = self._block[:, own].mean(axis=0)
        mean_std = baseline.noise[own] / BLOCK.scans**0.5
        total = baseline.offset[own] + mean - tare[own]
        if (
            not live.any()
            or (np.abs(mean) > BLOCK.most_sigmas * mean_std)[live].any()
            or not is_unstructured(total, ~live, self._layout.neighbours(pad), float(mean_std.max()))
        ):
            return np.zeros(len(live))
        return np.where(live, BLOCK.share * mean, 0.0)
