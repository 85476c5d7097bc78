"""Detection of duplicate scans.

Loggers that run faster than their sensor write its last scan again, bit for bit, under a new stamp. An idle sensor that
clips to its lowest value repeats itself too, and so does a still contact under a coarse converter. A repeated scan is
dropped only on evidence from its loaded readings, of either kind:

- Noise. A reading of pure noise reverses (rises, then falls, or the opposite) in 2 of 3 scans, a smooth one hardly
  ever. If a share s of new readings equals the last one, it reverses in about 2/3 (1 - s)^2. So the reversals of a
  taxel, counted over scans that differ, bound the probability that a new reading equals the last.
- Periodicity. If runs of equal scans have lengths that add up as evenly as clocks do, each of them repeats one scan.

Without evidence the scan is kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.condition.gaps import judge_new_step, judge_stamp
from taxelflow.condition.stream_state import RUNS, StreamState, TaxelHistory
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.records import Records, record, records
from taxelflow.numerics.ring import at, put
from taxelflow.runtime.compiling import kernel, routine
from taxelflow.runtime.settled import Settled

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray


class _Reversals(NamedTuple):
    """Evidence from the noise: readings that reverse."""

    probability: float = 1e-3
    """A repeated scan is dropped if a new one would be equal with at most this probability."""
    least_rate: float = 0.25
    """A taxel that reverses in a smaller share of its scans may be quiet because its load is smooth: it is no
    evidence."""
    of_taxel: float = 0.05
    """Evidence of one taxel is worth no more than this: its reversal rate is an estimate."""
    prior_scans: float = 4.0
    """Scans without a reversal that each taxel is credited with in advance."""


_REVERSALS = _Reversals()


class _Periodic(NamedTuple):
    """Evidence from the lengths of runs of equal scans."""

    mean: float = 1.5
    """A logger repeats scans if runs are on average this long, scans;"""
    deviation: float = 2.0
    """... and the sum of any number of runs deviates from its mean by at most this many scans: two clocks do that."""


_PERIODIC = _Periodic()
MIN_LOADED_TAXELS = 3
"""Loaded taxels that a scan must have for its run to count."""


@dataclass(frozen=True, slots=True, eq=False)
class NewScans:
    """New scans. t_s: (scans,). values: (scans, taxels). gap: (scans,), time was lost before this one. shear: (scans,
    taxels, 2), or None.
    """

    t_s: Floats
    values: Floats
    gap: Bools
    shear: Floats | None = None

    def split(self, count: int) -> tuple[NewScans, NewScans | None]:
        """The first `count` scans, and the others if there are any, as views."""
        if count == len(self.t_s):
            return self, None
        return self._part(slice(count)), self._part(slice(count, None))

    def _part(self, scans: slice) -> NewScans:
        shear = None if self.shear is None else self.shear[scans]
        return NewScans(self.t_s[scans], self.values[scans], self.gap[scans], shear)

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


class Deduplicator:
    """Drops duplicate scans and marks gaps, scan by scan."""

    def __init__(self, taxels: int, ceiling: Floats, *, drop: bool, kernel: Callable[..., int] | None = None) -> None:
        """ceiling: (taxels,), a reading at or above it is no evidence. drop: False keeps duplicates. kernel: another
        than `deduplicate`.
        """
        self._ceiling, self._drop, self._deduplicate = ceiling, drop, kernel or Settled(deduplicate)
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

    def step(self, t_s: Floats, values: Floats, shear: Floats | None = None) -> NewScans:
        """Scans (scans, taxels) in time order -> the new ones among them. shear: (scans, taxels, 2) goes along."""
        keep = np.ones(len(t_s), dtype=np.bool_)
        gap = np.zeros(len(t_s), dtype=np.bool_)
        new = self._deduplicate(t_s, values, self._ceiling, self._drop, self._histories, self._streams, keep, gap)
        if new == len(t_s):
            return NewScans(t_s, values, gap, shear)
        return NewScans(t_s[keep], values[keep], gap[keep], None if shear is None else shear[keep])


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
            judge_stamp(t[scan] - stream.last_stamp_s, stream)
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
            judge_new_step(t[scan] - stream.last_kept_s, stream)
        gap[scan] = stream.gap_pending
        stream.last_stamp_s = stream.last_kept_s = t[scan]
        stream.gap_pending, stream.dropped_since_kept, stream.kept_is_evidence = False, 0, evidence
        if not repeats:
            end_run(stream, gap[scan])
            stream.run_is_loaded = _update(values[scan], ceiling, histories) >= MIN_LOADED_TAXELS
    return new


@routine
def _equals_last(values: Floats, histories: Records) -> bool:
    """Whether all readings equal the last ones; a missing one equals a missing one."""
    for k in range(len(values)):
        last = histories[k].value
        if values[k] != last and not (np.isnan(values[k]) and np.isnan(last)):
            return False
    return True


@routine
def end_run(stream: StreamState, gap: bool) -> None:
    """A new scan: note the length of the last run, if it was loaded, and test the runs for periodicity."""
    if stream.run_is_loaded and not gap:
        put(stream.recent_runs, stream.runs, stream.run_scans)
        stream.runs += 1
        stream.periodic = stream.periodic or (stream.runs >= RUNS and _is_periodic(stream))
    stream.run_scans = 0


@routine
def _is_periodic(stream: StreamState) -> bool:
    total = deviation = largest = 0.0
    for k in range(RUNS):
        total += stream.recent_runs[k]
    mean = total / RUNS
    if mean < _PERIODIC.mean:
        return False
    for k in range(RUNS):
        deviation += at(stream.recent_runs, stream.runs + k) - mean
        largest = max(largest, abs(deviation))
    return bool(largest <= _PERIODIC.deviation)


@routine
def _is_evidence(values: Floats, ceiling: Floats, histories: Records, stream: StreamState) -> bool:
    """Whether this scan, if it is equal to the last one, cannot be a new one."""
    loaded = False
    for k in range(len(values)):
        loaded = loaded or histories[k].lowest < values[k] < ceiling[k]
    return loaded and (stream.periodic or _repeat_probability(values, ceiling, histories) < _REVERSALS.probability)


def is_recognised(reversals: NDArray[np.int64], judged_scans: NDArray[np.int64]) -> bool:
    """As `_repeat_probability` of loaded taxels (taxels,), below the threshold."""
    rates = reversals / (judged_scans + _REVERSALS.prior_scans)
    rates = rates[rates >= _REVERSALS.least_rate]
    chance = np.maximum(1.0 - np.sqrt(1.5 * rates), _REVERSALS.of_taxel)
    return bool(np.multiply.reduce(chance) < _REVERSALS.probability)


@routine
def _repeat_probability(values: Floats, ceiling: Floats, histories: Records) -> float:
    """Probability that a new scan equals the last one, by its loaded taxels; not exact below the threshold."""
    probability = 1.0
    for k in range(len(values)):
        taxel: TaxelHistory = histories[k]
        if not taxel.lowest < values[k] < ceiling[k]:
            continue
        reversal_rate = taxel.reversals / (taxel.judged_scans + _REVERSALS.prior_scans)
        if reversal_rate >= _REVERSALS.least_rate:
            probability *= max(1.0 - np.sqrt(1.5 * reversal_rate), _REVERSALS.of_taxel)
            if probability < _REVERSALS.probability:
                break
    return probability


@routine
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
