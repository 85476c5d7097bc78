"""A running conditioner: new scans only, in SI, filtered, tared, with noise, missing taxels, gaps and contact."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.condition.deduplicate import Counts, Sifted, Sifter
from taxelflow.condition.learn import Learned, learn, masked_too, relearn
from taxelflow.condition.sample import Sample
from taxelflow.condition.units import SATURATED, full_scale, in_si
from taxelflow.errors import RecordingError
from taxelflow.messages import Bools, Floats, RawScans, Scans

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from taxelflow.condition.drift import Drift
    from taxelflow.condition.filters import Filters
    from taxelflow.condition.parameters import Conditioner
    from taxelflow.sensors.sensor import Sensor


class Session:
    """Conditions scan after scan.

    learned: what it has found out so far. foreseen: repeats and gaps of the lookahead, which drops fewer repeats than
    the pass that follows, as it learns to tell them while it goes.
    """

    def __init__(
        self, parameters: Conditioner, sensor: Sensor, masked: Bools, lookahead: Iterable[RawScans] | None
    ) -> None:
        self._parameters, self._sensor, self._layout = parameters, sensor, sensor.layout
        self._masked = masked_too(masked, parameters.off)
        self._top = SATURATED * full_scale(sensor)
        self._sifter = Sifter(self._layout.taxels, self._top, drop=parameters.repeats == "drop")
        self.sample = Sample(self._layout.taxels)
        self._causal = lookahead is None
        self._held: list[Sifted] = []
        self._in_contact = np.zeros(len(self._layout.pads), dtype=np.bool_)
        self._last = np.zeros(self._layout.entries)
        self._changed: Bools | None = None
        self._known_noise = self._spread_noise = np.zeros(0)
        self._known_offset = self._tared_ceiling = np.zeros(0)
        self._filters: Filters | None = None
        self._drift: Drift | None = None
        if parameters.drift == "follow":
            from taxelflow.condition.drift import Drift

            self._drift = Drift(self._layout)
        self.learned: Learned | None = None
        self.foreseen: Counts | None = None
        if lookahead is not None:
            with suppress(RecordingError):  # the second pass meets the same damage, after the scans before it
                for raw in lookahead:
                    fresh = self._sifter.step(raw.t_s, in_si(raw.values, sensor))
                    self.sample.add(fresh.t_s, fresh.values)
            self.sample.close()
            self.foreseen = self._sifter.counts
            self._sifter.restart()
            self._learn(self.foreseen.usual_s)

    @property
    def counts(self) -> Counts:
        """Repeats and gaps so far, lookahead left out."""
        return self._sifter.counts

    @property
    def lag_s(self) -> float:
        """How much older than its scan a pressure is, from the filters alone."""
        return self._filters.lag_s if self._filters else 0.0

    def step(self, raw: RawScans) -> Iterator[Scans]:
        """Conditioned scans, all that are ready, in blocks of one noise model each."""
        fresh = self._sifter.step(raw.t_s, in_si(raw.values, self._sensor))
        if not self._causal:
            yield from self._condition(fresh)
            return
        while len(fresh):
            count = min(len(fresh), self.sample.wanted)
            piece, fresh = fresh.part(0, count), fresh.part(count, len(fresh))
            full = self.sample.wanted == count
            self.sample.add(piece.t_s, piece.values)
            if self.learned is None:
                self._held.append(piece)
                if full:
                    yield from self.finish()
                continue
            yield from self._condition(piece)
            if full and self.sample.seen.bit_count() == 1:  # after 2, 4, 8, ... windows: bounded work for ever
                self._relearn(self.learned)

    def finish(self) -> Iterator[Scans]:
        """What a stream still holds back: its first scans, if it ended before there were enough to learn from."""
        if self._held:
            self.sample.close()
            names = ("t_s", "values", "gap")
            held = Sifted(*(np.concatenate([getattr(piece, name) for piece in self._held]) for name in names))
            self._held = []
            self._learn(float(np.median(np.diff(held.t_s))) if len(held) > 1 else float("nan"))
            yield from self._condition(held)

    def sampled(self) -> Iterator[Scans]:
        """The windows of the sample and its tail, tared, with contact, each at the time of its first scan. The stream
        goes on as if this had not been asked for.
        """
        memory = self._in_contact, self._last
        self._in_contact, self._last = np.zeros_like(memory[0]), np.zeros_like(memory[1])
        for start_s, window in (*zip(self.sample.starts_s, self.sample.windows, strict=True), self.sample.tail):
            values = window[np.isfinite(window).any(axis=1)]
            yield self._tared(Sifted(np.full(len(values), start_s), values, np.zeros(len(values), dtype=np.bool_)))
        self._in_contact, self._last = memory

    def _learn(self, usual_s: float) -> None:
        """Learn from the sample. usual_s: time from one new scan to the next, NaN if unknown."""
        asked = self._parameters
        self.learned = learn(asked, self._sensor, self.sample, self._masked, causal=self._causal)
        if (asked.lowpass_hz or asked.median_scans > 1) and usual_s > 0:
            from taxelflow.condition.filters import Filters

            self._filters = Filters(self._layout.taxels, asked.lowpass_hz, asked.median_scans, usual_s)

    def _relearn(self, before: Learned) -> None:
        self.learned = relearn(self._parameters, self._sensor, self.sample, before)
        fewer = self.learned.masked & ~before.masked
        if fewer.any():
            self._changed = np.logical_or.reduceat(fewer[self._layout.source], self._layout.starts[:-1])

    def _entry_noise(self, noise: Floats) -> Floats:
        """(entries,) after the filters, one and the same array until the noise is learned anew."""
        if self._known_noise is not noise:
            self._known_noise = noise
            self._spread_noise = noise[self._layout.source] * (self._filters.noise_gain if self._filters else 1.0)
        return self._spread_noise

    def _ceiling(self, offset: Floats) -> Floats:
        """(entries,), where readings saturate, half a part in a thousand below full scale; tared like them."""
        if self._known_offset is not offset:
            self._known_offset = offset
            self._tared_ceiling = (self._top - offset)[self._layout.source]
        return self._tared_ceiling

    def _condition(self, fresh: Sifted) -> Iterator[Scans]:
        """Conditioned scans, cut where idle pads have followed their drift."""
        if self._filters and self.learned:
            values = self._filters.step(fresh.values, fresh.gap, self.learned.noise)
            fresh = replace(fresh, values=values)
        if self._drift is None:
            yield self._tared(fresh)
            return
        while len(fresh):
            count = min(len(fresh), self._drift.wanted)
            piece, fresh = fresh.part(0, count), fresh.part(count, len(fresh))
            scans = self._tared(piece)
            yield scans
            if self.learned is not None:
                self.learned = self._drift.take(scans, piece.gap, self.learned)

    def _tared(self, fresh: Sifted) -> Scans:
        if self.learned is None:
            raise RuntimeError("a scan was conditioned before anything was learned")
        layout, parameters = self._layout, self._parameters
        values, offset = fresh.values, self.learned.offset
        noise, ceiling = self._entry_noise(self.learned.noise), self._ceiling(offset)
        if layout.entries > layout.taxels:
            values = np.take(values, layout.source, axis=1)  # row by row, as all kernels are compiled for
            offset = offset[layout.source]
        pressure = np.empty_like(values)
        contact = np.empty((len(fresh), len(layout.pads)), dtype=np.bool_)
        complete = np.empty_like(contact)
        condition(
            values,
            fresh.gap,
            offset,
            noise,
            layout.starts,
            parameters.contact_on,
            parameters.contact_off,
            self._in_contact,
            self._last,
            pressure,
            contact,
            complete,
        )
        if self._changed is not None and len(fresh):
            complete[0, self._changed] = False  # a taxel that is masked from here on must not look like motion
            self._changed = None
        return Scans(fresh.t_s, pressure, noise, ceiling, contact, complete)


@kernel
def condition(
    values: Floats,
    gap: Bools,
    offset: Floats,
    noise: Floats,
    starts: NDArray[np.int64],
    on: float,
    off: float,
    in_contact: Bools,
    last: Floats,
    pressure: Floats,
    contact: Bools,
    complete: Bools,
) -> None:
    """Fill pressure (scans, taxels), contact and complete (scans, pads) from readings in SI.

    in_contact (pads,) and last (taxels,) are the memory from scan to scan. A masked taxel (noise 0) reads 0.
    A missing one (not finite) reads 0 as well; if its last reading was a load, the pad's scan is incomplete. So are all
    pads' where gap (scans,) is set.
    """
    for scan in range(values.shape[0]):
        for pad in range(len(starts) - 1):
            total = 0.0
            variance = 0.0
            peak = 0.0
            whole = not gap[scan]
            for taxel in range(starts[pad], starts[pad + 1]):
                reading = 0.0
                if noise[taxel] > 0.0:
                    reading = values[scan, taxel] - offset[taxel]
                    if np.isfinite(reading):
                        last[taxel] = reading
                        total += reading
                        variance += noise[taxel] ** 2 if reading != 0.0 else 0.0
                        peak = max(peak, reading / noise[taxel])
                    else:
                        reading = 0.0
                        whole = whole and last[taxel] <= off * noise[taxel]
                pressure[scan, taxel] = reading
            level = off if in_contact[pad] else on
            in_contact[pad] = peak > level and total > level * np.sqrt(variance)
            contact[scan, pad] = in_contact[pad]
            complete[scan, pad] = whole
