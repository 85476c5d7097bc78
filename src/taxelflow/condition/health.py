"""Taxels that are not well, each with the evidence. Nothing is repaired here: who reads it decides.

silent: more readings are missing than not. stuck: one and the same reading while its neighbours are loaded, or while
the pad's others never keep theirs, or far from where they rest. noisy: its noise far above that of its pad and of its
neighbours. offset: never comes to rest where the pad's others do, though they come and go. gain: reads far less, or far
more, than all its loaded neighbours, wherever the pad's largest load is. A still contact can look like a bad taxel, so
the last two need contacts that change.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.condition.noise import noise_floor

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats
    from taxelflow.sensors.layout import Layout
    from taxelflow.sensors.sensor import Sensor

_FEWEST_SCANS = 48
_FEWEST_LOADED = 24
"""Scans with loaded neighbours that a verdict needs."""
_FEWEST_PEAKS = 3
"""Places of the pad's largest reading, by so much, in those scans: the load must have moved."""
_LOADED = 12.0
"""A reading so many standard deviations above where the taxel rests is a load."""
_NOISY = 6.0
"""Ratio to the median noise of the pad's other taxels."""
_OWN = 3.0
"""... and to the largest of its neighbours' noise: where an object is hardly ever at rest, all of them seem noisy."""
_STICKS_OUT = 10.0
"""Robust standard deviations from where the pad's other taxels rest."""
_SHARE = 0.01
"""... and this share of the sensor's largest reading."""
_GAIN, _MOSTLY = 2.5, 0.95
"""In so large a share of its scans a taxel reads less than its least neighbour, or more than its largest, by this
factor."""
_ABOVE_FLOOR = 2.0
"""Noise this far above its floor shows under load: a loaded reading that never changes is then no reading."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A taxel that is not well.

    taxel: its number in the scan. value: the reading (stuck, offset) or standard deviation (noisy) in SI, the share of
    readings missing (silent), the factor to its neighbours (gain). ratio: to what the pad's other taxels do; None
    where that is 0 or unknown. scans: how many it was judged on.
    """

    taxel: int
    fault: str
    value: float
    ratio: float | None
    scans: int

    def words(self, sensor: Sensor) -> str:
        """The finding in the sensor's unit, with the taxel's place and the evidence."""
        layout = sensor.layout
        pad = int(np.searchsorted(layout.starts, self.taxel, side="right")) - 1
        place = f"row {layout.row[self.taxel]}, col {layout.col[self.taxel]}"
        if layout.tables[pad]:
            place = f"at ({1e3 * layout.x_m[self.taxel]:.1f}, {1e3 * layout.y_m[self.taxel]:.1f}) mm"
        where = f"taxel {self.taxel} ({layout.pads[pad]}, {place})"
        value = f"{self.value / sensor.to_si:.4g} {sensor.unit}"
        times = "" if self.ratio is None else f", {self.ratio:.2g} times its pad's"
        what = {
            "silent": f"silent in {100 * self.value:.0f} %",
            "stuck": f"stuck at {value}",
            "noisy": f"noise of {value}{times}",
            "offset": f"rests at {value}{times}",
            "gain": f"{self.value:.2g} times its neighbours",
        }[self.fault]
        return f"{where} {what} in {self.scans} scans"


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
        self._readings, self._noise, self._live, self._around, self._large = readings, noise, live, around, large
        known = np.isfinite(readings)
        lowest = np.min(readings, axis=0, initial=np.inf, where=known)
        highest = np.max(readings, axis=0, initial=-np.inf, where=known)
        self._still = live & (lowest == highest)
        self._rest = _low(readings, lowest)
        moving = live & ~self._still
        self._lively = bool(moving.any()) and float(np.median(noise[moving])) > lively
        changes = float(np.median((np.diff(readings, axis=0) != 0).mean(axis=0)[live]))
        self._restless = changes > 0.5 and float(self._still[live].mean()) < 0.5

    def findings(self) -> Iterator[Finding]:
        """Numbers are those within the pad."""
        rest = self._rest[self._live]
        usual = float(np.median(rest))
        spread = max(1.4826 * float(np.median(np.abs(rest - usual))), float(np.median(self._noise[self._live])))
        apart = np.abs(self._rest - usual)
        out = self._live & (apart > _STICKS_OUT * np.maximum(spread, self._noise)) & (apart > self._large)
        for taxel in np.flatnonzero(self._still).tolist():
            level = float(self._rest[taxel])
            scans, least, _ = self._surrounded(taxel)
            if len(scans) >= _FEWEST_LOADED:
                yield Finding(taxel, "stuck", level, _over(level, float(np.median(least))), len(scans))
            elif self._restless or (out[taxel] and self._lively and not self._companion(taxel, out)):
                yield Finding(taxel, "stuck", level, _over(level, usual), len(self._readings))
        yield from self._noisy()
        for taxel in np.flatnonzero(out & ~self._still).tolist():
            scans = self._alone(taxel, out)
            if len(scans):
                level = float(np.nanmedian(self._readings[scans, taxel]))
                yield Finding(taxel, "offset", level, _over(level, usual), len(scans))
        for taxel in np.flatnonzero(self._live & ~self._still & ~out).tolist():
            yield from self._gain(taxel)

    def _companion(self, taxel: int, out: Bools) -> bool:
        """Whether a neighbour sticks out as well: then it may be a contact."""
        around = self._around[taxel]
        return bool(out[around[around >= 0]].any())

    def _noisy(self) -> Iterator[Finding]:
        moving = self._live & ~self._still
        if moving.sum() < 3:
            return
        usual = float(np.median(self._noise[moving]))
        for taxel in np.flatnonzero(moving & (self._noise > _NOISY * usual)).tolist():
            around, noise = self._around[taxel], float(self._noise[taxel])
            if noise > _OWN * self._noise[around[around >= 0]].max(initial=0.0):
                yield Finding(taxel, "noisy", noise, _over(noise, usual), len(self._readings))

    def _surrounded(self, taxel: int) -> tuple[NDArray[np.int64], Floats, Floats]:
        """Scans in which all its neighbours are loaded, and the least and the largest of their loads then."""
        around = self._around[taxel]
        around = around[around >= 0]
        if len(around) < 3 or not self._live[around].all():
            return np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0)
        load = self._readings[:, around] - self._rest[around]
        least, most = load.min(axis=1), load.max(axis=1)
        scans = np.flatnonzero(least > _LOADED * np.median(self._noise[self._live]))
        return scans, least[scans], most[scans]

    def _gain(self, taxel: int) -> Iterator[Finding]:
        """A hole or a spike among loaded neighbours that stays while the load moves."""
        scans, least, most = self._surrounded(taxel)
        own = self._readings[scans, taxel] - self._rest[taxel]
        if len(own) < _FEWEST_LOADED or max((own * _GAIN < least).mean(), (own > _GAIN * most).mean()) < _MOSTLY:
            return
        others = np.where(np.isfinite(self._readings[scans]), self._readings[scans] - self._rest, -np.inf)
        others[:, taxel] = -np.inf
        first, second = np.sort(np.partition(others, -2, axis=1)[:, -2:], axis=1).T[::-1]
        sure = first - second > _LOADED * np.median(self._noise[self._live])
        if len(np.unique(np.argmax(others[sure], axis=1))) >= _FEWEST_PEAKS:
            factor = float(np.nanmedian(own / (0.5 * (least + most))))
            yield Finding(taxel, "gain", factor, factor, len(scans))

    def _alone(self, taxel: int, out: Bools) -> NDArray[np.int64]:
        """Scans in which all others rest, if there are scans in which some do not, and no neighbour sticks out."""
        none = np.zeros(0, dtype=np.int64)
        others = self._live & ~out
        others[taxel] = False
        if self._companion(taxel, out) or others.sum() < 2:
            return none
        with np.errstate(invalid="ignore"):
            loaded = (self._readings[:, others] - self._rest[others] > _LOADED * self._noise[others]).any(axis=1)
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


def _low(readings: Floats, lowest: Floats) -> Floats:
    """(taxels,) what a taxel rests at: exceeded in 9 of 10 of its scans, taken from 2,000 of them at most."""
    some = readings[:: 1 + len(readings) // 2000]
    ranked = np.sort(np.where(np.isfinite(some), some, np.inf), axis=0)
    place = np.isfinite(some).sum(axis=0) // 10
    low: Floats = ranked[place, np.arange(readings.shape[1])]
    return np.where(np.isfinite(low), low, lowest)


def _over(value: float, usual: float) -> float | None:
    return value / usual if usual else None


def _moved(finding: Finding, start: int) -> Finding:
    return Finding(start + finding.taxel, finding.fault, finding.value, finding.ratio, finding.scans)
