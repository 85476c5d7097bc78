"""Taxels that are not well, each with the evidence. Nothing is repaired here: who reads it decides.

silent: more readings are missing than not. stuck: one and the same reading, far from where the pad's taxels rest, or while its
neighbours are loaded. noisy: its noise far above that of its pad. offset: never comes to rest where the pad's others
do, though they come and go. gain: reads far less, or far more, than its neighbours among which it lies, wherever the
pad's largest load is. A still contact can look like a bad taxel, so the last two need contacts that change.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.condition.noise import noise_floor

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from taxelflow.layout import Layout
    from taxelflow.messages import Bools, Floats

_FEWEST_SCANS = 48
_FEWEST_LOADED = 24
"""Scans with loaded neighbours that a verdict needs."""
_FEWEST_PEAKS = 3
"""Places of the pad's largest reading in those scans: the load must have moved."""
_LOADED = 12.0
"""A reading so many standard deviations above the taxel's lowest is a load."""
_NOISY = 6.0
"""Ratio to the median noise of the pad's other taxels."""
_STICKS_OUT = 10.0
"""Robust standard deviations from where the pad's other taxels rest."""
_SHARE = 0.01
"""... and this share of the sensor's largest reading."""
_GAIN, _MOSTLY = 2.5, 0.95
"""In so large a share of its scans a taxel reads above, or below, its neighbours' mean by this factor."""
_ALIKE = 2.0
"""Neighbours whose loads differ by more than this factor do not say what lies between them."""
_ABOVE_FLOOR = 2.0
"""Noise this far above its floor shows under load: a loaded reading that never changes is then no reading."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A taxel that is not well. taxel: its number in the scan. value: the reading (stuck, offset), the standard deviation (noisy)
    in SI, or the share of readings missing (silent), or the factor to its neighbours (gain). ratio: to what the pad's other
    taxels do; None where that is 0 or unknown. scans: how many it was judged on.
    """

    taxel: int
    fault: str
    value: float
    ratio: float | None
    scans: int


def examine(windows: Floats, noise: Floats, masked: Bools, layout: Layout) -> tuple[Finding, ...]:
    """Findings in a sample of scans, sorted by taxel; at most one a taxel.

    windows: (windows, scans, taxels) in SI, NaN where missing. noise, masked: (taxels,). What is masked is not judged,
    but a taxel never heard from is told of.
    """
    if not windows.size:
        return ()
    flat = windows.reshape(-1, windows.shape[2])
    found: dict[int, Finding] = {}
    heard = np.isfinite(flat)
    counts = heard.sum(axis=0)
    for taxel in np.flatnonzero(2 * counts < len(flat)):
        missing = 1.0 - float(counts[taxel]) / len(flat)
        found[int(taxel)] = Finding(int(taxel), "silent", missing, None, len(flat))
    lively = noise_floor(flat) * _ABOVE_FLOOR
    largest = float(np.max(np.abs(flat), initial=0.0, where=heard))
    for pad in range(layout.pad_count):
        own = layout.of_pad(pad)
        live = ~masked[own] & (2 * counts[own] >= len(flat)) & (counts[own] >= _FEWEST_SCANS)
        if live.sum() > 2:
            seen = _Pad(flat[:, own], noise[own], live, _around(layout, pad), lively, _SHARE * largest)
            for finding in seen.findings():
                found.setdefault(own.start + finding.taxel, _moved(finding, own.start))
    return tuple(found[taxel] for taxel in sorted(found))


class _Pad:
    """One pad's sample. readings: (scans, taxels). around: (taxels, most neighbours), -1 where there is none."""

    def __init__(
        self, readings: Floats, noise: Floats, live: Bools, around: NDArray[np.int64], lively: float, large: float
    ) -> None:
        self._noise, self._live, self._around, self._large = noise, live, around, large
        self._readings = np.where(np.isfinite(readings), readings, np.nan)
        with np.errstate(all="ignore"):
            self._lowest = np.min(readings, axis=0, initial=np.inf, where=np.isfinite(readings))
            self._highest = np.max(readings, axis=0, initial=-np.inf, where=np.isfinite(readings))
        self._still = live & (self._lowest == self._highest)
        moving = live & ~self._still
        self._lively = bool(moving.any()) and float(np.median(noise[moving])) > lively

    def findings(self) -> Iterator[Finding]:
        """Numbers are those within the pad."""
        rest = self._lowest[self._live]
        usual = float(np.median(rest))
        spread = max(1.4826 * float(np.median(np.abs(rest - usual))), float(np.median(self._noise[self._live])))
        apart = np.abs(self._lowest - usual)
        out = self._live & (apart > _STICKS_OUT * spread) & (apart > self._large)
        for taxel in np.flatnonzero(self._still):
            scans, load = self._surrounded(int(taxel))
            if len(scans) >= _FEWEST_LOADED:
                ratio = _over(float(self._lowest[taxel]), float(np.median(load)))
                yield Finding(int(taxel), "stuck", float(self._lowest[taxel]), ratio, len(scans))
            elif out[taxel] and self._lively and not self._companion(int(taxel), out):
                ratio = _over(float(self._lowest[taxel]), usual)
                yield Finding(int(taxel), "stuck", float(self._lowest[taxel]), ratio, len(self._readings))
        yield from self._noisy()
        for taxel in np.flatnonzero(out & ~self._still):
            scans = self._alone(int(taxel), out)
            if len(scans):
                level = float(np.nanmedian(self._readings[scans, taxel]))
                yield Finding(int(taxel), "offset", level, _over(level, usual), len(scans))
        for taxel in np.flatnonzero(self._live & ~self._still):
            yield from self._gain(int(taxel))

    def _companion(self, taxel: int, out: Bools) -> bool:
        """Whether a neighbour sticks out as well: then it may be a contact."""
        around = self._around[taxel]
        return bool(out[around[around >= 0]].any())

    def _noisy(self) -> Iterator[Finding]:
        moving = self._live & ~self._still
        if moving.sum() < 3:
            return
        usual = float(np.median(self._noise[moving]))
        for taxel in np.flatnonzero(moving & (self._noise > _NOISY * usual)):
            noise = float(self._noise[taxel])
            yield Finding(int(taxel), "noisy", noise, _over(noise, usual), len(self._readings))

    def _surrounded(self, taxel: int) -> tuple[NDArray[np.int64], Floats]:
        """Scans in which all neighbours are loaded alike, and their mean load then, above their lowest."""
        around = self._around[taxel]
        around = around[around >= 0]
        if len(around) < 3 or not self._live[around].all():
            return np.zeros(0, dtype=np.int64), np.zeros(0)
        load = self._readings[:, around] - self._lowest[around]
        least, most = load.min(axis=1), load.max(axis=1)
        with np.errstate(invalid="ignore"):
            scans = np.flatnonzero((least > _LOADED * self._noise[around].max()) & (most < _ALIKE * least))
        return scans, load[scans].mean(axis=1)

    def _gain(self, taxel: int) -> Iterator[Finding]:
        """The taxel's load over that of its neighbours, where it lies among them."""
        scans, load = self._surrounded(taxel)
        if len(scans) < _FEWEST_LOADED:
            return
        own = (self._readings[scans, taxel] - self._lowest[taxel]) / load
        known = np.isfinite(own)
        scans, own = scans[known], own[known]
        if len(own) < _FEWEST_LOADED:
            return
        low, high = (own < 1.0 / _GAIN).mean() >= _MOSTLY, (own > _GAIN).mean() >= _MOSTLY
        if not (low or high):
            return
        others = np.where(np.isfinite(self._readings[scans]), self._readings[scans] - self._lowest, -np.inf)
        others[:, taxel] = -np.inf
        if len(np.unique(np.argmax(others, axis=1))) >= _FEWEST_PEAKS:
            factor = float(np.median(own))
            yield Finding(taxel, "gain", factor, factor, len(scans))

    def _alone(self, taxel: int, out: Bools) -> NDArray[np.int64]:
        """Scans in which all others rest, if there are scans in which some do not, and no neighbour sticks out."""
        none = np.zeros(0, dtype=np.int64)
        others = self._live & ~out
        others[taxel] = False
        if self._companion(taxel, out) or others.sum() < 2:
            return none
        with np.errstate(invalid="ignore"):
            loaded = (self._readings[:, others] - self._lowest[others] > _LOADED * self._noise[others]).any(axis=1)
        alone = np.flatnonzero(~loaded)
        return alone if len(alone) >= _FEWEST_LOADED and loaded.sum() >= _FEWEST_LOADED else none


def _around(layout: Layout, pad: int) -> NDArray[np.int64]:
    """(taxels, most neighbours) of a pad, numbered within it, -1 where there is none."""
    own = layout.of_pad(pad)
    beside: list[list[int]] = [[] for _ in range(own.stop - own.start)]
    for one, other in layout.neighbours(pad).tolist():
        beside[one].append(other)
        beside[other].append(one)
    most = max(map(len, beside), default=0)
    return np.array([[*some, *[-1] * (most - len(some))] for some in beside], dtype=np.int64).reshape(len(beside), most)


def _over(value: float, usual: float) -> float | None:
    return value / usual if usual else None


def _moved(finding: Finding, start: int) -> Finding:
    return Finding(start + finding.taxel, finding.fault, finding.value, finding.ratio, finding.scans)
