"""Slip events of one recording against its truth, for the score slip: found how soon, missed, false, split.

A scan slips if the object moves at its time, even if it has only just begun to. A recording is scored live (stream) and
with slips dated when all is known (batch).
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import pairwise, product
from multiprocessing import get_context
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.completion import start_slips
from taxelflow.evaluation.oracle import called
from taxelflow.messages import OK, Event, Slips, joined
from taxelflow.numerics.geometry import wrapped
from taxelflow.numerics.spans import spans
from taxelflow.pipeline import api
from taxelflow.runtime.compiling import announced
from taxelflow.simulation.parameters import Contact
from taxelflow.simulation.scenario import SCENARIOS, Scenario
from taxelflow.simulation.simulate import simulate
from taxelflow.slip.parameters import SlipMonitor

if TYPE_CHECKING:
    from collections.abc import Iterator

    from taxelflow.acquire.base import Truth
    from taxelflow.estimation.base import Mode
    from taxelflow.messages import Bools, Floats

OBJECTS = {
    "textured": Contact("textured", radius_m=0.016),
    "elongated": Contact("elongated", radius_m=0.008),
    "feet": Contact("feet", radius_m=0.006),
    "airbag": Contact("airbag", radius_m=0.016),
    "hertz": Contact("hertz", radius_m=0.016),
}
"""The first three have a structure that pins them down, the last two are domes."""
NOISE = "white noise"
MODES: tuple[Mode, ...] = ("stream", "batch")


@dataclass(frozen=True, slots=True)
class _NoiseStd:
    """Standard deviations of the poses of white noise."""

    m: float = 2e-5
    rad: float = 1e-3


_NOISE_STD = _NoiseStd()
_EARLY = {"stream": 0, "batch": 2}
"""Scans by which a slip may be dated too early and is still that slip."""


@dataclass(frozen=True, slots=True)
class Job:
    """One recording through some methods."""

    name: str
    seed: int
    methods: tuple[str, ...]
    alarms_per_hour: float


@dataclass(slots=True)
class Tally:
    """Counts and errors of one recording or, summed, of many."""

    true: int = 0
    """Scans that slip in truth."""
    called: int = 0
    """Scans that were called slipping."""
    both: int = 0
    """Scans that slip in truth and were called slipping."""
    oracle_true: int = 0
    """Scans that slip in truth, of the recordings for which there is an oracle."""
    oracle_called: int = 0
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

    def add(self, other: Tally) -> None:
        """Sum of both."""
        for name in Tally.__slots__:
            setattr(self, name, getattr(self, name) + getattr(other, name))


def found_by(jobs: list[Job], hours: float, processes: int) -> Iterator[dict[tuple[str, Mode], Tally]]:
    """What each job gives, in order."""
    if processes == 1:
        yield from (watch_job(job, hours) for job in jobs)
        return
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        yield from pool.map(watch_job, jobs, [hours] * len(jobs))


def watch_job(job: Job, hours: float) -> dict[tuple[str, Mode], Tally]:
    """Simulate the recording of one job; count its slips by method and mode. hours: of white noise."""
    monitor = SlipMonitor(alarms_per_hour=job.alarms_per_hour)
    if job.name == NOISE:
        return {(NOISE, "stream"): _noise(job.seed, hours, monitor)}
    scenario = _scenario(job)
    recording = simulate(scenario)
    scans, truth = api.conditioned(recording), recording.known_truth
    pad = recording.layout.pads.index(truth.pad)
    found = {}
    for method, mode in product(job.methods, MODES if job.name in OBJECTS else MODES[:1]):
        with announced():
            session = start_slips(api.estimator(method), recording.layout, mode)
            slips = joined([session.step(scans), session.finish()])
        watch = monitor.watch(recording.layout, stream=mode == "stream", judged=session.judges)
        watch.see(scans)
        judged = (watch.step(slips), watch.finish())
        own = [event for part in judged for event in part.events if event.pad == truth.pad]
        flags = np.concatenate([part.slipping for part in judged])[:, pad]
        tally = compared(flags, own, truth, scenario.motion.interval_s[0], _EARLY[mode])
        tally.hours = float(slips.contact[:, pad].mean() * (truth.t_s[-1] - truth.t_s[0]) / 3600)
        tally.scatter = [float(watch.scatter[pad])]
        if job.name in OBJECTS and mode == "stream":
            _ask_oracle(slips, pad, truth, job, tally)
        found[method, mode] = tally
    return found


def _scenario(job: Job) -> Scenario:
    if job.name in OBJECTS:
        return replace(SCENARIOS["stick-slip"], seed=job.seed, contact=OBJECTS[job.name])
    return replace(SCENARIOS[job.name], seed=job.seed)


def compared(slipping: Bools, events: list[Event], truth: Truth, shortest_s: float, early: int) -> Tally:
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
    tally = Tally(int(true.sum()), int(slipping.sum()), int((slipping & true).sum()), alarms=len(starts))
    near = np.convolve(true, np.ones(early + 2))[early : early + len(true)] > 0  # one scan late, too
    tally.false = sum(not near[int(np.searchsorted(t_s, event.t_s))] for event, _ in starts)
    half_s = 0.5 * float(np.median(np.diff(t_s)))
    for begin, end in spans(true):
        if t_s[end - 1] - t_s[begin] < shortest_s - 4 * half_s:  # the last one, cut short by the end of the motion
            continue
        found = np.flatnonzero(slipping[begin:end])
        if not len(found):
            tally.missed += 1
            continue
        tally.latency_ms.append(1e3 * float(t_s[begin + found[0]] - t_s[begin]))
        soon_s = t_s[max(begin - early, 0)]
        own = [(event, stop) for event, stop in starts if soon_s <= event.t_s < t_s[end - 1] + half_s]
        tally.split += max(len(own) - 1, 0)
        if own:
            tally.dated_ms.append(1e3 * abs(own[0][0].onset_s - float(t_s[begin]) + half_s))
            _judge_motion(own[-1][1], truth.pose[end - 1] - truth.pose[begin], float(t_s[end - 1] - t_s[begin]), tally)
    return tally


def _ask_oracle(slips: Slips, pad: int, truth: Truth, job: Job, tally: Tally) -> None:
    """Count what one who knows all but when would have called of a method's slips of a pad."""
    covariance = slips.displacement_covariance[:, pad, :2, :2] / 2
    known = np.isfinite(covariance[:, 0, 0])
    if truth.slipping is None or not known.any() or (slips.lag_s[:, pad] > 0).any():
        return  # poses that are older than their scan are means of two
    covariance = np.where(known[:, np.newaxis, np.newaxis], covariance, np.median(covariance[known], axis=0))
    alarm_s = 3600.0 / job.alarms_per_hour
    best = called(truth.t_s, truth.pose[:, :2], covariance, spans(truth.slipping), alarm_s, job.seed)
    tally.oracle_true, tally.oracle_called = int(truth.slipping.sum()), int(best.sum())
    tally.oracle_both = int((best & truth.slipping).sum())


def _judge_motion(stop: Event, way: Floats, lasts_s: float, tally: Tally) -> None:
    """Direction and speed of a slip that has ended, against its way (3,)."""
    if np.isfinite(stop.speed_m_s) and lasts_s > 0:
        speed = float(np.hypot(way[0], way[1])) / lasts_s
        off = np.asarray(stop.direction_rad - np.arctan2(way[1], way[0]))
        tally.direction_deg.append(float(np.degrees(abs(wrapped(off)))))
        tally.speed_percent.append(100 * abs(stop.speed_m_s / speed - 1))


def _noise(seed: int, hours: float, monitor: SlipMonitor) -> Tally:
    """Poses of a still object in white noise at 100 Hz, with the covariance that they have."""
    random, rate_hz = np.random.default_rng(seed), 100.0
    session, std = monitor.begin((NOISE,)), np.array([_NOISE_STD.m, _NOISE_STD.m, _NOISE_STD.rad])
    before, alarms = np.full(3, np.nan), 0
    scans = round(hours * 3600 * rate_hz)
    for start in range(0, scans, 100_000):
        count = min(100_000, scans - start)
        pose = std * random.standard_normal((count, 3))
        slips = still_slips((start + np.arange(count)) / rate_hz, pose, std, before)
        alarms += sum(event.event == "slip_start" for event in session.step(slips)[1])
        before = pose[-1]
    return Tally(hours=hours, alarms=alarms, scatter=[float(session.scatter[0])])


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
