"""A solved contact: its map, the states of its scans, and how well both fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.estimation.template.bundle_adjustment import Fit
    from taxelflow.estimation.template.map import Pattern
    from taxelflow.messages import Floats


@dataclass(slots=True, eq=False)
class Solved:
    """A contact as the joint fit sees it.

    states: (scans, 5), see `spline`. rough: error of the pattern relative to it. gain_std: of the gains around 1.
    turns: whether its rotation can be seen; sight: how well, see `sights`. dead: taxels that do not answer.
    grows: with the load, around the origin of the pattern's frame.
    """

    pattern: Pattern
    states: Floats
    fit: Fit
    rough: float
    gain_std: float
    turns: bool
    dead: NDArray[np.int64]
    sight: float
    grows: bool = False

    def middle(self) -> Floats:
        """(2,) the point of the body whose places are given out: its pattern's centre, or where it does not grow."""
        return np.zeros(2) if self.grows else self.pattern.centre()
