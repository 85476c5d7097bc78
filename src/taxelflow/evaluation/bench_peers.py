"""One streaming step of an estimator for the whole hand against OpenCV's phaseCorrelate over its pads, in one run.

Every pad of the paper's hand is in contact with an airbag of its own, which slides to and fro. The estimator is given
each scan once, in time order, as a live session would be. Of an estimator that learns, rounds in which a pattern was
being learned or adopted are a row of their own; after those the scans' own clock is waited for, because a stream that
runs ahead of it would wait for what is learned.
"""

from __future__ import annotations

import gc
from dataclasses import replace
from time import perf_counter, sleep
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from taxelflow.errors import ExtraMissing
from taxelflow.estimation.template.online.session import StreamSession
from taxelflow.evaluation.bench_effort import USUAL, Effort
from taxelflow.evaluation.live_hand import BASELINE_PA, to_and_fro
from taxelflow.evaluation.peer_methods import needed
from taxelflow.messages import Scans, cut
from taxelflow.pipeline import api
from taxelflow.runtime import registry
from taxelflow.runtime.compiling import announced
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from taxelflow.estimation.base import EstimatorSession
    from taxelflow.messages import Floats
    from taxelflow.sensors.layout import Layout

STEPPED = ("lnorm", "convolution", "template", "registration")
"""Methods that are timed, where they are registered."""
RATE_HZ = 100.0
"""Rate of the scans that are timed."""
_INNER = 4
"""Steps in a row, of which the last is timed: the first ones refill the caches that the others emptied."""


class PeerLatency(msgspec.Struct, frozen=True):
    """One streaming step of the hand."""

    what: str
    p50_us: float
    p99_us: float
    p50_over_peer: float
    """Median over that of the peer; below 1 is faster."""
    p99_over_peer: float


class PeerBench(msgspec.Struct, frozen=True):
    """All of one run, or why there is none."""

    rows: list[PeerLatency]
    skipped: str | None = None


def bench_peers(methods: Sequence[str] = (), effort: Effort = USUAL) -> PeerBench:
    """Time estimators (`STEPPED` if none is named) and the peer in turn. Without OpenCV the rows are empty."""
    try:
        cv2 = needed("cv2")
    except ExtraMissing as error:
        return PeerBench([], str(error))
    chosen = methods or [method for method in STEPPED if method in registry.names("estimator")]
    layout, scans = hand_in_contact(effort.peer_warm + effort.peer_rounds)
    peer = f"cv2.phaseCorrelate, {layout.pad_count} pads"
    steps = {peer: _correlations(cv2, layout, scans)}
    learning: dict[str, Callable[[], bool]] = {}
    with announced():
        for method in chosen:
            session, what = api.estimator(method).start(layout, "stream"), f"{method} step"
            steps[what] = _steps(session, scans)
            if isinstance(session, StreamSession):
                learning[what] = _learns(session)
    taken = _in_turn(steps, learning, effort.peer_warm, effort.peer_rounds)
    quantiles = {what: np.quantile(1e6 * times, (0.5, 0.99)) for what, times in taken.items()}
    rows = [PeerLatency(what, *map(float, (*own, *(own / quantiles[peer])))) for what, own in quantiles.items()]
    return PeerBench(rows)


def hand_in_contact(rounds: int) -> tuple[Layout, list[Scans]]:
    """Conditioned scans, one a block, of the paper's hand with every pad in contact; the groups are left out."""
    count = _INNER * rounds
    stroke = SCENARIOS["stroke"]
    sensor = msgspec.structs.replace(load_sensor(stroke.sensor), groups=())
    layout = sensor.layout
    pressure = np.zeros((count, layout.taxels))
    sensing = replace(stroke.sensing, rate_hz=RATE_HZ, baseline_pa=(BASELINE_PA, BASELINE_PA))
    for pad in range(len(layout.pads)):
        own = layout.of_pad(pad)
        scenario = to_and_fro(layout, pad, sensing, seconds=count / RATE_HZ, radius_pitches=1.0)
        pressure[:, own] = simulate(scenario).load().values[:count, own] * sensor.to_si - BASELINE_PA
    contact = np.ones((count, len(layout.pads)), dtype=np.bool_)
    noise, ceiling = np.full(layout.entries, stroke.sensing.noise_pa), np.full(layout.entries, np.inf)
    block = Scans(np.arange(count) / RATE_HZ, pressure, noise, ceiling, contact, contact)
    return layout, [cut(block, k, k + 1) for k in range(count)]


def _steps(session: EstimatorSession, scans: list[Scans]) -> Callable[[int], object]:
    return lambda k: session.step(scans[k])


def _learns(session: StreamSession) -> Callable[[], bool]:
    return lambda: session.learning


def _correlations(cv2: Any, layout: Layout, scans: list[Scans]) -> Callable[[int], object]:
    """The pads' images are laid out beforehand: only the calls are timed."""
    images: list[list[Floats]] = [
        [layout.grid(pad, scan.pressure[0], fill=0.0).astype(np.float32) for pad in range(len(layout.pads))]
        for scan in scans
    ]
    return lambda k: [cv2.phaseCorrelate(*pair) for pair in zip(images[k - 1], images[k], strict=True)]


def last_of(step: Callable[[int], object], first: int, count: int) -> float:
    """Seconds of the last of `count` steps from number `first` on; the others warm the caches."""
    for k in range(first, first + count - 1):
        step(k)
    start = perf_counter()
    step(first + count - 1)
    return perf_counter() - start


def _round(
    steps: dict[str, Callable[[int], object]],
    learning: dict[str, Callable[[], bool]],
    taken: dict[str, list[float]],
    number: int,
    warm: int,
) -> bool:
    """Time each step once; whether some step learned meanwhile."""
    learned = False
    for what, step in steps.items():
        busy = what in learning and learning[what]()
        spent_s = last_of(step, _INNER * number, _INNER)
        if what in learning and (busy or learning[what]()):
            learned = True
            taken[f"{what}, while it learns"].append(spent_s)
        elif number >= warm:
            taken[what].append(spent_s)
    return learned


def _in_turn(
    steps: dict[str, Callable[[int], object]], learning: dict[str, Callable[[], bool]], warm: int, rounds: int
) -> dict[str, Floats]:
    """Seconds (rounds,) of each step, in turn; every step sees each scan once, in order.

    Of a step that learns, those rounds after the warm ones in which it did not, and apart all rounds in which it did.
    """
    taken: dict[str, list[float]] = {}
    for what in steps:
        taken[what] = []
        if what in learning:
            taken[f"{what}, while it learns"] = []
    gc.collect()
    gc.disable()
    try:
        for round_ in range(warm + rounds):
            if _round(steps, learning, taken, round_, warm):
                sleep(_INNER / RATE_HZ)
    finally:
        gc.enable()
    return {what: np.array(times) for what, times in taken.items() if times}
