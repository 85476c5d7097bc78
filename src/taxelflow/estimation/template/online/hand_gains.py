"""Gains of a hand's taxels as the maps have estimated them: each scan is divided by them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.dead_taxels import answers, working
from taxelflow.estimation.template.observations import divided

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.online.hand import Scan
    from taxelflow.messages import Floats
    from taxelflow.sensors.layout import Layout


class HandGains:
    """value: (entries,), infinite where a map calls a taxel dead, until it reads under load: what few keyframes have
    seen silent may have been beside the object. alive: (entries,), those that have read under load.
    """

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self.value, self.alive = np.ones(layout.entries), np.zeros(layout.entries, np.bool_)
        self._equal = True  # all are 1
        self._dead: dict[int, NDArray[np.int64]] = {}  # by pad

    def put(self, pad: int, gains: Floats) -> None:
        """Take over a map's gains (taxels,) of a pad."""
        self.value[self._layout.of_pad(pad)] = gains
        self._note(pad)

    def ended(self, pad: int, scanned: Scanned) -> None:
        """Learn from the keyframes of a contact that ends which taxels of a pad work."""
        self.alive[self._layout.of_pad(pad)] |= working(scanned.readings, np.sqrt(scanned.variance[0]))

    def divided(self, scan: Scan) -> Scan:
        """A scan with its readings divided by the gains."""
        if self._equal:
            return scan
        for pad, dead in list(self._dead.items()):
            own = self._layout.of_pad(pad)
            alive = answers(scan.reading[own], scan.variance[own], dead)
            if len(alive):
                self.value[own][alive], self.alive[own][alive] = 1.0, True
                self._note(pad)
        reading, variance, ceiling = divided(scan.reading, scan.variance, scan.ceiling, self.value)
        return scan._replace(reading=reading, variance=variance, ceiling=ceiling)

    def _note(self, pad: int) -> None:
        dead = np.flatnonzero(np.isinf(self.value[self._layout.of_pad(pad)]))
        self._dead.pop(pad, None)
        if len(dead):
            self._dead[pad] = dead
        self._equal = bool((self.value == 1.0).all())
