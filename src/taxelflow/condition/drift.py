"""The offset of idle pads as it creeps, followed without ever following a contact.

A pad may drift only while it is surely idle: it was tared once, it has not been in contact for a whole spell of scans,
no reading was missing and no time lost, nothing came suddenly, and what the offset has drifted by in all, that spell
included, has no shape, as the tare demands (`tare.py`). A contact, however light or slow, has one, unless it covers the
whole pad evenly; and a pad in contact keeps its offset for as long as the contact lasts. What can be followed is about
a standard deviation of noise in 250 scans.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.condition.tare import shapeless

if TYPE_CHECKING:
    from taxelflow.condition.learn import Learned
    from taxelflow.messages import Bools, Floats, Scans
    from taxelflow.sensors.layout import Layout

SPELL_SCANS = 64
_SHARE = 0.5
"""Of a spell's mean that the offset takes up: what noise leaves in the mean hardly moves it."""
_SUDDEN = 8.0
"""A spell in which some taxel's mean is off by more than so many of its standard deviations came too suddenly."""


class Drift:
    """Collects spells of tared readings, at most SPELL_SCANS long, and says what the offsets become."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._spell = np.zeros((SPELL_SCANS, layout.taxels))
        self._scans = 0
        self._idle = np.ones(layout.pad_count, dtype=np.bool_)
        self._tare: Floats | None = None
        taxels = np.zeros((len(layout.pads), layout.taxels), dtype=np.bool_)
        for part, own in enumerate(taxels):
            own[layout.source[layout.of_pad(part)]] = True
        self._feels = (taxels[: layout.pad_count].astype(int) @ taxels.T) > 0  # (pads, pads and groups) that share some

    @property
    def wanted(self) -> int:
        """Scans until the spell is full."""
        return SPELL_SCANS - self._scans

    def take(self, scans: Scans, gap: Bools, learned: Learned) -> Learned:
        """Take at most `wanted` scans; what is known then, with new offsets if a spell has ended idle."""
        if self._tare is None:
            self._tare = learned.offset
        layout = self._layout
        self._spell[self._scans : self._scans + len(scans)] = scans.pressure[:, : layout.taxels]
        self._scans += len(scans)
        quiet = ~scans.contact & scans.complete & ~gap[:, np.newaxis]
        self._idle &= (quiet.all(axis=0) | ~self._feels).all(axis=1)
        if self.wanted:
            return learned
        offset = learned.offset.copy()
        for pad in np.flatnonzero(self._idle & learned.tared):
            own = layout.of_pad(int(pad))
            masked = learned.masked[own]
            if masked.all():
                continue
            mean = self._spell[:, own].mean(axis=0)
            settled = learned.noise[own] / SPELL_SCANS**0.5
            if (np.abs(mean) > _SUDDEN * settled)[~masked].any():
                continue
            drifted = learned.offset[own] + mean - self._tare[own]
            if shapeless(drifted, masked, layout.neighbours(int(pad)), float(settled.max())):
                offset[own] += np.where(masked, 0.0, _SHARE * mean)
        self._scans = 0
        self._idle[:] = True
        return learned if np.array_equal(offset, learned.offset) else replace(learned, offset=offset)
