"""Detection of duplicate scans and of gaps in time.

Loggers that run faster than their sensor write its last scan again, bit for bit, under a new stamp. An idle sensor that
clips to its lowest value repeats itself too, and so does a still contact under a coarse converter. A repeated scan is
dropped only on evidence from its loaded readings, of either kind:

- Noise. A reading of pure noise reverses (rises, then falls, or the opposite) in 2 of 3 scans, a smooth one hardly
  ever. If a share s of new readings equals the last one, it reverses in about 2/3 (1 - s)^2. So the reversals of a
  taxel, counted over scans that differ, bound the probability that a new reading equals the last.
- Periodicity. If runs of equal scans have lengths that add up as evenly as clocks do, each of them repeats one scan.

Without evidence the scan is kept. A gap is a time step far above the usual one: the median of the steps before it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.records import Records, record, records

GAP_RATIO = 3.0
"""A time step longer than this many usual ones is a gap: 3 lost scans are one, jitter and a single lost scan are not.
"""
_STEPS = 15
"""Time steps whose median is the usual one."""
_MIN_STEPS = 3
"""Fewer steps have no usual one."""

_MAX_REPEAT_PROBABILITY = 1e-3
"""A repeated scan is dropped if a new one would be equal with at most this probability."""
_MIN_REVERSAL_RATE = 0.25
"""A taxel that reverses in a smaller share of its scans may be quiet because its load is smooth: it is no evidence."""
_MIN_TAXEL_PROBABILITY = 0.05
"""Evidence of one taxel is worth no more than this: its reversal rate is an estimate."""
_PRIOR_SCANS = 4.0
"""Scans without a reversal that each taxel is credited with in advance."""

_RUNS = 48
"""Consecutive runs of equal scans that are tested for periodicity."""
_MIN_MEAN_RUN = 1.5
"""A logger repeats scans if runs are on average this long, scans;"""
_MAX_RUN_DEVIATION = 2.0
"""... and the sum of any number of runs deviates from its mean by at most this many scans: two clocks do that."""
_MIN_LOADED_TAXELS = 3
"""Loaded taxels that a scan must have for its run to count."""


@dataclass(frozen=True, slots=True, eq=False)
class NewScans:
    """New scans. t_s: (scans,). values: (scans, taxels). gap: (scans,), time was lost before this one."""

    t_s: Floats
    values: Floats
    gap: Bools

    def part(self, start: int, stop: int) -> NewScans:
        """Scans `start` to `stop` (excluded), as views."""
        return NewScans(self.t_s[start:stop], self.values[start:stop], self.gap[start:stop])

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(frozen=True, slots=True)
class Counts:
    """repeated: scans dropped. longest_gap_s: 0 if there was none. step_s, step_std_s: mean and standard deviation of
    the steps from stamp to stamp, gaps left out. usual_s: mean step from one new scan to the next; all NaN if unknown.
    """

    repeated: int
    gaps: int
    longest_gap_s: float
    step_s: float
    step_std_s: float
    usual_s: float


class TaxelHistory:
    """Readings of one taxel: the lowest of all, the last one, and the step that led to it.

    loaded_scans: consecutive differing scans in which it was loaded, at most 2. reversals: of the steps, among
    judged_scans: scans in which there could have been one.
    """

    lowest: float
    value: float
    step: float
    loaded_scans: int
    reversals: int
    judged_scans: int


class StreamState:
    """State of a stream.

    last_stamp_s, last_kept_s: time of the last scan, and of the last one kept; NaN before the first. gap_pending: time
    was lost since the last scan kept. dropped_since_kept: scans. kept_is_evidence: a repetition of the last scan kept
    would be recognised. repeats_seen: any scan has been dropped.
    dropped, gaps, longest_gap_s: totals. steps, step_mean_s, step_squares_s2: number, mean, and sum of squared
    deviations of the steps from stamp to stamp. new_steps, new_steps_s: number and sum of the steps between scans whose
    repetition would be recognised.
    run_scans, run_is_loaded: length of the current run of equal scans, less 1, and whether it counts. periodic: runs
    are.
    recent_steps_s, recent_new_steps_s, recent_runs: ring buffers, of which stamps, new_stamps and runs entries have
    been written in all.
    """

    last_stamp_s: float
    last_kept_s: float
    gap_pending: bool
    dropped_since_kept: int
    kept_is_evidence: bool
    repeats_seen: bool
    dropped: int
    gaps: int
    longest_gap_s: float
    steps: int
    step_mean_s: float
    step_squares_s2: float
    new_steps: int
    new_steps_s: float
    run_scans: int
    run_is_loaded: bool
    periodic: bool
    stamps: int
    new_stamps: int
    runs: int
    recent_steps_s: Annotated[Floats, _STEPS]
    recent_new_steps_s: Annotated[Floats, _STEPS]
    recent_runs: Annotated[Floats, _RUNS]


class Deduplicator:
    """Drops duplicate scans and marks gaps, scan by scan."""

    def __init__(self, taxels: int, ceiling: Floats, *, drop: bool) -> None:
        """ceiling: (taxels,), a reading at or above it is no evidence. drop: False keeps duplicates."""
        self._ceiling, self._drop = ceiling, drop
        self._histories = records(TaxelHistory, taxels)
        self._histories["lowest"] = np.inf
        self._streams = records(StreamState, 1)
        self._stream = record(StreamState, self._streams)
        self.restart()

    def restart(self) -> None:
        """Read the same recording from its start; what is known of its taxels stays."""
        repeats_seen, periodic = self._stream.repeats_seen, self._stream.periodic
        self._streams[:] = records(StreamState, 1)
        self._stream.last_stamp_s = self._stream.last_kept_s = np.nan
        self._stream.repeats_seen, self._stream.periodic = repeats_seen, periodic
        self._histories["loaded_scans"] = 0

    @property
    def counts(self) -> Counts:
        """Duplicates and gaps since the start."""
        s = self._stream
        mean = float(s.step_mean_s) if s.steps else float("nan")
        return Counts(
            repeated=int(s.dropped),
            gaps=int(s.gaps),
            longest_gap_s=float(s.longest_gap_s),
            step_s=mean,
            step_std_s=float(np.sqrt(s.step_squares_s2 / s.steps)) if s.steps else float("nan"),
            usual_s=float(s.new_steps_s / s.new_steps) if s.new_steps else mean,
        )

    def step(self, t_s: Floats, values: Floats) -> NewScans:
        """Scans (scans, taxels) in time order -> the new ones among them."""
        keep = np.ones(len(t_s), dtype=np.bool_)
        gap = np.zeros(len(t_s), dtype=np.bool_)
        new = deduplicate(t_s, values, self._ceiling, self._drop, self._histories, self._streams, keep, gap)
        if new == len(t_s):
            return NewScans(t_s, values, gap)
        return NewScans(t_s[keep], values[keep], gap[keep])


@kernel
def deduplicate(
    t: Floats,
    values: Floats,
    ceiling: Floats,
    drop: bool,
    histories: Records,
    streams: Records,
    keep: Bools,
    gap: Bools,
) -> int:
    """Clear keep (scans,) where a scan repeats the last one, set gap (scans,), and bring the records up to date.

    Returns how many scans are new. histories: `TaxelHistory` (taxels,). streams: `StreamState` (1,).
    """
    stream: StreamState = streams[0]
    new = len(t)
    for scan in range(len(t)):
        repeats = False
        if not np.isnan(stream.last_stamp_s):
            _judge_stamp(t[scan] - stream.last_stamp_s, stream)
            repeats = _equals_last(values[scan], histories)
            stream.run_scans += 1
            if drop and repeats and _is_evidence(values[scan], ceiling, histories, stream):
                stream.last_stamp_s = t[scan]
                stream.dropped_since_kept += 1
                stream.dropped += 1
                stream.repeats_seen = True
                keep[scan] = False
                new -= 1
                continue
        evidence = stream.repeats_seen and _is_evidence(values[scan], ceiling, histories, stream)
        if evidence and stream.kept_is_evidence:
            _judge_new_step(t[scan] - stream.last_kept_s, stream)
        gap[scan] = stream.gap_pending
        stream.last_stamp_s = stream.last_kept_s = t[scan]
        stream.gap_pending, stream.dropped_since_kept, stream.kept_is_evidence = False, 0, evidence
        if not repeats:
            _end_run(stream, gap[scan])
            stream.run_is_loaded = _update(values[scan], ceiling, histories) >= _MIN_LOADED_TAXELS
    return new


@kernel
def _judge_stamp(step_s: float, stream: StreamState) -> None:
    """Recognise a gap between stamps; mean and variance of the other steps (Welford's algorithm)."""
    if step_s > GAP_RATIO * _median(stream.recent_steps_s, stream.stamps):
        _add_gap(step_s, stream)
    else:
        stream.steps += 1
        deviation = step_s - stream.step_mean_s
        stream.step_mean_s += deviation / stream.steps
        stream.step_squares_s2 += deviation * (step_s - stream.step_mean_s)
    stream.recent_steps_s[stream.stamps % _STEPS] = step_s
    stream.stamps += 1


@kernel
def _judge_new_step(step_s: float, stream: StreamState) -> None:
    """Recognise a sensor that hung while its logger went on. Both scans of the step are evidence."""
    hung = step_s > GAP_RATIO * _median(stream.recent_new_steps_s, stream.new_stamps)
    if hung and stream.dropped_since_kept > 0 and not stream.gap_pending:
        _add_gap(step_s, stream)
    stream.recent_new_steps_s[stream.new_stamps % _STEPS] = step_s
    stream.new_stamps += 1
    if not stream.gap_pending:
        stream.new_steps_s += step_s
        stream.new_steps += 1


@kernel
def _add_gap(step_s: float, stream: StreamState) -> None:
    stream.gap_pending = True
    stream.gaps += 1
    stream.longest_gap_s = max(stream.longest_gap_s, step_s)


@kernel
def _median(ring: Floats, written: int) -> float:
    """Median of the recent steps; infinite while there are too few."""
    if written < _MIN_STEPS:
        return np.inf
    return float(np.median(ring[: min(written, _STEPS)]))


@kernel
def _equals_last(values: Floats, histories: Records) -> bool:
    """Whether all readings equal the last ones; a missing one equals a missing one."""
    for k in range(len(values)):
        last = histories[k].value
        if values[k] != last and not (np.isnan(values[k]) and np.isnan(last)):
            return False
    return True


@kernel
def _end_run(stream: StreamState, gap: bool) -> None:
    """A new scan: note the length of the last run, if it was loaded, and test the runs for periodicity."""
    if stream.run_is_loaded and not gap:
        stream.recent_runs[stream.runs % _RUNS] = stream.run_scans
        stream.runs += 1
        stream.periodic = stream.periodic or (stream.runs >= _RUNS and _is_periodic(stream))
    stream.run_scans = 0


@kernel
def _is_periodic(stream: StreamState) -> bool:
    mean = stream.recent_runs.mean()
    deviation = largest = 0.0
    for k in range(_RUNS):
        deviation += stream.recent_runs[(stream.runs + k) % _RUNS] - mean
        largest = max(largest, abs(deviation))
    return bool(mean >= _MIN_MEAN_RUN and largest <= _MAX_RUN_DEVIATION)


@kernel
def _is_evidence(values: Floats, ceiling: Floats, histories: Records, stream: StreamState) -> bool:
    """Whether this scan, if it is equal to the last one, cannot be a new one."""
    loaded = False
    for k in range(len(values)):
        loaded = loaded or histories[k].lowest < values[k] < ceiling[k]
    return loaded and (stream.periodic or _repeat_probability(values, ceiling, histories) < _MAX_REPEAT_PROBABILITY)


@kernel
def _repeat_probability(values: Floats, ceiling: Floats, histories: Records) -> float:
    """Probability that a new scan equals the last one, by its loaded taxels; not exact below the threshold."""
    probability = 1.0
    for k in range(len(values)):
        taxel: TaxelHistory = histories[k]
        if not taxel.lowest < values[k] < ceiling[k]:
            continue
        reversal_rate = taxel.reversals / (taxel.judged_scans + _PRIOR_SCANS)
        if reversal_rate >= _MIN_REVERSAL_RATE:
            probability *= max(1.0 - np.sqrt(1.5 * reversal_rate), _MIN_TAXEL_PROBABILITY)
            if probability < _MAX_REPEAT_PROBABILITY:
                break
    return probability


@kernel
def _update(values: Floats, ceiling: Floats, histories: Records) -> int:
    """Count the reversals of loaded taxels in a scan that differs from the last one. Returns how many are loaded."""
    loaded_taxels = 0
    for k in range(len(values)):  # without branches, which noise would make unpredictable
        taxel: TaxelHistory = histories[k]
        value = values[k]
        loaded = taxel.lowest < value < ceiling[k]
        step = value - taxel.value
        judged = loaded and taxel.loaded_scans >= 2
        taxel.judged_scans += judged
        taxel.reversals += judged and step * taxel.step < 0.0
        taxel.step = step
        taxel.loaded_scans = min(taxel.loaded_scans + 1, 2) if loaded else 0
        taxel.lowest = np.fmin(taxel.lowest, value)  # ignores a missing reading
        taxel.value = value
        loaded_taxels += loaded
    return loaded_taxels
