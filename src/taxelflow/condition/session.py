"""A running conditioner: new scans only, in SI units, filtered, tared, with noise, missing taxels, gaps and contact."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.condition.baseline import Baseline, estimate_baseline, with_masked
from taxelflow.condition.blocks import Blockwise, condition_block, deduplicate_block
from taxelflow.condition.contact import Conditioned, Zeroed, condition, pad_contacts
from taxelflow.condition.deduplicate import Counts, Deduplicator, NewScans, deduplicate
from taxelflow.condition.held_load import FallWatch, withdrawn_note
from taxelflow.condition.relearning import Relearning
from taxelflow.condition.sample import Sample
from taxelflow.condition.shear import ShearTare
from taxelflow.condition.units import SATURATED_SHARE, full_scale, in_si
from taxelflow.condition.unloaded import falls_under_load, no_contact
from taxelflow.errors import RecordingError
from taxelflow.messages import Bools, Floats, RawScans, Scans, joined
from taxelflow.runtime.settled import Settled

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from taxelflow.condition.base import ConditionSettings
    from taxelflow.condition.drift import DriftTracker
    from taxelflow.condition.filters import Filters
    from taxelflow.runtime.adoption import Adopting
    from taxelflow.sensors.sensor import Sensor


class ConditionSession:
    """Conditions scan after scan.

    baseline: what is known of the sensor so far. lookahead_counts: duplicates and gaps of the first pass over a
    recording, which drops fewer duplicates than the second one: it collects the evidence while it reads.
    """

    def __init__(
        self, parameters: ConditionSettings, sensor: Sensor, masked: Bools, lookahead: Iterable[RawScans] | None
    ) -> None:
        self._parameters, self._sensor, self._layout = parameters, sensor, sensor.layout
        self._masked = with_masked(masked, parameters.off)
        self._ceiling = SATURATED_SHARE * full_scale(sensor)
        self._causal = lookahead is None
        drop = parameters.repeats == "drop"
        passes = None if self._causal else Blockwise(deduplicate_block, deduplicate)
        self._deduplicator = Deduplicator(self._layout.taxels, self._ceiling, drop=drop, kernel=passes)
        self._fill: Callable[..., None] = Settled(condition) if self._causal else Blockwise(condition_block, condition)
        self.sample = Sample(self._layout.taxels, forgets=self._causal)
        self._relearning = Relearning(parameters, sensor, self._adopt)
        self._held: list[NewScans] = []
        self._pads = pad_contacts(self._layout, parameters)
        self._last = np.zeros(self._layout.entries)
        self._changed: Bools | None = None
        self._filters: Filters | None = None
        self._shear = ShearTare(sensor, tared=parameters.tare != "none")
        self._watch = FallWatch() if parameters.tare == "auto" and parameters.drift == "keep" else None
        self._withdrawn_s: dict[str, float] = {}
        self._newest_s = float("nan")
        self._drift: DriftTracker | None = None
        if parameters.drift == "follow":
            from taxelflow.condition.drift import DriftTracker

            self._drift = DriftTracker(self._layout)
        self.baseline: Baseline | None = None
        self._entry_offset = self._entry_noise = self._entry_ceiling = np.zeros(0)
        self.lookahead_counts: Counts | None = None
        if lookahead is not None:
            self._look_ahead(lookahead)

    def _look_ahead(self, blocks: Iterable[RawScans]) -> None:
        with suppress(RecordingError):  # the second pass meets the same damage, after the scans before it
            for raw in blocks:
                new = self._deduplicator.step(raw.t_s, in_si(raw.values, self._sensor))
                self.sample.add(new.t_s, new.values)
        self.sample.close()
        self.lookahead_counts = self._deduplicator.counts
        self._deduplicator.restart()
        self._estimate_baseline(self.lookahead_counts.usual_s)

    def adopt_by(self, adopting: Adopting) -> None:
        """Use what is learned again when this is true; at once where drift is followed, which changes the offsets."""
        if self._drift is None:
            self._relearning = Relearning(self._parameters, self._sensor, self._adopt, adopting)

    @property
    def counts(self) -> Counts:
        """Duplicates and gaps so far, lookahead left out."""
        return self._deduplicator.counts

    @property
    def lag_s(self) -> float:
        """How much older than its scan a pressure is, by the filters alone."""
        return self._filters.lag_s if self._filters else 0.0

    def step(self, raw: RawScans) -> Iterator[Scans]:
        """Conditioned scans, all that are ready, in blocks of one noise model each."""
        shear = None if raw.shear is None else in_si(raw.shear, self._sensor)
        new = self._deduplicator.step(raw.t_s, in_si(raw.values, self._sensor), shear)
        if not self._causal:
            yield from self._condition(new)
            return
        rest: NewScans | None = new
        while rest:
            count = min(len(rest), self.sample.until_doubled)
            due_s = self._relearning.due_s
            if due_s < np.inf:
                count = min(count, int(np.searchsorted(rest.t_s, due_s)))
                if not count:
                    self._relearning.adopt(float(rest.t_s[0]))
                    continue
            count, fell = self._until_fall(rest.values[:count])
            piece, rest = rest.split(count)
            full, seen = self.sample.until_doubled == count, self.sample.windows_seen
            self.sample.add(piece.t_s, piece.values)
            self._newest_s = float(piece.t_s[-1])
            full = full and self.sample.windows_seen > seen
            if self.baseline is None:
                self._held.append(piece)
                if full:
                    yield from self.finish()
                continue
            yield from self._condition(piece)
            if (full or fell) and self._relearning.free:  # after 2, 4, 8, ... windows: bounded work
                now_s = float(piece.t_s[-1])
                if fell:
                    self.sample.restart()
                self._relearning.adopt(now_s)
                self._relearning.begin(self.sample, self.baseline, now_s)
                if self._drift:  # it changes the offsets meanwhile
                    self._relearning.adopt(now_s)

    def _until_fall(self, values: Floats) -> tuple[int, bool]:
        """Scans (scans, taxels) until a window ends whose readings fall below the offsets, or all. Whether one does."""
        count = len(values)
        learned = self.baseline
        if self._watch is None or learned is None or count < self.sample.remaining:
            return count, False
        windows, open_scans = self.sample.completed(values)
        found = self._watch.find(windows, learned.offset, learned.noise, learned.known & ~learned.masked)
        if found is None:
            return count, False
        return (found + 1) * windows.shape[1] - open_scans, True

    def finish(self) -> Iterator[Scans]:
        """The first scans of a stream, if it ended before there were enough for a baseline."""
        if self._held:
            self.sample.close()
            held, self._held = joined(self._held), []
            self._estimate_baseline(float(np.median(np.diff(held.t_s))) if len(held) > 1 else float("nan"))
            yield from self._condition(held)

    def likely_faults(self, *, touched: bool) -> list[str]:
        """Notes on what is likely wrong with the sensor's description. touched: whether any pad was in contact."""
        learned, windows = self.baseline, self.sample.windows
        if learned is None or not windows.size:
            return []
        falls = falls_under_load(windows, learned, self._sensor.polarity)
        without = [] if touched else [no_contact(windows, learned, self._sensor, self._parameters.contact_on)]
        return [note for note in (*without, falls, withdrawn_note(self._withdrawn_s)) if note]

    def sampled(self) -> Iterator[Scans]:
        """The windows of the sample and its tail, tared, with contact, each at the time of its first scan.

        The state of the stream is unchanged.
        """
        state = self._pads, self._last
        self._pads, self._last = pad_contacts(self._layout, self._parameters), np.zeros_like(self._last)
        for start_s, window in (*zip(self.sample.starts_s, self.sample.windows, strict=True), self.sample.tail):
            values = window[np.isfinite(window).any(axis=1)]
            yield self._tare(NewScans(np.full(len(values), start_s), values, np.zeros(len(values), dtype=np.bool_)))
        self._pads, self._last = state

    def _estimate_baseline(self, usual_s: float) -> None:
        """Estimate the baseline from the sample. usual_s: time from one new scan to the next, NaN if unknown."""
        parameters = self._parameters
        baseline = estimate_baseline(parameters, self._sensor, self.sample, self._masked, causal=self._causal)
        if (parameters.lowpass_hz or parameters.median_scans > 1) and usual_s > 0:
            from taxelflow.condition.filters import Filters

            limits = parameters.lowpass_hz, parameters.median_scans, usual_s
            self._filters = Filters(self._layout.taxels, *limits)
            self._shear.filters = Filters(2 * self._layout.taxels, *limits) if self._sensor.shear else None
        self._set_baseline(baseline)

    def _adopt(self, baseline: Baseline) -> None:
        """Use what has been learned again."""
        before = self.baseline
        if before is None:
            return
        changed = (baseline.masked & ~before.masked) | (baseline.offset != before.offset)
        if changed.any():
            self._changed = np.logical_or.reduceat(changed[self._layout.source], self._layout.starts[:-1])
        for pad in np.flatnonzero(baseline.withdrawn & ~before.withdrawn):
            self._withdrawn_s[self._layout.pads[pad]] = self._newest_s
        if self._drift and baseline.offset is not before.offset:
            self._drift.restart(baseline)
        self._set_baseline(baseline)

    def _set_baseline(self, baseline: Baseline) -> None:
        """Use this baseline from the next scan on, with offset, noise after the filters, and ceiling by entry."""
        before, self.baseline, source = self.baseline, baseline, self._layout.source
        if before is None or baseline.noise is not before.noise:
            self._entry_noise = baseline.noise[source] * (self._filters.noise_gain if self._filters else 1.0)
        if before is None or baseline.offset is not before.offset:
            self._entry_offset = baseline.offset[source]
            self._entry_ceiling = (self._ceiling - baseline.offset)[source]

    def _condition(self, new: NewScans) -> Iterator[Scans]:
        """Conditioned scans, cut where the offsets of idle pads are updated."""
        if self._filters and self.baseline:
            values = self._filters.step(new.values, new.gap, self.baseline.noise)
            new = replace(new, values=values)
        if self._drift is None:
            yield self._tare(new)
            return
        rest: NewScans | None = new
        while rest:
            piece, rest = rest.split(min(len(rest), self._drift.remaining))
            scans = self._tare(piece)
            yield scans
            if self.baseline is not None:
                self._set_baseline(self._drift.update(scans, piece.gap, self.baseline))

    def _tare(self, new: NewScans) -> Scans:
        if self.baseline is None:
            raise RuntimeError("a scan was conditioned before there was a baseline")
        layout, values = self._layout, new.values
        if layout.entries > layout.taxels:
            values = np.take(values, layout.source, axis=1)  # row by row, as all kernels are compiled for
        entries = Zeroed(self._entry_offset, self._entry_noise, self._last)
        contact = np.empty((len(new), len(layout.pads)), dtype=np.bool_)
        out = Conditioned(np.empty_like(values), contact, np.empty_like(contact))
        self._fill(values, new.gap, entries, self._pads, out)
        if self._changed is not None and len(new):
            out.complete[0, self._changed] = False  # a new mask or offset must not look like motion
            self._changed = None
        shear = None if new.shear is None else self._shear.step(new.shear, new.gap, contact, self._entry_noise)
        return Scans(new.t_s, out.pressure, self._entry_noise, self._entry_ceiling, contact, out.complete, shear)
