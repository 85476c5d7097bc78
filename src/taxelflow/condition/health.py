"""Detection of faulty taxels, each with the evidence. Nothing is repaired here.

silent: more readings are missing than not. stuck: one constant reading, while its neighbours are loaded, or while the
other taxels of the pad never keep theirs, or far from where they rest. noisy: noise far above that of its pad and of
its neighbours. offset: does not come to rest where the pad's other taxels do, although they come and go. gain: reads
far less, or far more, than all its loaded neighbours, wherever the pad's largest load is. A steady contact can look
like a faulty taxel, so the last two need contacts that change.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.condition.converter import noise_floor
from taxelflow.numerics.robust import robust_std

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats
    from taxelflow.sensors.layout import Layout
    from taxelflow.sensors.sensor import Sensor


@dataclass(frozen=True, slots=True)
class _Evidence:
    """What a finding needs."""

    min_scans: int = 48
    """Known readings that a taxel needs to be judged: 4 windows."""
    min_loaded_scans: int = 24
    """Scans with loaded neighbours, or with and without load elsewhere, that a finding needs."""
    min_peak_places: int = 3
    """Places of the pad's largest reading in those scans: the load must have moved,"""
    min_travel: float = 2.0
    """... or its centre by this many pitches, from one place to the third: a flat object has no largest reading."""
    min_neighbours: int = 3
    """Neighbours that a taxel needs to be compared with them."""
    load_sigmas: float = 12.0
    """A reading this many standard deviations above where the taxel rests is a load."""
    noise_ratio: float = 6.0
    """A noisy taxel has at least this ratio to the median noise of its pad,"""
    neighbour_noise_ratio: float = 3.0
    """... and this to the largest noise of its neighbours: where an object is hardly ever at rest, all of them seem
    noisy."""
    outlier_sigmas: float = 10.0
    """A taxel is an outlier if it rests this many robust standard deviations from where the pad's taxels do,"""
    min_outlier_share: float = 0.01
    """... and this share of the sensor's largest reading."""
    gain_ratio: float = 2.5
    """A taxel of wrong gain reads this factor less than its least loaded neighbour, or more than its most loaded
    one,"""
    min_gain_share: float = 0.95
    """... in this share of its scans."""
    visible_noise_ratio: float = 2.0
    """Noise above its floor by this ratio is visible in every loaded reading: a constant one is then no reading."""
    max_constant_share: float = 0.5
    """If at least half of the pad's readings change from scan to scan, and half of its taxels, a constant one is
    stuck."""
    rest_divisor: int = 10
    """A taxel rests at the value that is exceeded in all but one of this many scans."""
    max_rest_scans: int = 2000
    """Scans from which it is taken, at most: sorting takes time."""


EVIDENCE = _Evidence()


@dataclass(frozen=True, slots=True)
class Finding:
    """A faulty taxel.

    taxel: its number in the scan. value: the reading (stuck, offset) or standard deviation (noisy) in SI, the share of
    readings missing (silent), the factor to its neighbours (gain, line). ratio: to the pad's other taxels; None where
    theirs is 0 or unknown. scans: how many it was judged on.
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
            "line": f"on a line that reads {self.value:.2g} times those beside it",
        }[self.fault]
        return f"{where} {what} in {self.scans} scans"


def find_faults(windows: Floats, noise: Floats, masked: Bools, layout: Layout) -> tuple[Finding, ...]:
    """Findings in a sample of scans, sorted by taxel; at most one a taxel.

    windows: (windows, scans, taxels) in SI, NaN where missing. noise, masked: (taxels,). Masked taxels are not judged,
    except that one without any reading is reported.
    """
    if not windows.size:
        return ()
    flat = windows.reshape(-1, windows.shape[2])
    if len(windows) == 1:  # a recording shorter than a window, filled up with NaN
        flat = flat[np.isfinite(flat).any(axis=1)]
    found: dict[int, Finding] = {}
    known = np.isfinite(flat)
    counts = known.sum(axis=0)
    for taxel in np.flatnonzero(2 * counts < len(flat)):
        missing = 1.0 - float(counts[taxel]) / len(flat)
        found[int(taxel)] = Finding(int(taxel), "silent", missing, None, len(flat))
    visible_noise = noise_floor(flat) * EVIDENCE.visible_noise_ratio
    min_offset = EVIDENCE.min_outlier_share * float(np.max(np.abs(flat), initial=0.0, where=known))
    for pad in range(layout.pad_count):
        own = layout.of_pad(pad)
        live = ~masked[own] & (2 * counts[own] >= len(flat)) & (counts[own] >= EVIDENCE.min_scans)
        if live.sum() > 2:
            places = np.stack([layout.x_m[own], layout.y_m[own]], axis=1) / layout.pitch_m[pad]
            near = _neighbours(layout, pad)
            sample = _PadSample(flat[:, own], noise[own], live, places, near, visible_noise, min_offset)
            for finding in sample.findings():
                found.setdefault(own.start + finding.taxel, replace(finding, taxel=own.start + finding.taxel))
    return tuple(found[taxel] for taxel in sorted(found))


class _PadSample:
    """One pad's sample. readings: (scans, taxels). places: (taxels, 2) in pitches. neighbours: (taxels, most
    neighbours), -1 where there is none.
    """

    def __init__(
        self,
        readings: Floats,
        noise: Floats,
        live: Bools,
        places: Floats,
        neighbours: NDArray[np.int64],
        visible_noise: float,
        min_offset: float,
    ) -> None:
        self._readings, self._noise, self._live = readings, noise, live
        self._places, self._neighbours = places, neighbours
        known = np.isfinite(readings)
        lowest = np.min(readings, axis=0, initial=np.inf, where=known)
        highest = np.max(readings, axis=0, initial=-np.inf, where=known)
        self._constant = live & (lowest == highest)
        self._rest = resting_level(readings, lowest)
        moving = live & ~self._constant
        self._noise_is_visible = bool(moving.any()) and float(np.median(noise[moving])) > visible_noise
        changes = float(np.median((np.diff(readings, axis=0) != 0).mean(axis=0)[live]))
        constant_share = float(self._constant[live].mean())
        self._never_constant = changes > EVIDENCE.max_constant_share and constant_share < EVIDENCE.max_constant_share
        rest = self._rest[live]
        self._usual_rest = float(np.median(rest))
        self._usual_noise = float(np.median(noise[live]))
        spread = max(robust_std(rest, self._usual_rest), self._usual_noise)
        self._allowed = np.maximum(EVIDENCE.outlier_sigmas * np.maximum(spread, noise), min_offset)
        self._outlier = live & (np.abs(self._rest - self._usual_rest) > self._allowed)

    def findings(self) -> Iterator[Finding]:
        """Findings, with taxels numbered within the pad; the first one of a taxel counts."""
        for taxel in np.flatnonzero(self._constant).tolist():
            yield from self._stuck(taxel)
        for taxel in np.flatnonzero(self._live & ~self._constant & ~self._outlier).tolist():
            yield from self._gain(taxel)  # before noise: what reads too much has more of it as well
        yield from self._noisy()
        for taxel in np.flatnonzero(self._outlier & ~self._constant).tolist():
            yield from self._offset(taxel)

    def _stuck(self, taxel: int) -> Iterator[Finding]:
        level = float(self._rest[taxel])
        scans, least, _ = self._loaded_neighbours(taxel)
        alone = self._outlier[taxel] and self._noise_is_visible and not self._beside_outlier(taxel)
        if len(scans) >= EVIDENCE.min_loaded_scans:
            yield Finding(taxel, "stuck", level, _ratio(level, float(np.median(least))), len(scans))
        elif self._never_constant or alone:
            yield Finding(taxel, "stuck", level, _ratio(level, self._usual_rest), len(self._readings))

    def _noisy(self) -> Iterator[Finding]:
        moving = self._live & ~self._constant
        if moving.sum() < 3:  # no median of others
            return
        usual = float(np.median(self._noise[moving]))
        for taxel in np.flatnonzero(moving & (self._noise > EVIDENCE.noise_ratio * usual)).tolist():
            near, noise = self._near(taxel), float(self._noise[taxel])
            if noise > EVIDENCE.neighbour_noise_ratio * self._noise[near].max(initial=0.0):
                yield Finding(taxel, "noisy", noise, _ratio(noise, usual), len(self._readings))

    def _offset(self, taxel: int) -> Iterator[Finding]:
        scans = self._others_at_rest(taxel)
        if len(scans):
            level = float(np.nanmedian(self._readings[scans, taxel]))
            if abs(level - self._usual_rest) <= self._allowed[taxel]:  # it was loaded in nine of ten scans
                return
            yield Finding(taxel, "offset", level, _ratio(level, self._usual_rest), len(scans))

    def _gain(self, taxel: int) -> Iterator[Finding]:
        """A hole or a spike among loaded neighbours that stays while the load moves."""
        scans, least, most = self._loaded_neighbours(taxel)
        own = self._readings[scans, taxel] - self._rest[taxel]
        if len(own) < EVIDENCE.min_loaded_scans:
            return
        if (
            max((own * EVIDENCE.gain_ratio < least).mean(), (own > EVIDENCE.gain_ratio * most).mean())
            < EVIDENCE.min_gain_share
        ):
            return
        if self._moves(scans, taxel):
            factor = float(np.nanmedian(own / (0.5 * (least + most))))
            yield Finding(taxel, "gain", factor, factor, len(scans))

    def _moves(self, scans: NDArray[np.int64], taxel: int) -> bool:
        """Whether the load of the other taxels moves from scan to scan: a hole of an object would go along."""
        others = np.where(np.isfinite(self._readings[scans]), self._readings[scans] - self._rest, -np.inf)
        others[:, taxel] = -np.inf
        first, second = np.sort(np.partition(others, -2, axis=1)[:, -2:], axis=1).T[::-1]
        clear = first - second > EVIDENCE.load_sigmas * self._usual_noise
        if len(np.unique(np.argmax(others[clear], axis=1))) >= EVIDENCE.min_peak_places:
            return True
        load = np.where(others > EVIDENCE.load_sigmas * self._usual_noise, others, 0.0)
        centre = load @ self._places / load.sum(axis=1, keepdims=True)
        return bool(np.ptp(centre, axis=0).max() >= EVIDENCE.min_travel)

    def _near(self, taxel: int) -> NDArray[np.int64]:
        row = self._neighbours[taxel]
        near: NDArray[np.int64] = row[row >= 0]
        return near

    def _beside_outlier(self, taxel: int) -> bool:
        """Whether a neighbour is an outlier as well: then both may be a contact."""
        return bool(self._outlier[self._near(taxel)].any())

    def _loaded_neighbours(self, taxel: int) -> tuple[NDArray[np.int64], Floats, Floats]:
        """Scans in which all its neighbours are loaded, and the least and the largest of their loads then."""
        near = self._near(taxel)
        if len(near) < EVIDENCE.min_neighbours or not self._live[near].all():
            return np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0)
        load = self._readings[:, near] - self._rest[near]
        least, most = load.min(axis=1), load.max(axis=1)
        scans = np.flatnonzero(least > EVIDENCE.load_sigmas * self._usual_noise)
        return scans, least[scans], most[scans]

    def _others_at_rest(self, taxel: int) -> NDArray[np.int64]:
        """Scans in which all other taxels rest; none unless there are scans in which some do not."""
        none = np.zeros(0, dtype=np.int64)
        others = self._live & ~self._outlier
        others[taxel] = False
        if self._beside_outlier(taxel) or others.sum() < 2:  # too few to compare with
            return none
        with np.errstate(invalid="ignore"):
            load = self._readings[:, others] - self._rest[others]
            loaded = (load > EVIDENCE.load_sigmas * self._noise[others]).any(axis=1)
        at_rest = np.flatnonzero(~loaded)
        return (
            at_rest if len(at_rest) >= EVIDENCE.min_loaded_scans and loaded.sum() >= EVIDENCE.min_loaded_scans else none
        )


def _neighbours(layout: Layout, pad: int) -> NDArray[np.int64]:
    """(taxels, most neighbours) of a pad, numbered within it, -1 where there is none."""
    own = layout.of_pad(pad)
    near: list[list[int]] = [[] for _ in range(own.stop - own.start)]
    for one, other in layout.neighbours(pad).tolist():
        near[one].append(other)
        near[other].append(one)
    most = max(map(len, near), default=0)
    return np.array([[*some, *[-1] * (most - len(some))] for some in near], dtype=np.int64).reshape(len(near), most)


def resting_level(readings: Floats, lowest: Floats) -> Floats:
    """(taxels,) where a taxel rests: at the lowest decile of its readings."""
    some = readings[:: 1 + len(readings) // EVIDENCE.max_rest_scans]
    ranked = np.sort(np.where(np.isfinite(some), some, np.inf), axis=0)
    place = np.isfinite(some).sum(axis=0) // EVIDENCE.rest_divisor
    rest: Floats = ranked[place, np.arange(readings.shape[1])]
    return np.where(np.isfinite(rest), rest, lowest)


def _ratio(value: float, usual: float) -> float | None:
    return value / usual if usual else None
