"""Change of a contact's pressure pattern against what a change of load and tilt explains, from the scans themselves.

When a hand moves, the load is redistributed over the pad while the object stays: the pattern q at rest becomes

    y = g q (1 + a . r) + noise,

with load g and tilt a; r is the place on the pad. Poses move along, for a tilt of a smooth pattern is a shift. A slip
changes the pattern in ways that load and tilt do not. Scans are averaged over bins of 0.1 s; y is the mean of the bins
after one, q that of the two before it. The unexplained change is the norm of what the least squares fit of g and a
leaves of y, over that of y. Taxels at the end of their range are left out.

A tilt in proportion to the pressure is that of a contact whose edge stays. A rigid object that a hand tilts or swings
comes down on one side and lifts off on the other, which changes the pattern as much as a slide. So changes that are as
in a slip are compared again (`rest_or_slide`).

A slow slide of a smooth object is a tilt over 0.3 s, but not over a second: its shift is no longer small beside the
width of the pattern. So a recording is compared over longer baselines, too.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from taxelflow.numerics.bins import BIN_S, Bin, Binning
from taxelflow.numerics.rest_or_slide import compare, overlap
from taxelflow.sensors.skins import PadNoise, skin_of
from taxelflow.slip.evidence import looks_like_slip, tilt_over_slide
from taxelflow.slip.shear_change import ShearNoise, spread
from taxelflow.slip.unexplained import Pads, Patterns, compare_patterns

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats, Scans
    from taxelflow.sensors.layout import Layout


class _Bins(NamedTuple):
    """Bins whose patterns are compared."""

    before: int = 2
    """Bins whose mean is the pattern at rest. Two or three detect equally well."""
    longer: tuple[int, int] = (10, 20)
    """Bins between the patterns that a recording compares over longer baselines: 1 and 2 s."""


BINS = _Bins()
_OWN = 7
"""Values of a pad and bin beside those of longer baselines."""


@dataclass(frozen=True, slots=True, eq=False)
class PatternChanges:
    """Changes of patterns per scan and pad, each of a bin that is judged.

    t_s: (scans,). centre_s: (scans,), first time of that bin; NaN in a scan that completes no window. touching:
    (scans, pads), contact in all of the bin. The others are (scans, pads), NaN where the window is not in contact
    throughout. unexplained: share of the pattern's power that load and tilt do not explain. noise: share that noise
    leaves unexplained. rise: change of the log load. stirred: at a steady load, 1 where the pattern changed by more
    than noise and creep explain, 0 where it did not. spread: power of the change of shear that is not in proportion to
    the pressure, over that of the pressure. spread_noise: what noise adds to it. Both NaN without shear. longer:
    (scans, pads, baselines, 3), unexplained, noise and rise over each longer baseline that ends with the same bins; a
    stream has none.
    """

    t_s: Floats
    centre_s: Floats
    touching: Bools
    unexplained: Floats
    noise: Floats
    rise: Floats
    stirred: Floats
    tilt: Floats
    spread: Floats
    spread_noise: Floats
    longer: Floats

    def __len__(self) -> int:
        return len(self.t_s)


class PatternWatch:
    """Compares patterns from bin to bin; the result does not depend on how the scans are cut into blocks."""

    def __init__(self, layout: Layout, creep_m_s: float, after: int, longer: tuple[int, ...] = ()) -> None:
        """creep_m_s: see `SlipMonitor`. after: bins after the one that is judged. longer: bins of longer baselines."""
        self._layout, self._starts = layout, layout.starts[:-1]
        self._pads, self._noise = Pads.of(layout), PadNoise(layout)
        self._creep_m = creep_m_s * (after + BINS.before + 2) / 2 * BIN_S
        self._after, self._longer = after, longer
        self._bins: deque[Bin] = deque(maxlen=BINS.before + max((1, *longer)) + after)
        self._binning = Binning()
        self._known = np.zeros(len(layout.pads), dtype=np.int64)  # last bins in contact and complete
        self.completed: list[Bin] | None = [] if layout.unseen_error else None
        """Bins since the last that was taken out, where `ShiftingLoad` needs them."""
        self._shear_noise = ShearNoise(layout)
        self._unchanged = self._filled(*self._nothing_found((1, len(layout.pads))))

    def step(self, scans: Scans) -> PatternChanges:
        """Changes of the scans that follow those of the last call."""
        shear_noise = self._shear_noise.step(scans, scans.shear) if scans.shear is not None and len(scans) else None
        found: tuple[Floats, Bools, Floats] | None = None
        for scan in range(len(scans)):
            if self._completed(scans, scan) and len(self._bins) > BINS.before + self._after:
                found = found or self._nothing_found(scans.contact.shape)
                centre_s, touching, values = found
                centre = self._bins[-1 - self._after]
                centre_s[scan], touching[scan] = centre.since_s, centre.touching
                self._compare(scans.noise, values[:, scan])
                if shear_noise is not None:
                    self._compare_shear(shear_noise[scan], values[:, scan])
        if found is None and len(scans) == 1:  # most scans of a stream
            return PatternChanges(scans.t_s, *self._unchanged)
        return PatternChanges(scans.t_s, *self._filled(*(found or self._nothing_found(scans.contact.shape))))

    def _nothing_found(self, shape: tuple[int, ...]) -> tuple[Floats, Bools, Floats]:
        """Room for the changes of (scans, pads): centre_s, touching, and the others, of which three for a baseline."""
        others = _OWN + 3 * len(self._longer)
        return np.full(shape[0], np.nan), np.zeros(shape, dtype=np.bool_), np.full((others, *shape), np.nan)

    def _filled(self, centre_s: Floats, touching: Bools, values: Floats) -> tuple[Any, ...]:
        """All fields but the time."""
        shape = (*touching.shape, len(self._longer), 3)
        return centre_s, touching, *values[:_OWN], np.moveaxis(values[_OWN:], 0, -1).reshape(shape)

    def _completed(self, scans: Scans, scan: int) -> bool:
        """Add a scan to the open bin; whether that completes it."""
        found = self._binning.add(scans, scan)
        if self._binning.after_gap:
            self._bins.clear()
            self._known[:] = 0
        if found is None:
            return False
        self._bins.append(found)
        self._known = np.where(found.touching & found.whole, self._known + 1, 0)
        if self.completed is not None:
            self.completed.append(found)
        return True

    def _sides(self, between: int = 1) -> tuple[list[Bin], list[Bin]]:
        """Bins before and after this many bins, the last of all."""
        bins, first = list(self._bins), len(self._bins) - self._after - between
        return bins[first - BINS.before : first], bins[len(bins) - self._after :]

    def _compare(self, noise: Floats, found: Floats) -> None:
        """Fill in, of (7 and 3 of each longer baseline, pads), unexplained, noise, rise, stirred and tilt, and the
        longer ones. noise: (entries,).
        """
        patterns = self._patterns(noise, 1)
        found[:4] = self._changes(patterns, 1)
        if self._layout.unseen_error:
            scatter = self._noise.median(noise) * np.sqrt(patterns.scatter)
            for pad in np.flatnonzero(looks_like_slip(*found[:3])).tolist():
                own = self._layout.of_pad(pad)
                before, after = patterns.before[own], patterns.after[own]
                found[4, pad] = _tilt(self._layout, pad, before, after, float(scatter[pad]))
        for number, between in enumerate(self._longer):
            if len(self._bins) >= BINS.before + between + self._after:
                first = _OWN + 3 * number
                found[first : first + 3] = self._changes(self._patterns(noise, between), between)[:3]

    def _patterns(self, noise: Floats, between: int) -> Patterns:
        """Those before and after this many bins, the last of all."""
        before, after = self._sides(between)
        (old, old_scans), (new, new_scans) = _mean(before), _mean(after)
        clipped = np.logical_or.reduce([one.clipped for one in [*before, *after]])
        return Patterns(old, new, 1.0 / old_scans + 1.0 / new_scans, clipped, noise)

    def _changes(self, patterns: Patterns, between: int) -> Floats:
        """(4, pads), unexplained, noise, rise and stirred over this many bins."""
        known = self._known >= BINS.before + between + self._after
        found = np.empty((4, len(known)))
        compare_patterns(self._pads, patterns, known, self._creep_m, found)
        return found

    def _compare_shear(self, variance: Floats, found: Floats) -> None:
        """Fill in, of (7 and more, pads), the last of seven where the pattern is known: spread and its noise. variance:
        (pads,).
        """
        before, after = self._sides()
        (old, old_scans), (new, new_scans), shear = (
            _mean(before),
            _mean(after),
            (_mean_shear(before), _mean_shear(after)),
        )
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            power, per_variance = spread((old, new), shear, self._starts)
            noise = per_variance * variance * (1 / old_scans + 1 / new_scans)
        found[5:_OWN] = np.where(np.isfinite(found[0] + power), (power, noise), np.nan)


def _tilt(layout: Layout, pad: int, old: Floats, new: Floats, scatter: float) -> float:
    """See `PatternChanges`: of a pad's patterns (taxels,), whose difference has this standard deviation."""
    skin = skin_of(layout, pad)
    common = overlap(skin, old, new)
    if common.covers or not common.comparable:
        return np.nan
    way = np.array([common.x, common.y, 0.0])
    return tilt_over_slide(compare(skin, old, new, scatter, way, gain_error=layout.unseen_error))


def _mean(bins: list[Bin]) -> tuple[Floats, int]:
    """Mean pattern of some bins, and the number of its scans."""
    scans = sum(one.scans for one in bins)
    total = bins[0].pressure
    for one in bins[1:]:
        total = total + one.pressure
    return total / scans, scans


def _mean_shear(bins: list[Bin]) -> Floats:
    """(entries, 2)."""
    total: Floats = np.sum([one.shear for one in bins if one.shear is not None], axis=0)
    return total / sum(one.scans for one in bins)
