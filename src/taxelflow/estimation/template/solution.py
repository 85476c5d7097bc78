"""A solved contact: its map, the states of its scans, and how well both fit."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.template.bundle_adjustment import diagonals_of
from taxelflow.numerics.bspline import in_object, states_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.estimation.template.bundle_adjustment import Fit
    from taxelflow.estimation.template.map import Pattern
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.messages import Bools, Floats


class _Gains(NamedTuple):
    """Gains of a contact's scans: their mean is 1 by convention, their spread is learned."""

    well_known: float = 0.6
    spread: tuple[float, float] = (0.05, 0.95)
    """Quantiles: gains with a variance below the first are used; their spread is the distance of the other two: ..."""
    normal_spread: float = 3.29
    """... which is this number of standard deviations of a normal distribution. A load that changes for a short time
    counts, too."""
    least: float = 0.05
    least_std: float = 0.02
    """Lower limits of the mean gain by which all are divided, and of their standard deviation."""


_GAINS = _Gains()


class Hidden(NamedTuple):
    """Unit vector (2,) along the pad in whose direction no reading shows a motion, 0 if there is none. at_rest: (2,),
    the same if the object may have rested along it, else 0. See `hidden_motion`.
    """

    direction: Floats
    at_rest: Floats

    def __bool__(self) -> bool:
        return bool(self.direction.any())


ALL_SHOWN = Hidden(np.zeros(2), np.zeros(2))


@dataclass(slots=True, eq=False)
class Solved:
    """The result of the joint fit of a contact.

    states: (scans, 5), see `bspline`. error: share of the contact's largest reading, see `Scanned.with_error`.
    gain_std: of the gains around 1. turns, grows: whether the object turns, and its contact grows with the load
    around the origin of the pattern's frame. shown: whether its turn is more than faults of the sensor explain.
    agrees: (scans,), whether independent starts put the object at the same place; empty where there was one start.
    rival: (scans, 3), in pitches and rad, how far from here a hypothesis that explains the scans nearly as well puts
    the object, one that turns where this does not, or the reverse; growth: the same of one that grows or does not; each
    is empty if there is none. dead: taxels that do not answer. gains: (taxels,), by which the readings were
    divided; empty if they were not. heights: whether the pattern is one of heights, see `depth`; depth: (scans,),
    of such a pattern; empty if it stays the same.
    """

    pattern: Pattern
    states: Floats
    fit: Fit
    error: float
    gain_std: float
    turns: bool
    grows: bool = False
    shown: bool = True
    agrees: Bools = field(default_factory=lambda: np.ones(0, np.bool_))
    rival: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    growth: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    dead: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    gains: Floats = field(default_factory=lambda: np.zeros(0))
    heights: bool = False
    depth: Floats = field(default_factory=lambda: np.zeros(0))
    hidden: Hidden = ALL_SHOWN

    @property
    def kind(self) -> tuple[bool, bool]:
        """The hypothesis."""
        return self.turns, self.grows

    @property
    def form(self) -> tuple[bool, bool, bool]:
        """What the pattern is of, and what changes beside the pose."""
        return self.grows, self.heights, self.sinks

    @property
    def sinks(self) -> bool:
        """Whether the contact is pressed in more or less."""
        return len(self.depth) > 0

    def copy(self) -> Solved:
        """The same fit, with a pattern, states and depth of its own to refine."""
        return replace(self, pattern=replace(self.pattern), states=self.states.copy(), depth=self.depth.copy())

    def rival_variance(self, *, turns: bool) -> Floats:
        """(2,), variance of x and y, in pitches^2, and of theta, rad^2: by `growth`, and by `rival` where a rival that
        `turns` counts.
        """
        apart = (self.growth, self.rival) if turns else (self.growth,)
        squared = [np.mean(one**2, axis=0) for one in apart if len(one)]
        x, y, theta = sum(squared, np.zeros(3))
        return np.array([0.5 * (x + y), theta])

    def middle(self, scanned: Scanned) -> Floats:
        """(2,) the point of the body whose places are given out: its centre of pressure, or where it does not grow."""
        shown = None if self.grows else shown_centre(scanned, self.states)
        return np.zeros(2) if shown is None else shown


def shown_centre(scanned: Scanned, states: Floats) -> Floats | None:
    """(2,) the centre of pressure in the object's frame, averaged over the load of scans at states (scans, 5).

    None if no scan has load. A turn that is not observable moves this point least. The centre of a map's pressure may
    be elsewhere: a map reaches beyond what taxels have read.
    """
    load, middles = scanned.load().sum(axis=1), scanned.centroids()
    if not load.any():
        return None
    inside = [in_object(middle[np.newaxis], state)[0] for middle, state in zip(middles, states, strict=True)]
    shown: Floats = np.average(inside, axis=0, weights=load)
    return shown


def normalize_gains(solved: Solved) -> float:
    """Normalise the gains to mean 1, in place, by scaling pattern and depth; returns their standard deviation.

    Both are taken from the scans that determine their gain best.
    """
    variance, gains = diagonals_of(solved.fit.covariance).gain, states_of(solved.states).gain
    well = variance <= np.quantile(variance, _GAINS.well_known)
    mean = max(float(np.median(gains[well])), _GAINS.least)
    low, high = np.quantile(gains[well], _GAINS.spread)
    spread = float(high - low) / _GAINS.normal_spread
    gains /= mean
    solved.depth *= mean
    solved.pattern.coefficients = solved.pattern.coefficients * mean
    solved.pattern.smoothing /= mean**2
    return float(np.sqrt(max(spread**2 - float(np.median(variance[well])), _GAINS.least_std**2)))
