"""The point of an object on which its centre of pressure lies, as the keyframes of a map show it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Floats


class Anchor(NamedTuple):
    """Where the centre of pressure lies on average: (2,) from the origin of the object's frame, and the mean variance
    of one scan's, in pitches^2. inside: (2,), where the map shows it; off: (scans, 2), how far it shows that of each
    scan at t_s (scans,) from there.
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
