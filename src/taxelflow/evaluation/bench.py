"""How fast it is, as ratios within one run: kernels against the literal equations, and where the time goes."""

from __future__ import annotations

import gc
import subprocess
import sys
import tempfile
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, cast

import msgspec
import numpy as np

from taxelflow.acquire.base import Recording
from taxelflow.condition.parameters import Conditioner
from taxelflow.contacts.features import ContactFeatures
from taxelflow.estimation.centroid.paper_reference import convolution_index
from taxelflow.estimation.completion import start_slips
from taxelflow.evaluation.base import Watch, table_of, unwatched
from taxelflow.evaluation.bench_effort import USUAL, Effort
from taxelflow.evaluation.bench_large import LargePad, large_pads
from taxelflow.evaluation.bench_peers import PeerBench, PeerLatency, bench_peers, last_of
from taxelflow.evaluation.bench_reading import ReadingRate, reading_rates
from taxelflow.evaluation.bench_space import space_steps
from taxelflow.evaluation.bench_throughput import Throughput, throughput
from taxelflow.fusion.parameters import RigidField
from taxelflow.messages import RawScans, Scans, cut
from taxelflow.pipeline import api
from taxelflow.pipeline.stages import Pipeline
from taxelflow.publish.tables import Tables
from taxelflow.runtime.compiling import announced
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor
from taxelflow.simulation.scenario import SCENARIOS, Scenario
from taxelflow.simulation.simulate import save, simulate
from taxelflow.slip.parameters import SlipMonitor

if TYPE_CHECKING:
    from collections.abc import Callable, Sized
    from typing import TypeVar

    from taxelflow.estimation.centroid.session import CentroidSession
    from taxelflow.evaluation.base import Table
    from taxelflow.messages import Floats, Output

    Result = TypeVar("Result", bound=Sized)

_NOISE = 0.1
"""Standard deviation of an unloaded taxel, in the unit of readings that are 1 to 10 when loaded."""
_STAGES = ("parsing", "conditioning", "segmenting", "estimating", "monitoring and fusing", "writing")


class Latency(msgspec.Struct, frozen=True):
    """One way of doing one whole-hand step, timed in turn with the others of its group."""

    sensor: str
    what: str
    p50_us: float
    p99_us: float
    times_faster: float
    """Median of the literal equations over this median."""


class Share(msgspec.Struct, frozen=True):
    """Where the time of one `estimate` goes."""

    stage: str
    seconds: float
    share: float


class Start(msgspec.Struct, frozen=True):
    """Start of a whole process, over that of `import numpy`."""

    command: str
    seconds: float
    over_import_numpy: float


class Bench(msgspec.Struct, frozen=True):
    """All figures of one run."""

    latencies: list[Latency]
    peers: PeerBench
    throughputs: list[Throughput]
    large: list[LargePad]
    recording: str
    scans: int
    shares: list[Share]
    readings: list[ReadingRate]
    starts: list[Start]

    def tables(self) -> list[Table]:
        """Steps, other software, throughput, large pads, stages of one run, reading, start of a process."""
        return [
            table_of("steps", self.latencies, Latency),
            table_of("peers", self.peers.rows, PeerLatency),
            table_of("throughput", self.throughputs, Throughput),
            table_of("large", self.large, LargePad),
            table_of("stages", self.shares, Share),
            table_of("reading", self.readings, ReadingRate),
            table_of("start", self.starts, Start),
        ]


def bench(recording: Path | None, watched: Watch = unwatched, effort: Effort = USUAL) -> Bench:
    """Run everything; `recording` is what the shares are measured on (default: a simulated one of its length)."""
    with tempfile.TemporaryDirectory() as folder:
        if recording is None:
            recording = Path(folder) / "simulated.npz"
            save(_simulated(effort.strokes), recording)
        opened = api.read(recording)  # one that cannot be read is refused before the minutes of work
        latencies = [row for sensor in watched(_sensors(), "sensors") for row in _latencies(sensor, effort)]
        throughputs = [row for size in watched((16, 32, 64), "sizes of a pad") for row in throughput(size, effort)]
        large = [row for size in watched(effort.large, "large pads") for row in large_pads(*size, effort)]
        scans, shares = _shares(opened, Path(folder) / "result")
        readings = reading_rates(opened, Path(folder), effort)
    peers = bench_peers((), effort)
    return Bench(latencies, peers, throughputs, large, recording.name, scans, shares, readings, _starts())


def _simulated(strokes: int) -> Scenario:
    paper = SCENARIOS["stroke"]
    return replace(paper, motion=replace(paper.motion, strokes=strokes))


def _sensors() -> list[Sensor]:
    grid = Sensor(name="64x64", unit="kPa", pads=(Pad(name="grid", rows=64, cols=64, pitch_m=(0.002, 0.002)),))
    return [*map(load_sensor, ("barretthand-162", "grid-16x16", "schunk-sdh2")), grid]


def _latencies(sensor: Sensor, effort: Effort) -> list[Latency]:
    """One step of every pad, all in contact, by the literal equations, the kernels, and the whole pipeline."""
    layout = sensor.layout
    values = np.random.default_rng(0).uniform(1.0, 10.0, (16, layout.taxels))
    scans = _loaded(values[:, layout.source], len(layout.pads))
    images = [[layout.grid(pad, scan, fill=0.0) for pad in range(len(layout.pads))] for scan in values]
    steps: dict[str, Callable[[int], object]] = {
        "literal equations (SciPy)": lambda k: [
            convolution_index(images[k % 16][pad], images[(k + 1) % 16][pad]) for pad in range(len(layout.pads))
        ]
    }
    with announced():
        for method in ("convolution", "lnorm"):
            bare = cast("CentroidSession", api.estimator(method).start(layout, "stream"))
            steps[f"{method} kernel"] = _session_step(partial(bare.run, rows=bare.room(1)), scans)
            session = api.estimator(method).start(layout, "stream")
            steps[f"{method} step"] = _session_step(session.step, scans)
        steps |= _stages(sensor, values) | space_steps(sensor)
    taken = _in_turn(steps, effort)
    base = float(np.median(taken["literal equations (SciPy)"]))
    return [
        Latency(
            sensor.name,
            what,
            1e6 * float(np.median(times)),
            1e6 * float(np.quantile(times, 0.99)),
            base / float(np.median(times)),
        )
        for what, times in taken.items()
    ]


def _loaded(values: Floats, pads: int) -> list[Scans]:
    contact = np.ones((1, pads), dtype=np.bool_)
    noise = np.full(values.shape[1], _NOISE)
    never = np.full(len(noise), np.inf)
    return [Scans(np.array([0.01 * k]), values[k : k + 1], noise, never, contact, contact) for k in range(len(values))]


def _session_step(step: Callable[[Scans], object], scans: list[Scans]) -> Callable[[int], object]:
    return lambda k: step(scans[k % len(scans)])


def _stages(sensor: Sensor, values: Floats) -> dict[str, Callable[[int], object]]:
    """What a live loop does per scan, stage by stage and together, once noise and tare are known."""
    conditioner, monitor = Conditioner(), SlipMonitor().watch(sensor.layout, stream=True)
    condition = conditioner.start(sensor, np.zeros(sensor.layout.taxels, dtype=np.bool_), None)
    segment = ContactFeatures().start(sensor, conditioner.contact_on, conditioner.contact_off, stream=True)
    estimate = start_slips(api.estimator("convolution"), sensor.layout, "stream")
    fuse = RigidField().start(sensor.layout)
    conditioned = _fed(lambda raw: list(condition.step(raw)), values)
    scans = [conditioned(k)[0] for k in range(16)]
    slips = [estimate.step(scan) for scan in scans]

    def watch(k: int) -> object:
        scan, own = scans[k % 16], slips[k % 16]
        scan.t_s[:] = own.t_s[:] = scan.t_s + 0.01 * 16  # evidence is of times that go on
        monitor.see(scan)
        return monitor.step(own)

    return {
        "stage condition": conditioned,
        "stage contacts": lambda k: segment.step(scans[k % 16]),
        "stage estimate": lambda k: estimate.step(scans[k % 16]),
        "stage monitor": watch,
        "stage fuse": lambda k: fuse.step(slips[k % 16], slips[k % 16].pose[..., :2]),
        "all stages": live_step(sensor, values),
    }


def live_step(sensor: Sensor, values: Floats) -> Callable[[int], Output]:
    """`Run.step` of a running stream. values: (16, taxels), readings that it is given in turn."""
    run = Pipeline(api.estimator("convolution"), mode="stream").start(Recording.live(sensor))
    return _fed(run.step, values)


def _fed(step: Callable[[RawScans], Result], values: Floats) -> Callable[[int], Result]:
    """A step that takes a row of values as its next scan; it has seen unloaded scans until it gave results."""
    seconds, random = (0.01 * k for k in count()), np.random.default_rng(0)
    while not len(step(RawScans(np.array([next(seconds)]), random.normal(0.0, _NOISE, (1, values.shape[1]))))):
        pass
    return lambda k: step(RawScans(np.array([next(seconds)]), values[k % 16 : k % 16 + 1]))


def _in_turn(steps: dict[str, Callable[[int], object]], effort: Effort) -> dict[str, Floats]:
    """Time the steps one after the other, round by round, so that a slow moment of the machine hits all alike."""
    for step in steps.values():
        step(0)
    start = perf_counter()
    next(iter(steps.values()))(1)  # the slowest
    rounds = int(np.clip(effort.budget_s / (perf_counter() - start), 20, effort.rounds))
    taken: dict[str, list[float]] = {what: [] for what in steps}
    gc.disable()
    try:
        for k in range(rounds):
            for what, step in steps.items():
                taken[what].append(last_of(step, k, 4))  # the first ones refill the caches that the others emptied
    finally:
        gc.enable()
    return {what: np.array(times) for what, times in taken.items()}


def _shares(recording: Recording, out: Path) -> tuple[int, list[Share]]:
    """Seconds per stage of one batch run, kernels compiled before."""
    warm = simulate(SCENARIOS["fast-stroke"])
    api.estimate(warm)
    spent = dict.fromkeys(_STAGES, 0.0)

    def timed(stage: str, start: float) -> float:
        now = perf_counter()
        spent[stage] += now - start
        return now

    start = perf_counter()
    lookahead = list(recording.blocks())
    start = timed("parsing", start)
    conditioner = Conditioner()
    condition = conditioner.start(recording.sensor, recording.masked, lookahead)
    start = timed("conditioning", start)
    blocks = list(recording.blocks())
    start = timed("parsing", start)
    estimate = start_slips(api.estimator("convolution"), recording.layout, "batch")
    monitor, fuse = SlipMonitor().watch(recording.layout, stream=True), RigidField().start(recording.layout)
    segment = ContactFeatures().start(recording.sensor, conditioner.contact_on, conditioner.contact_off, stream=True)
    with Tables(out, recording.layout.pads) as tables:
        for raw in blocks:
            start = perf_counter()
            scans = list(condition.step(cut(raw, 0, len(raw))))
            start = timed("conditioning", start)
            segmented = [segment.step(block) for block in scans]
            start = timed("segmenting", start)
            slips = [estimate.step(block.scans) for block in segmented]
            start = timed("estimating", start)
            found = []
            for block, own in zip(slips, segmented, strict=True):
                monitor.see(own.scans)
                found.append((block, monitor.step(block), fuse.step(block, own.contacts.centroid), own))
            start = timed("monitoring and fusing", start)
            for block, judged, motions, own in found:
                tables.write(block, judged.slipping, motions, judged.events, own.contacts, judged.evidence)
            timed("writing", start)
    return sum(map(len, blocks)), [Share(stage, s, s / sum(spent.values())) for stage, s in spent.items()]


def _starts() -> list[Start]:
    """Whole processes, in turn."""
    python = [sys.executable, "-c"]
    commands = {
        "import numpy": [*python, "import numpy"],
        "taxelflow --help": [*python, "from taxelflow.cli import main; main(['--help'])"],
        "taxelflow sensors": [*python, "from taxelflow.cli import main; main(['sensors'])"],
    }
    taken: dict[str, list[float]] = {name: [] for name in commands}
    for _ in range(7):
        for name, command in commands.items():
            start = perf_counter()
            subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
            taken[name].append(perf_counter() - start)
    base = float(np.median(taken["import numpy"]))
    return [Start(name, float(np.median(times)), float(np.median(times)) / base) for name, times in taken.items()]
