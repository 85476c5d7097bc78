"""What a scan is worth before it is used: a new one, or the last one again; in time, or after a gap.

Loggers that run faster than their sensor write its last scan again, bit for bit, under a new stamp. An idle sensor that
clips to its lowest value repeats itself too, and so does a still contact under a coarse converter. What tells them
apart is the noise of loaded readings. A reading of pure noise turns back (goes down after up, or up after down)
in 2 of 3 scans, a smooth one hardly ever; if a share s of fresh readings are equal to the last one, it turns back in
about 2/3 (1 - s)^2. So the turns of each taxel, counted over scans that differ, say how likely a fresh reading is to
repeat itself, and a whole scan is taken for a repeated one only if its loaded readings together would have done so
less than once in a thousand times. A smooth load has too little noise to tell; but a logger keeps time: if scans come
in runs of equal ones whose lengths add up as evenly as clocks do, which chance does not, each of them repeats.
Where nothing is loaded there is no evidence, and the scan is kept.

A gap is a time step far above the usual one: the median of those before it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.messages import Bools, Floats

GAP = 3.0
"""A time step longer than so many usual ones is a gap."""

_CHANCE = 1e-3
_RESTLESS = 0.25
"""A taxel that turns back in fewer of its scans than this may be as quiet as it is smooth: it is no witness."""
_SUREST = 0.05
_NEW = 4.0
"""Scans without a turn that each taxel is credited with before it has been seen."""
_RING = 15
_BEATS = 48
"""Runs of equal scans that make a beat: so many in a row,"""
_LEAST_BEAT, _OFF_BEAT = 1.5, 2.0
"""... on average at least so long, and never more than so many scans ahead of the mean or behind it."""
_FEWEST_LOADED = 3
"""Loaded taxels that a scan must have for its run to count."""
_FEWEST_STEPS = 3

# Memory per taxel: lowest reading; the last reading and the step that led to it; for how many differing scans it has
# been loaded (0 to 2); turns and the scans in which there could have been one.
_LOWEST, _VALUE, _STEP, _RUN, _TURNS, _COULD, _TAXEL = range(7)
# Of the stream: time of the last stamp and of the last scan kept (NaN before the first), a gap not yet told of, scans
# dropped since the last kept one, and whether that would have betrayed a repetition; whether any repetition has ever
# been seen; scans dropped in all, gaps, the longest of them in s; number and mean of the steps from stamp to stamp, and
# sum of their squares from it; sum and number of the steps between scans that would have betrayed a repetition; the
# length of the run of equal scans, whether it is loaded, and whether there is a beat; how much the rings hold that
# follow: two of time steps, one of runs.
_STAMP, _KEPT, _PENDING, _BETWEEN, _WITNESS, _REPEATS, _DROPPED, _GAPS, _LONGEST, _STEPS, _MEAN, _SQUARES = range(12)
_SUM, _COUNT, _EQUAL, _LOADED, _BEAT, _STAMPS, _FRESH, _RUNS, _RINGS = range(12, 21)
_STREAM = _RINGS + 2 * _RING + _BEATS


@dataclass(frozen=True, slots=True, eq=False)
class Sifted:
    """Scans that are new. t_s: (scans,). values: (scans, taxels). gap: (scans,), time was lost before this one."""

    t_s: Floats
    values: Floats
    gap: Bools

    def part(self, start: int, stop: int) -> Sifted:
        """Scans `start` to `stop` (excluded), as views."""
        return Sifted(self.t_s[start:stop], self.values[start:stop], self.gap[start:stop])

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


class Sifter:
    """Drops repeated scans, marks gaps, scan by scan. ceiling: (taxels,), a reading at or above it is no evidence."""

    def __init__(self, taxels: int, ceiling: Floats, *, drop: bool) -> None:
        self._ceiling, self._drop = ceiling, drop
        self._taxels = np.zeros((_TAXEL, taxels))
        self._taxels[_LOWEST] = np.inf
        self._stream = np.zeros(_STREAM)
        self.restart()

    def restart(self) -> None:
        """The same recording from its start; what has been seen of its taxels stays."""
        known = self._stream[[_REPEATS, _BEAT]]
        self._stream[:] = 0.0
        self._stream[[_STAMP, _KEPT]] = np.nan
        self._stream[[_REPEATS, _BEAT]] = known
        self._taxels[_RUN] = 0.0

    @property
    def counts(self) -> Counts:
        """What has been seen since the start."""
        s = self._stream
        mean = float(s[_MEAN]) if s[_STEPS] else float("nan")
        return Counts(
            repeated=int(s[_DROPPED]),
            gaps=int(s[_GAPS]),
            longest_gap_s=float(s[_LONGEST]),
            step_s=mean,
            step_std_s=float(np.sqrt(s[_SQUARES] / s[_STEPS])) if s[_STEPS] else float("nan"),
            usual_s=float(s[_SUM] / s[_COUNT]) if s[_COUNT] else mean,
        )

    def step(self, t_s: Floats, values: Floats) -> Sifted:
        """Scans (scans, taxels) in time order -> the new ones among them."""
        keep = np.ones(len(t_s), dtype=np.bool_)
        gap = np.zeros(len(t_s), dtype=np.bool_)
        new = sift(t_s, values, self._ceiling, self._drop, self._taxels, self._stream, keep, gap)
        if new == len(t_s):
            return Sifted(t_s, values, gap)
        return Sifted(t_s[keep], values[keep], gap[keep])


@kernel
def sift(
    t: Floats, values: Floats, ceiling: Floats, drop: bool, taxels: Floats, stream: Floats, keep: Bools, gap: Bools
) -> int:
    """Clear keep (scans,) where a scan is the last one again, set gap (scans,); how many are new. Others are memory."""
    new = len(t)
    for scan in range(len(t)):
        again = False
        if not np.isnan(stream[_STAMP]):
            _judge_stamp(t[scan] - stream[_STAMP], stream)
            again = _same(values[scan], taxels)
            stream[_EQUAL] += 1.0
            if drop and again and _betrays(values[scan], ceiling, taxels, stream):
                stream[_STAMP] = t[scan]
                stream[_BETWEEN] += 1.0
                stream[_DROPPED] += 1.0
                stream[_REPEATS] = 1.0
                keep[scan] = False
                new -= 1
                continue
        witness = stream[_REPEATS] > 0.0 and _betrays(values[scan], ceiling, taxels, stream)
        if witness and stream[_WITNESS] > 0.0:
            _judge_fresh(t[scan] - stream[_KEPT], stream)
        gap[scan] = stream[_PENDING] > 0.0
        stream[_STAMP] = stream[_KEPT] = t[scan]
        stream[_PENDING] = stream[_BETWEEN] = 0.0
        stream[_WITNESS] = 1.0 if witness else 0.0
        if not again:
            _end_run(stream, gap[scan])
            stream[_LOADED] = 1.0 if _learn(values[scan], ceiling, taxels) >= _FEWEST_LOADED else 0.0
    return new


@kernel
def _judge_stamp(step: float, stream: Floats) -> None:
    """Whether stamps lie too far apart."""
    usual = _median(stream[_RINGS : _RINGS + _RING], int(stream[_STAMPS]))
    if step > GAP * usual:
        _add_gap(step, stream)
    else:  # mean and sum of squares from it, after Welford
        stream[_STEPS] += 1.0
        off = step - stream[_MEAN]
        stream[_MEAN] += off / stream[_STEPS]
        stream[_SQUARES] += off * (step - stream[_MEAN])
    stream[_RINGS + int(stream[_STAMPS]) % _RING] = step
    stream[_STAMPS] += 1.0


@kernel
def _judge_fresh(step: float, stream: Floats) -> None:
    """Whether a sensor hung while its logger went on: between two scans that would both have betrayed a repetition."""
    ring = stream[_RINGS + _RING : _RINGS + 2 * _RING]
    if stream[_BETWEEN] > 0.0 and stream[_PENDING] == 0.0 and step > GAP * _median(ring, int(stream[_FRESH])):
        _add_gap(step, stream)
    ring[int(stream[_FRESH]) % _RING] = step
    stream[_FRESH] += 1.0
    if stream[_PENDING] == 0.0:
        stream[_SUM] += step
        stream[_COUNT] += 1.0


@kernel
def _add_gap(step: float, stream: Floats) -> None:
    stream[_PENDING] = 1.0
    stream[_GAPS] += 1.0
    stream[_LONGEST] = max(stream[_LONGEST], step)


@kernel
def _median(ring: Floats, seen: int) -> float:
    """Of the last steps; infinite while there are too few."""
    if seen < _FEWEST_STEPS:
        return np.inf
    return float(np.median(ring[: min(seen, _RING)]))


@kernel
def _same(values: Floats, taxels: Floats) -> bool:
    for k in range(len(values)):
        last = taxels[_VALUE, k]
        if values[k] != last and not (np.isnan(values[k]) and np.isnan(last)):
            return False
    return True


@kernel
def _end_run(stream: Floats, gap: bool) -> None:
    """A new scan: note how often the last one stood, if it was loaded, and listen for a beat."""
    ring = stream[_RINGS + 2 * _RING :]
    if stream[_LOADED] > 0.0 and not gap:
        ring[int(stream[_RUNS]) % _BEATS] = stream[_EQUAL]
        stream[_RUNS] += 1.0
        mean = ring.mean()
        if stream[_BEAT] == 0.0 and stream[_RUNS] >= _BEATS and mean >= _LEAST_BEAT:
            ahead = most = 0.0
            for k in range(_BEATS):
                ahead += ring[(int(stream[_RUNS]) + k) % _BEATS] - mean
                most = max(most, abs(ahead))
            stream[_BEAT] = 1.0 if most <= _OFF_BEAT else 0.0
    stream[_EQUAL] = 0.0


@kernel
def _betrays(values: Floats, ceiling: Floats, taxels: Floats, stream: Floats) -> bool:
    """Whether this scan, were it equal to the last one, would surely be no new one."""
    loaded = False
    for k in range(len(values)):
        loaded = loaded or taxels[_LOWEST, k] < values[k] < ceiling[k]
    return loaded and (stream[_BEAT] > 0.0 or _chance(values, ceiling, taxels) < _CHANCE)


@kernel
def _chance(values: Floats, ceiling: Floats, taxels: Floats) -> float:
    """How likely a fresh scan would be equal to the one before it, from its loaded taxels."""
    chance = 1.0
    for k in range(len(values)):
        if taxels[_LOWEST, k] < values[k] < ceiling[k]:
            turns = taxels[_TURNS, k] / (taxels[_COULD, k] + _NEW)
            if turns >= _RESTLESS:
                chance *= max(1.0 - np.sqrt(1.5 * turns), _SUREST)
                if chance < _CHANCE:
                    break
    return chance


@kernel
def _learn(values: Floats, ceiling: Floats, taxels: Floats) -> int:
    """Count the turns of loaded taxels in a scan that differs from the last; how many are loaded."""
    lowest, last, before = taxels[_LOWEST], taxels[_VALUE], taxels[_STEP]
    run, turns, could = taxels[_RUN], taxels[_TURNS], taxels[_COULD]
    loaded = 0
    for k in range(len(values)):  # without branches: readings are as good as random
        value = values[k]
        here = lowest[k] < value < ceiling[k]
        step = value - last[k]
        judged = here and run[k] >= 2.0
        could[k] += judged
        turns[k] += judged and step * before[k] < 0.0
        before[k] = step
        run[k] = min(run[k] + 1.0, 2.0) if here else 0.0
        lowest[k] = np.fmin(lowest[k], value)  # a missing reading is none
        last[k] = value
        loaded += here
    return loaded
