"""Slip events against truth: found how soon, missed, and how often a still object raises an alarm.

Slips: objects that stick and slip on a 16x16 grid at 100 Hz, seen live and as a recording whose slips are dated when
all is known. A scan slips if the object moves at its time, even if it has only just begun to. Holds: objects that stay
where they are while load, growth, drift or gain change what is seen of them. Rolling and tilting stand apart: normal
pressure cannot tell them from slip.
Noise: poses of white noise straight into the monitor, which is all that its promise is about.
"""

from __future__ import annotations

from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import pairwise, product
from math import ceil
from multiprocessing import get_context
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow import api
from taxelflow.compiling import announced
from taxelflow.evaluation.oracle import called
from taxelflow.messages import OK, Event, Slips, joined
from taxelflow.simulation.parameters import Contact
from taxelflow.simulation.scenario import SCENARIOS, Scenario
from taxelflow.simulation.simulate import simulate
from taxelflow.slip.parameters import SlipMonitor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from taxelflow.acquire.base import Truth
    from taxelflow.estimation.base import Mode
    from taxelflow.messages import Bools, Floats

METHODS = ("template", "principal_axis", "convolution")
OBJECTS = {
    "textured": Contact("textured", radius_m=0.016),
    "elongated": Contact("elongated", radius_m=0.008),
    "feet": Contact("feet", radius_m=0.006),
    "airbag": Contact("airbag", radius_m=0.016),
    "hertz": Contact("hertz", radius_m=0.016),
}
"""The first three have a structure that pins them down, the last two are domes."""
HOLDS = ("hold-pressed", "hold-at-edge", "hold-drifting", "hold-wobbling")
APART = ("roll", "tilt")
NOISE = "white noise"
FRESH_SEED = 1000
"""Seeds below were used while the test was made; the score's begin here."""
_NOISE_STD = (2e-5, 2e-5, 1e-3)
_BLOCK_S = 60.0
_MODES: tuple[Mode, ...] = ("stream", "batch")
_EARLY = {"stream": 0, "batch": 2}
"""Scans by which a slip may be dated too early and is still that slip."""


class SlipRow(msgspec.Struct, frozen=True):
    """One method on one object. Medians are over slips; latencies count from the first scan that is slipping."""

    object: str
    method: str
    mode: Mode
    """stream: scan by scan as they come. batch: as a recording, where onset_ms says how well a slip is dated."""
    slips: int
    f1: float
    """Over scans: slipping as seen against slipping in truth."""
    f1_oracle: float | None
    """That of `oracle.called` with this method's covariance; None for a batch, and where it says none for each scan."""
    onset_ms: float
    onset_p90_ms: float
    onset_max_ms: float
    missed: int
    false: int
    """Slips begun while the object was still."""
    split: int
    """Slips begun anew within one slip."""
    dated_ms: float
    """Median error of the onset's own time, as the event tells it at once."""
    direction_deg: float
    """Median error of a slip's direction, when it has ended."""
    speed_percent: float
    """Median error of its speed."""


class HoldRow(msgspec.Struct, frozen=True):
    """One method on still objects of one kind."""

    scenario: str
    method: str
    hours: float
    """In contact."""
    alarms: int
    per_hour: float
    low: float
    """Of the 95 % interval of the rate, if alarms come by chance (Poisson)."""
    high: float
    scatter: float
    """Median of what the monitor learned: scatter of a still object over what its covariance says."""


class SlipScore(msgspec.Struct, frozen=True):
    """All rows, the rate that was asked for, and where the seeds began."""

    alarms_per_hour: float
    seeds: int
    first_seed: int
    slips: list[SlipRow]
    holds: list[HoldRow]


@dataclass(frozen=True, slots=True)
class _Job:
    """One recording through some methods."""

    name: str
    seed: int
    methods: tuple[str, ...]
    alarms_per_hour: float


@dataclass(slots=True)
class _Seen:
    """What came of one recording or, summed, of many."""

    true: int = 0
    """Scans that slip in truth; told: are said to; both: both."""
    told: int = 0
    both: int = 0
    oracle_true: int = 0
    """Scans that slip in truth, of recordings that an oracle has seen."""
    oracle_told: int = 0
    oracle_both: int = 0
    hours: float = 0.0
    alarms: int = 0
    false: int = 0
    split: int = 0
    missed: int = 0
    latency_ms: list[float] = field(default_factory=list)
    dated_ms: list[float] = field(default_factory=list)
    direction_deg: list[float] = field(default_factory=list)
    speed_percent: list[float] = field(default_factory=list)
    scatter: list[float] = field(default_factory=list)

    def add(self, other: _Seen) -> None:
        """Sum of both."""
        for name in _Seen.__slots__:
            setattr(self, name, getattr(self, name) + getattr(other, name))


def score_slip(
    methods: tuple[str, ...],
    seeds: int,
    *,
    seed: int = 0,
    hours: float = 0.1,
    alarms_per_hour: float = 1.0,
    processes: int = 1,
    watched: Callable[[list[_Job]], Iterable[_Job]] = iter,
) -> SlipScore:
    """Slips: `seeds` recordings of each object. Holds: `hours` of each scenario. seed: added to all seeds.

    Raises ParameterInvalid, NameUnknown.
    """
    SlipMonitor(alarms_per_hour=alarms_per_hour)  # what cannot work is refused before the work begins
    for method in methods:
        api.estimator(method)
    first = FRESH_SEED + seed
    blocks = ceil(hours * 3600 / _BLOCK_S)
    jobs = [_Job(name, first + k, methods, alarms_per_hour) for name in OBJECTS for k in range(seeds)]
    jobs += [
        _Job(name, first + k, methods, alarms_per_hour) for name in (*HOLDS, *APART) for k in range(blocks) if methods
    ]
    jobs += [_Job(NOISE, first, (NOISE,), alarms_per_hour)] * (hours > 0)
    totals: dict[tuple[str, str, Mode], _Seen] = defaultdict(_Seen)
    for job, found in zip(watched(jobs), _found(jobs, hours, processes), strict=True):
        for (method, mode), seen in found.items():
            totals[job.name, method, mode].add(seen)
    slid = [(name, method, mode) for name in OBJECTS for method in methods for mode in _MODES if seeds]
    still = [(name, method) for name in (*HOLDS, *APART) for method in methods]
    still.append((NOISE, NOISE))
    holds = [_hold_row(name, method, totals[name, method, "stream"]) for name, method in still if blocks]
    return SlipScore(alarms_per_hour, seeds, first, [_slip_row(*key, totals[key]) for key in slid], holds)


def _found(jobs: list[_Job], hours: float, processes: int) -> Iterator[dict[tuple[str, Mode], _Seen]]:
    """What each job gives, in order."""
    if processes == 1:
        yield from (_watch(job, hours) for job in jobs)
        return
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        yield from pool.map(_watch, jobs, [hours] * len(jobs))


def _watch(job: _Job, hours: float) -> dict[tuple[str, Mode], _Seen]:
    monitor = SlipMonitor(alarms_per_hour=job.alarms_per_hour)
    if job.name == NOISE:
        return {(NOISE, "stream"): _noise(job.seed, hours, monitor)}
    scenario = _scenario(job)
    recording = simulate(scenario)
    scans, truth = api.conditioned(recording), recording.known_truth
    pad = recording.layout.pads.index(truth.pad)
    found = {}
    for method, mode in product(job.methods, _MODES if job.name in OBJECTS else _MODES[:1]):
        with announced():
            session = api.estimator(method).start(recording.layout, mode)
            slips = joined([session.step(scans), session.finish()])
        watch = (monitor.begin if mode == "stream" else monitor.look_back)(recording.layout.pads)
        (slipping, events), (rest, last) = watch.step(slips), watch.finish()
        own = [event for event in (*events, *last) if event.pad == truth.pad]
        flags = np.concatenate([slipping, rest])[:, pad]
        seen = _compared(flags, own, truth, scenario.motion.interval_s[0], _EARLY[mode])
        seen.hours = float(slips.contact[:, pad].mean() * (truth.t_s[-1] - truth.t_s[0]) / 3600)
        seen.scatter = [float(watch.scatter[pad])]
        if job.name in OBJECTS and mode == "stream":
            _ask_oracle(slips, pad, truth, job, seen)
        found[method, mode] = seen
    return found


def _scenario(job: _Job) -> Scenario:
    if job.name in OBJECTS:
        return replace(SCENARIOS["stick-slip"], seed=job.seed, contact=OBJECTS[job.name])
    return replace(SCENARIOS[job.name], seed=job.seed)


def _compared(slipping: Bools, events: list[Event], truth: Truth, shortest_s: float, early: int) -> _Seen:
    """One recording: slipping (scans,) and events of the touched pad against its truth; its shortest slips.

    early: scans by which a slip may be called too soon.
    """
    t_s, true = truth.t_s, truth.slipping
    if true is None:
        raise RuntimeError("the rig always knows the truth")
    starts = (
        [(event, stop) for event, stop in pairwise([*events, events[-1]]) if event.event == "slip_start"]
        if events
        else []
    )
    seen = _Seen(int(true.sum()), int(slipping.sum()), int((slipping & true).sum()), alarms=len(starts))
    near = np.convolve(true, np.ones(early + 2))[early : early + len(true)] > 0  # one scan late, too
    seen.false = sum(not near[int(np.searchsorted(t_s, event.t_s))] for event, _ in starts)
    half_s = 0.5 * float(np.median(np.diff(t_s)))
    for begin, end in _runs(true):
        if t_s[end - 1] - t_s[begin] < shortest_s - 4 * half_s:  # the last one, cut short by the end of the motion
            continue
        found = np.flatnonzero(slipping[begin:end])
        if not len(found):
            seen.missed += 1
            continue
        seen.latency_ms.append(1e3 * float(t_s[begin + found[0]] - t_s[begin]))
        soon_s = t_s[max(begin - early, 0)]
        own = [(event, stop) for event, stop in starts if soon_s <= event.t_s < t_s[end - 1] + half_s]
        seen.split += max(len(own) - 1, 0)
        if own:
            seen.dated_ms.append(1e3 * abs(own[0][0].onset_s - float(t_s[begin]) + half_s))
            _judge_motion(own[-1][1], truth.pose[end - 1] - truth.pose[begin], float(t_s[end - 1] - t_s[begin]), seen)
    return seen


def _ask_oracle(slips: Slips, pad: int, truth: Truth, job: _Job, seen: _Seen) -> None:
    """Count what one who knows all but when would have called of a method's slips of a pad."""
    covariance = slips.displacement_covariance[:, pad, :2, :2] / 2
    known = np.isfinite(covariance[:, 0, 0])
    if truth.slipping is None or not known.any() or (slips.lag_s[:, pad] > 0).any():
        return  # poses that are older than their scan are means of two
    covariance = np.where(known[:, np.newaxis, np.newaxis], covariance, np.median(covariance[known], axis=0))
    alarm_s = 3600.0 / job.alarms_per_hour
    best = called(truth.t_s, truth.pose[:, :2], covariance, _runs(truth.slipping), alarm_s, job.seed)
    seen.oracle_true, seen.oracle_told = int(truth.slipping.sum()), int(best.sum())
    seen.oracle_both = int((best & truth.slipping).sum())


def _judge_motion(stop: Event, way: Floats, lasts_s: float, seen: _Seen) -> None:
    """Direction and speed of a slip that has ended, against its way (3,)."""
    if np.isfinite(stop.speed_m_s) and lasts_s > 0:
        speed = float(np.hypot(way[0], way[1])) / lasts_s
        off = stop.direction_rad - float(np.arctan2(way[1], way[0]))
        seen.direction_deg.append(float(np.degrees(abs((off + np.pi) % (2 * np.pi) - np.pi))))
        seen.speed_percent.append(100 * abs(stop.speed_m_s / speed - 1))


def _runs(flags: Bools) -> list[tuple[int, int]]:
    """Begin and end (excluded) of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _noise(seed: int, hours: float, monitor: SlipMonitor) -> _Seen:
    """Poses of a still object in white noise at 100 Hz, with the covariance that they have."""
    random, rate_hz = np.random.default_rng(seed), 100.0
    session, std = monitor.begin((NOISE,)), np.array(_NOISE_STD)
    before, alarms = np.full(3, np.nan), 0
    scans = round(hours * 3600 * rate_hz)
    for start in range(0, scans, 100_000):
        count = min(100_000, scans - start)
        pose = std * random.standard_normal((count, 3))
        slips = still_slips((start + np.arange(count)) / rate_hz, pose, std, before)
        alarms += sum(event.event == "slip_start" for event in session.step(slips)[1])
        before = pose[-1]
    return _Seen(hours=hours, alarms=alarms, scatter=[float(session.scatter[0])])


def still_slips(t_s: Floats, pose: Floats, std: Floats, before: Floats) -> Slips:
    """Slips of one pad at steady load from its poses (scans, 3) with independent errors of deviation std (3,).

    before: (3,), the pose before the first, NaN if there is none.
    """
    count = len(t_s)
    covariance = np.broadcast_to(np.diag(std**2), (count, 1, 3, 3))
    nothing = np.full((count, 1), np.nan)
    return Slips(
        t_s=t_s,
        contact=np.ones((count, 1), dtype=np.bool_),
        border=np.zeros((count, 1, 2), dtype=np.bool_),
        displacement=np.diff(np.concatenate([before[np.newaxis], pose]), axis=0)[:, np.newaxis],
        pose=pose[:, np.newaxis],
        covariance=covariance.copy(),
        displacement_covariance=2 * covariance,
        span_s=nothing,
        lag_s=np.zeros((count, 1)),
        load=np.ones((count, 1)),
        disturbance=nothing.copy(),
        quality=np.full((count, 1), OK, dtype=np.uint8),
    )


def _slip_row(name: str, method: str, mode: Mode, seen: _Seen) -> SlipRow:
    latency = np.array(seen.latency_ms or [np.nan])
    return SlipRow(
        object=name,
        method=method,
        mode=mode,
        slips=len(seen.latency_ms) + seen.missed,
        f1=2 * seen.both / max(seen.true + seen.told, 1),
        f1_oracle=2 * seen.oracle_both / (seen.oracle_true + seen.oracle_told) if seen.oracle_true else None,
        onset_ms=float(np.median(latency)),
        onset_p90_ms=float(np.quantile(latency, 0.9)),
        onset_max_ms=float(latency.max()),
        missed=seen.missed,
        false=seen.false,
        split=seen.split,
        dated_ms=float(np.median(seen.dated_ms or [np.nan])),
        direction_deg=float(np.median(seen.direction_deg or [np.nan])),
        speed_percent=float(np.median(seen.speed_percent or [np.nan])),
    )


def _hold_row(name: str, method: str, seen: _Seen) -> HoldRow:
    from scipy.stats import chi2

    low = float(chi2.ppf(0.025, 2 * seen.alarms)) / 2 if seen.alarms else 0.0
    high = float(chi2.ppf(0.975, 2 * seen.alarms + 2)) / 2
    return HoldRow(
        scenario=name,
        method=method,
        hours=seen.hours,
        alarms=seen.alarms,
        per_hour=seen.alarms / seen.hours,
        low=low / seen.hours,
        high=high / seen.hours,
        scatter=float(np.median(seen.scatter)),
    )
