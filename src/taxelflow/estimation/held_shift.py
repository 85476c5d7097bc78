"""What a load shifts an object's poses before it slips, and does not give back.

A pull tilts an object until friction gives way. Its poses follow the load, and go on from there when it slides. Where
the pattern dates the begin of a slip, the distance of that pose from where the object rested is the load's, and is a
part of the covariance until the object is released.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats


class HeldShift:
    """Follows the slips of all pads, of which each excursion from a reference has one begin."""

    def __init__(self, pads: int) -> None:
        self._covariance = np.zeros((pads, 2, 2))
        self._begun = np.full(pads, -1)

    def step(self, away_m: Floats, slides: Bools, moved: Bools, excursion: NDArray[np.int64]) -> Floats:
        """Covariance of what loads have shifted, (scans, pads, 2, 2), m^2, of scans that follow those of the last call.

        away_m: (scans, pads, 2), of poses from their references; NaN if unknown, as of objects that are released.
        slides: (scans, pads), a slip has begun and goes on. moved: (scans, pads), a slide explains the whole distance.
        excursion: (scans, pads), counts excursions.
        """
        held = np.repeat(self._covariance[np.newaxis], len(away_m), axis=0)
        unknown = np.isnan(away_m[..., 0])
        for pad in range(len(self._begun)):
            lost = np.flatnonzero(unknown[:, pad])
            held[lost[0] if len(lost) else len(held) :, pad] = 0.0
            scans = np.flatnonzero(slides[:, pad] & ~unknown[:, pad])
            numbers, first = np.unique(excursion[scans, pad], return_index=True)
            for number, scan in zip(numbers.tolist(), scans[first].tolist(), strict=True):
                if number != self._begun[pad] and not moved[scan, pad]:
                    end = int(np.append(lost[lost > scan], len(held))[0])
                    held[scan:end, pad] += np.outer(away_m[scan, pad], away_m[scan, pad])
                self._begun[pad] = number
        if len(held):
            self._covariance = held[-1].copy()
        return held
