"""Scans of one contact as the pattern is fitted to them: readings, variances, places, delays."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.messages import Floats
from taxelflow.numerics.bspline import pose_part
from taxelflow.numerics.centroid import LOADED
from taxelflow.numerics.clock import ROUNDING_S
from taxelflow.numerics.cut import IN_LINE
from taxelflow.numerics.robust import quantile
from taxelflow.numerics.rounding import SIGNIFICANT

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Bools
    from taxelflow.sensors.layout import Layout

FINE = 0.005
"""The smallest error of a reading that few scans prove, and with which a fit of sharp edges begins; as `COARSE`."""
COARSE = 0.06
"""Error of a reading, as a share of its contact's largest, with which every fit begins: the flanks of a contact, where
cross-talk, offsets and hysteresis are large, then weigh no more than its middle. It finds the basin."""
REFUTED = 2.0 * COARSE
"""Error that a fit leaves, as a share of the largest reading, above which its model does not hold."""
LARGEST = 0.9
"""Quantile that stands for the largest of many numbers, of which a few may be wrong."""
_LOOSE_TURN = 1e-3
"""Keeps a turn that nothing determines from wandering: 1 / rad^2."""


def delays_of(layout: Layout) -> tuple[Floats, Floats]:
    """When after its pad's mean each taxel is read (entries,), and when after a scan's time that mean is (pads,), s.

    Poses are those at the mean: at the scan's own time they would have to be extrapolated by up to a whole scan, from
    velocities that come of the poses.
    """
    taxels = np.diff(layout.starts)
    mean = np.add.reduceat(layout.delay_s, layout.starts[:-1]) / taxels
    late: Floats = layout.delay_s - np.repeat(mean, taxels)
    return np.where(np.abs(late) > ROUNDING_S, late, 0.0), mean


def strength(readings: Floats, variance: Floats) -> Floats:
    """(...), how many standard deviations readings (..., taxels) that stand out are above nothing, together."""
    with np.errstate(over="ignore"):  # constant readings have next to no noise: they are infinitely far above nothing
        squared = np.divide(readings**2, variance, out=np.zeros_like(readings), where=(variance > 0) & (readings > 0))
        total: Floats = np.sqrt(np.sum(squared, axis=-1, where=squared > SIGNIFICANT**2))
    return total


def reach(places: Floats) -> float:
    """Diagonal of a pad in pitches, like places (2, taxels): what touches it is no further away."""
    return float(np.hypot(*(np.ptp(places, axis=1) + 1.0)))


def across(places: Floats, live: Bools) -> Bools:
    """(2,), True where x or y leads across the line in which all live (taxels,) lie: any motion along it fits some
    pattern.
    """
    in_line: Bools = np.ptp(places[:, live] if live.any() else places, axis=1) < IN_LINE
    return in_line


def divided(readings: Floats, variance: Floats, ceiling: Floats, gains: Floats) -> tuple[Floats, Floats, Floats]:
    """Readings, their variance and their ceiling (..., taxels), divided by the taxels' gains (taxels,).

    A dead taxel has an infinite gain: its variance becomes 0, so that it is not used.
    """
    top = np.divide(ceiling, gains, out=np.zeros_like(ceiling), where=np.isfinite(gains))
    return readings / gains, variance / gains**2, top


class Readings(NamedTuple):
    """Scans as kernels read them. See `Scanned`; variance: (scans, taxels) with the model's error in it."""

    places: Floats
    value: Floats
    variance: Floats
    ceiling: Floats
    bends: Floats

    def taken(self, which: NDArray[np.int64]) -> Readings:
        """Some of the scans."""
        return Readings(self.places, self.value[which], self.variance[which], self.ceiling, self.bends[which])


@dataclass(slots=True, eq=False)
class Scanned:
    """Scans of one contact on one pad.

    t_s: (scans,). places: (2, taxels) in pitches. readings, variance: (scans, taxels), the latter 0 where a reading
    is not used. ceiling: (taxels,). delay_s: (taxels,), see `delays_of`. bends: (scans, 3, taxels or 0),
    see `bspline.evaluate`. unseen_error: see `Layout`. alive: (taxels,), those known to work.
    """

    t_s: Floats
    places: Floats
    readings: Floats
    variance: Floats
    ceiling: Floats
    delay_s: Floats
    bends: Floats
    unseen_error: float
    alive: Bools

    @classmethod
    def of(
        cls,
        t_s: Floats,
        places: Floats,
        readings: Floats,
        variance: Floats,
        ceiling: Floats,
        delay_s: Floats,
        unseen_error: float = 0.0,
        alive: Bools | None = None,
    ) -> Scanned:
        """Scans whose poses are not known yet."""
        width = len(delay_s) if delay_s.any() else 0
        working = np.zeros(len(delay_s), np.bool_) if alive is None else alive
        straight = np.zeros((len(t_s), 3, width))
        return cls(t_s, places, readings, variance, ceiling, delay_s, straight, unseen_error, working)

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def rolling(self) -> bool:
        """Whether taxels are read one after the other."""
        return bool(self.bends.shape[2])

    @property
    def amplitude(self) -> float:
        """Largest reading of the contact, of which errors of the model are a share: that of the well loaded scans, for
        a single reading may be wrong.
        """
        largest = self.readings.max(axis=1, initial=0.0, where=self.variance > 0)
        return quantile(largest, LARGEST) or 1.0

    @property
    def reach(self) -> float:
        """See `reach`."""
        return reach(self.places)

    @property
    def across(self) -> Bools:
        """See `across`."""
        live: Bools = np.any(self.variance > 0, axis=0)
        return across(self.places, live)

    @property
    def edge(self) -> Bools:
        """(taxels,), those at the border of the rectangle that the pad fills."""
        x, y = self.places
        border: Bools = (x <= x.min()) | (x >= x.max()) | (y <= y.min()) | (y >= y.max())
        return border

    @property
    def middle(self) -> Floats:
        """(2,) of the pad."""
        centre: Floats = 0.5 * (self.places.min(axis=1) + self.places.max(axis=1))
        return centre

    def precision(self, *, turns: bool, gain_std: float, size: float = np.inf) -> Floats:
        """(5,) 1 / variance of each state, infinite where it is held: what these taxels do not measure, a turn
        unless it `turns`, and its size unless that is given. That of x and y is around the pad's middle.
        """
        seen = ~self.across
        turn = _LOOSE_TURN if turns and seen.all() else np.inf
        return np.array([*np.where(seen, self.reach**-2, np.inf), turn, gain_std**-2, size])

    def taken(self, which: NDArray[np.int64] | slice) -> Scanned:
        """Some of the scans."""
        t_s, readings, variance = self.t_s[which], self.readings[which], self.variance[which]
        return replace(self, t_s=t_s, readings=readings, variance=variance, bends=self.bends[which])

    def on(self, taxels: Bools) -> Scanned:
        """The scans on a part of the pad (taxels,)."""
        part = replace(self, places=self.places[:, taxels], readings=self.readings[:, taxels], alive=self.alive[taxels])
        part.variance, part.ceiling, part.delay_s = self.variance[:, taxels], self.ceiling[taxels], self.delay_s[taxels]
        part.bends = self.bends[:, :, taxels] if self.rolling else self.bends
        return part

    def divided(self, gains: Floats) -> Scanned:
        """The scans with the readings of each taxel divided by its gain (taxels,), see `divided`."""
        readings, variance, ceiling = divided(self.readings, self.variance, self.ceiling, gains)
        return replace(self, readings=readings, variance=variance, ceiling=ceiling)

    def with_error(self, share: float) -> Readings:
        """The scans as kernels read them. share: of the contact's largest reading, the standard deviation of what the
        model leaves of any reading beside noise.
        """
        variance = np.where(self.variance > 0, self.variance + (share * self.amplitude) ** 2, 0.0)
        return Readings(self.places, self.readings, variance, self.ceiling, self.bends)

    def loaded(self) -> NDArray[np.bool_]:
        """(scans, taxels), readings that the object surely makes."""
        floor = np.maximum(LOADED.sigmas * np.sqrt(self.variance), LOADED.skirt * self.amplitude)
        sure: NDArray[np.bool_] = (self.readings > floor) & (self.variance > 0)
        return sure

    def load(self) -> Floats:
        """(scans, taxels), the loaded readings, 0 where there is only noise."""
        return np.where(self.loaded(), self.readings, 0.0)

    def centroids(self) -> Floats:
        """(scans, 2) of the loaded readings; (0, 0) where there are none."""
        weight = self.load()
        total = np.maximum(weight.sum(axis=1), 1e-300)
        centre: Floats = (weight @ self.places.T) / total[:, np.newaxis]
        return centre

    def bend(self, states: Floats) -> None:
        """Take from the states (scans, 5) how far the object moves while a scan is read."""
        if self.rolling:
            span = np.diff(self.t_s, prepend=np.nan, append=np.nan)
            before, after = span[:-1, np.newaxis], span[1:, np.newaxis]
            step = np.diff(pose_part(states), axis=0, prepend=np.nan, append=np.nan)
            velocity = (
                np.nanmean([step[:-1] / before, step[1:] / after], axis=0) if len(self) > 1 else 0.0 * pose_part(states)
            )
            self.bends[:] = velocity[:, :, np.newaxis] * self.delay_s
