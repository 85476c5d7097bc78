"""Readings that a skin may remember: what is left for about a second where a load was many times as large.

An elastic skin creeps back after it was pressed. What it reads then has the pattern of the object that has left, and
fits a map as well as that object did. A reading may be wrong by the sensor's `unseen_error` as a share of what was
loaded before. So a pad whose largest reading is no more than that, at three standard deviations, shows no object.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.rounding import SIGNIFICANT
from taxelflow.runtime.compiling import kernel

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats
    from taxelflow.sensors.layout import Layout


class SkinMemory:
    """Follows the largest readings of all pads."""

    def __init__(self, layout: Layout, fades_s: float = 1.0) -> None:
        """fades_s: time constant. Released pads of a Schunk SDH-2 read up to 6 % for 0.2 s, and 2 % for 1 s."""
        self._share, self._fades_s = SIGNIFICANT * layout.unseen_error, fades_s
        self._held = np.zeros(len(layout.pads))
        self._pads = layout.pads[: layout.pad_count]
        self._scans = np.zeros(len(layout.pads), dtype=np.int64)
        self._last_s = np.full(1, -np.inf)
        self.step(np.zeros(0), np.zeros((0, len(layout.pads))))  # compiles

    def step(self, t_s: Floats, peak: Floats) -> Bools:
        """(scans, pads), where the skin may remember all that a pad reads.

        peak: (scans, pads), largest readings of the loaded taxels, NaN without a contact; these scans follow those of
        the last call.
        """
        remembered, peak = np.zeros(peak.shape, dtype=np.bool_), np.ascontiguousarray(peak)
        find_remembered(t_s, peak, self._share, self._fades_s, self._held, self._last_s, remembered)
        if np.count_nonzero(remembered):
            self._scans += np.count_nonzero(remembered, axis=0)
        return remembered

    @property
    def notes(self) -> list[str]:
        """A sentence with the number of such scans on each pad; none where there are none."""
        counts = zip(self._pads, self._scans.tolist(), strict=False)  # groups and contacts lie on the pads
        counted = [f"{scans} of {name}" for name, scans in counts if scans]
        if not counted:
            return []
        return [f"scans without an ok pose, as the skin may remember a load that has left: {', '.join(counted)}"]


@kernel
def find_remembered(
    t_s: Floats, peak: Floats, share: float, fades_s: float, held: Floats, last_s: Floats, remembered: Bools
) -> None:
    """Set remembered (scans, pads), which comes in False; bring held (pads,) and last_s (1,) up to date.

    share: of what a pad has held that its readings must exceed.
    """
    for scan in range(len(t_s)):
        left = np.exp(min(last_s[0] - t_s[scan], 0.0) / fades_s)
        last_s[0] = t_s[scan]
        for pad in range(len(held)):
            held[pad] *= left
            if peak[scan, pad] >= 0.0:  # not NaN
                remembered[scan, pad] = peak[scan, pad] < share * held[pad]
                held[pad] = max(held[pad], peak[scan, pad])
