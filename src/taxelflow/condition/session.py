"""A running conditioner: unit conversion, tare, noise, missing taxels, contact."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.condition.noise import RANGE_FLOOR, learn_noise
from taxelflow.condition.sample import Sample
from taxelflow.condition.tare import learn_offset
from taxelflow.errors import RecordingError
from taxelflow.messages import Bools, Floats, RawScans, Scans, cut, joined

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from taxelflow.condition.conditioner import Conditioner
    from taxelflow.sensor import Sensor


_SATURATED = 0.9995


@dataclass(frozen=True, slots=True, eq=False)
class Learned:
    """What a session knows of its sensor, in SI units.

    offset, noise: (taxels,). tared: (pads,), groups left out. masked: (taxels,), declared off or never heard from.
    """

    offset: Floats
    noise: Floats
    tared: Bools
    masked: Bools


class Session:
    """Conditions scan after scan. `learned` is what it has found out so far."""

    def __init__(
        self, parameters: Conditioner, sensor: Sensor, masked: Bools, lookahead: Iterable[RawScans] | None
    ) -> None:
        self._parameters, self._sensor, self._layout = parameters, sensor, sensor.layout
        self._masked = masked
        self._sample = Sample(self._layout.taxels)
        self._causal = lookahead is None
        self._held: list[RawScans] = []
        self._in_contact = np.zeros(len(self._layout.pads), dtype=np.bool_)
        self._last = np.zeros(self._layout.entries)
        self._known_noise = self._spread_noise = np.zeros(0)
        self._known_offset = self._tared_ceiling = np.zeros(0)
        self.learned: Learned | None = None
        if lookahead is not None:
            with suppress(RecordingError):  # the second pass meets the same damage, after the scans before it
                for raw in lookahead:
                    self._sample.add(self._si(raw.values))
            self._sample.close()
            self.learned = self._learn()

    def step(self, raw: RawScans) -> Iterator[Scans]:
        """Conditioned scans, all that are ready, in blocks of one noise model each."""
        if not self._causal:
            yield self._condition(raw)
            return
        while len(raw):
            count = min(len(raw), self._sample.wanted)
            piece, raw = cut(raw, 0, count), cut(raw, count, len(raw))
            full = self._sample.wanted == count
            self._sample.add(self._si(piece.values))
            if self.learned is None:
                self._held.append(piece)
                if full:
                    yield from self.finish()
                continue
            yield self._condition(piece)
            if full and self._sample.seen.bit_count() == 1:  # after 2, 4, 8, ... windows: bounded work for ever
                self._relearn_noise()

    def finish(self) -> Iterator[Scans]:
        """What a stream still holds back: its first scans, if it ended before there were enough to learn from."""
        if self._held:
            self._sample.close()
            self.learned = self._learn()
            held, self._held = joined(self._held), []
            yield self._condition(held)

    def _si(self, values: Floats) -> Floats:
        """Readings in SI; what is not finite is missing."""
        with np.errstate(over="ignore"):
            si = values * self._sensor.to_si
        return np.where(np.isfinite(si), si, np.nan)

    def _noise(self, windows: Floats, masked: Bools) -> Floats:
        sensor = self._sensor
        largest = max(sensor.gain, default=1.0)
        step = sensor.to_si * largest if sensor.unit == "count" else 0.0  # a count is a whole number
        return learn_noise(windows, masked, step, RANGE_FLOOR * (sensor.full_scale or 0.0) * sensor.to_si)

    def _learn(self) -> Learned:
        layout, windows = self._layout, self._sample.windows
        silent = ~np.isfinite(windows).any(axis=(0, 1)) if len(windows) else np.zeros(layout.taxels, dtype=np.bool_)
        masked = self._masked | silent
        noise = self._noise(windows, masked)
        offset = np.zeros(layout.taxels)
        tared = np.zeros(layout.pad_count, dtype=np.bool_)
        reference = self._reference(windows)
        for pad in range(layout.pad_count):
            own = layout.of_pad(pad)
            found = self._offset(pad, noise[own], masked[own], reference)
            if found is not None:
                offset[own], tared[pad] = found, True
        return Learned(offset, noise, tared, masked)

    def _offset(self, pad: int, noise: Floats, masked: Bools, reference: float) -> Floats | None:
        own = self._layout.of_pad(pad)
        if self._parameters.tare == "none" or masked.all() or not len(self._sample.windows):
            return None
        if self._parameters.tare == "start":
            start = self._sample.first[:, own]
            heard = np.isfinite(start)
            count = np.maximum(heard.sum(axis=0), 1)
            mean: Floats = np.where(heard, start, 0.0).sum(axis=0) / count
            return mean
        return learn_offset(self._sample.windows[:, :, own], noise, masked, self._layout.neighbours(pad), reference)

    def _reference(self, windows: Floats) -> float:
        """What an offset must be small against: full scale, and, where the future is known, the largest reading."""
        full_scale = (self._sensor.full_scale or 0.0) * self._sensor.to_si
        if self._causal:
            return full_scale
        return max(full_scale, float(np.max(windows, initial=0.0, where=np.isfinite(windows))))

    def _relearn_noise(self) -> None:
        """Noise of a loaded taxel shows only under load, so it is learned again as scans go by; the tare stays."""
        if self.learned is not None:
            self.learned = replace(self.learned, noise=self._noise(self._sample.windows, self.learned.masked))

    def _noise_of_entries(self, noise: Floats) -> Floats:
        """(entries,), one and the same array until the noise is learned anew."""
        if self._known_noise is not noise:
            self._known_noise, self._spread_noise = noise, noise[self._layout.source]
        return self._spread_noise

    def _ceiling(self) -> Floats:
        """(entries,), where readings saturate, half a part in a thousand below full scale; tared like them."""
        if self.learned is not None and self._known_offset is not self.learned.offset:
            self._known_offset = self.learned.offset
            top = _SATURATED * (self._sensor.full_scale or np.inf) * self._sensor.to_si * self._sensor.wiring.gain
            self._tared_ceiling = (top - self.learned.offset)[self._layout.source]
        return self._tared_ceiling

    def _condition(self, raw: RawScans) -> Scans:
        if self.learned is None:
            raise RuntimeError("a scan was conditioned before anything was learned")
        layout, parameters = self._layout, self._parameters
        values, noise, offset = raw.values, self.learned.noise, self.learned.offset
        if layout.entries > layout.taxels:
            values, noise, offset = values[:, layout.source], self._noise_of_entries(noise), offset[layout.source]
        pressure = np.empty_like(values)
        contact = np.empty((len(raw), len(layout.pads)), dtype=np.bool_)
        complete = np.empty_like(contact)
        condition(
            values,
            self._sensor.to_si,
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
        return Scans(raw.t_s, pressure, noise, self._ceiling(), contact, complete)


@kernel
def condition(
    values: Floats,
    to_si: float,
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
    """Fill pressure (scans, taxels), contact and complete (scans, pads) from raw values.

    in_contact (pads,) and last (taxels,) are the memory from scan to scan. A masked taxel (noise 0) reads 0.
    A missing one (not finite) reads 0 as well; if its last reading was a load, the pad's scan is incomplete.
    """
    for scan in range(values.shape[0]):
        for pad in range(len(starts) - 1):
            total = 0.0
            variance = 0.0
            peak = 0.0
            whole = True
            for taxel in range(starts[pad], starts[pad + 1]):
                reading = 0.0
                if noise[taxel] > 0.0:
                    reading = values[scan, taxel] * to_si - offset[taxel]
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
