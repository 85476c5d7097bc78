"""The point of an object on which its centre of pressure lies, as the keyframes of a map show it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Floats


class Anchor(NamedTuple):
    """The mean centre of pressure of a contact, in the object's frame, in pitches.

    arm: (2,), from the origin. variance: of one scan's centre, mean, pitches^2. inside: (2,), the mean centre by the
    map. off: (scans, 2), the centre by the map in each scan at t_s (scans,), less `inside`.
    """

    arm: Floats
    variance: float
    inside: Floats
    t_s: Floats
    off: Floats

    def held(self, t_s: Floats) -> Floats:
        """(scans, 2), of scans at these times; NaN where it has none."""
        found = np.full((len(t_s), 2), np.nan)
        _, those, own = np.intersect1d(t_s, self.t_s, assume_unique=True, return_indices=True)
        found[those] = self.off[own]
        return found
