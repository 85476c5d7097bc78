"""Score live: what a live loop costs, by own processor time, and how late its results are by the clock on the wall."""

from __future__ import annotations

import gc
import os
import resource
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from numba.core import event

from taxelflow.acquire.base import Recording
from taxelflow.evaluation.base import Table, Watch, table_of, unwatched
from taxelflow.evaluation.live_hand import loaded_hand
from taxelflow.evaluation.live_late import LateRow, late_rows
from taxelflow.messages import RawScans, cut
from taxelflow.pipeline.live.api import Live
from taxelflow.pipeline.live.command import opened_sinks
from taxelflow.pipeline.live.latency import Latencies
from taxelflow.pipeline.live.loop import Limits, run_live
from taxelflow.pipeline.live.replay import Replay
from taxelflow.publish.quiet import quiet_table
from taxelflow.runtime.checks import at_least, not_negative, positive

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import Console

    from taxelflow.sensors.sensor import Sensor


class StepRow(msgspec.Struct, frozen=True):
    """Own processor time of one step, all stages, flat out."""

    method: str
    rate_hz: float
    scans: int
    p50_ms: float
    p99_ms: float
    p99_9_ms: float
    longest_ms: float
    over_2_ms: int
    compiled: int
    """Kernels that were compiled after the start."""


class HandsRow(msgspec.Struct, frozen=True):
    """Several hands in one process; what learns beside them is not counted."""

    method: str
    hands: int
    core_share: float
    """Processor time of the thread over the time that the scans take."""


class PacedRow(msgspec.Struct, frozen=True):
    """A paced run with two sinks, from arrival to written, by the clock on the wall."""

    method: str
    rate_hz: float
    seconds: float
    scans_in: int
    dropped: int
    p50_ms: float
    p99_ms: float
    longest_ms: float
    load_average: float
    """Of the machine, during the run: a figure from a busy machine is of little use."""
    core_wait: float
    """Share of the run's time for which the thread of the estimate waited for a processor; NaN where the system does
    not report it."""
    resident_mb: float
    growth: float
    """Of the resident memory, from a fifth of the run to its end, as a share."""


class HistogramRow(msgspec.Struct, frozen=True):
    """Latencies of a paced run, in thirds of decades."""

    method: str
    from_ms: float
    to_ms: float
    scans: int


class LiveReport(msgspec.Struct, frozen=True):
    """All tables."""

    steps: list[StepRow]
    hands: list[HandsRow]
    paced: list[PacedRow]
    histogram: list[HistogramRow]
    late: list[LateRow]

    def tables(self) -> list[Table]:
        """See `Score`."""
        return [
            table_of("steps", self.steps, StepRow),
            table_of("hands", self.hands, HandsRow),
            table_of("paced", self.paced, PacedRow),
            table_of("histogram", self.histogram, HistogramRow),
            table_of("late", self.late, LateRow),
        ]

    def show(self) -> None:
        """Print them."""
        from rich.console import Console

        _show(self, Console(markup=False, highlight=False, soft_wrap=True))


@dataclass(frozen=True)
class LiveBench:
    """Measure own CPU and latency of a live loop."""

    methods: tuple[str, ...] = ("convolution", "template")
    """Estimators."""
    rate_hz: float = 1000.0
    """Rate of the scans of one hand, Hz."""
    hands: int = 10
    """Number of hands that one process estimates, each at 100 Hz; 1 or more."""
    seconds: float = 20.0
    """Duration of the scans that are processed without pauses, s."""
    paced_s: float = 10.0
    """Duration of the paced run, s; 600 for loops that run all day."""
    late_seeds: int = 1
    """Number of seeds for the table of what late learning costs; 0 leaves it out."""
    late_seed: int = 0
    """First seed of that table."""

    def __post_init__(self) -> None:
        at_least("hands", self.hands, 1)
        for name in ("rate_hz", "seconds", "paced_s"):
            positive(name, getattr(self, name))
        for name in ("late_seeds", "late_seed"):
            not_negative(name, getattr(self, name))

    def run(self, watched: Watch = unwatched) -> LiveReport:
        """Measure."""
        sensor, scans = loaded_hand(self.seconds, self.rate_hz)
        _, slow = loaded_hand(10.0, 100.0)
        steps, hands, paced, histogram = [], [], [], []
        for method in watched(self.methods, "methods"):
            steps.append(_steps(method, sensor, scans, self.rate_hz))
            hands.append(_hands(method, sensor, slow, self.hands))
            row, latencies = _paced(method, sensor, scans, self.rate_hz, self.paced_s)
            paced.append(row)
            histogram += [
                HistogramRow(method, 1e3 * least, 1e3 * most, count) for least, most, count in latencies.decades()
            ]
        late = list(late_rows(range(self.late_seed, self.late_seed + self.late_seeds))) if self.late_seeds else []
        return LiveReport(steps, hands, paced, histogram, late)


class _Compiles(event.Listener):
    """Counts kernels as they are compiled."""

    def __init__(self) -> None:
        self.count = 0

    def on_start(self, _event: object) -> None:
        self.count += 1

    def on_end(self, _event: object) -> None:
        """Counted at the start."""


def _steps(method: str, sensor: Sensor, scans: RawScans, rate_hz: float) -> StepRow:
    live, compiles = Live(sensor, method), _Compiles()
    spent = np.zeros(len(scans))
    gc.collect()
    gc.freeze()
    with event.install_listener("numba:compile", compiles):
        for scan in range(len(scans)):
            block = cut(scans, scan, scan + 1)
            began = time.thread_time()
            live.push(block)
            spent[scan] = time.thread_time() - began
        live.finish()
    gc.unfreeze()
    settled = 1e3 * spent[50:]  # noise is learned from the first ones
    p50, p99, p99_9 = np.quantile(settled, [0.5, 0.99, 0.999]).tolist()
    over = int(np.sum(settled > 2.0))
    return StepRow(method, rate_hz, len(scans), p50, p99, p99_9, float(settled.max()), over, compiles.count)


def _hands(method: str, sensor: Sensor, scans: RawScans, count: int) -> HandsRow:
    lives = [Live(sensor, method) for _ in range(count)]
    began = time.process_time()
    for scan in range(len(scans)):
        block = cut(scans, scan, scan + 1)
        for live in lives:
            live.push(block)
    for live in lives:
        live.finish()
    spent = time.process_time() - began
    return HandsRow(method, count, 100.0 * spent / len(scans))


def _paced(method: str, sensor: Sensor, scans: RawScans, rate_hz: float, seconds: float) -> tuple[PacedRow, Latencies]:
    """A run at true pace into a file of JSON lines and one of MCAP."""
    wanted = round(seconds * rate_hz)

    def read() -> Iterator[RawScans]:
        done = 0
        while done < wanted:
            block = cut(scans, 0, min(len(scans), wanted - done))
            yield RawScans(block.t_s + done / rate_hz, block.values)
            done += len(block)

    source = Replay(Recording("paced hand", "rig", sensor, read, scans=wanted), speed=1.0)
    memory: list[float] = []
    live = Live(sensor, method)
    began_s, waited_s = time.monotonic(), _core_wait_s()
    with tempfile.TemporaryDirectory() as folder:
        sinks = opened_sinks((f"jsonl:{Path(folder) / 'a.jsonl'}", f"mcap:{Path(folder) / 'a.mcap'}?draw=0"))
        report = run_live(source, sinks, live, Limits(), method, lambda _: memory.append(resident_mb()))
    core_wait = (_core_wait_s() - waited_s) / (time.monotonic() - began_s)
    seen = report.workers[0].latencies
    settled = memory[len(memory) // 5 :] or [resident_mb()]
    row = PacedRow(
        method,
        rate_hz,
        seconds,
        report.intake.scans_in,
        report.intake.dropped + sum(worker.dropped for worker in report.workers),
        1e3 * seen.quantile_s(0.5),
        1e3 * seen.quantile_s(0.99),
        1e3 * seen.longest_s,
        os.getloadavg()[0],
        core_wait,
        settled[-1],
        settled[-1] / settled[0] - 1.0,
    )
    return row, seen


def _core_wait_s() -> float:
    """Time for which this thread has waited for a processor, s; NaN where the system does not report it."""
    scheduled = Path("/proc/thread-self/schedstat")
    return 1e-9 * int(scheduled.read_text().split()[1]) if scheduled.exists() else np.nan


def resident_mb() -> float:
    """Resident memory now where the system reports it, else the largest so far."""
    status = Path("/proc/self/statm")
    if status.exists():
        return int(status.read_text().split()[1]) * resource.getpagesize() / 1e6
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def _show(report: LiveReport, console: Console) -> None:
    headings = ("step:", "p50 ms", "p99", "p99.9", "longest", "over 2 ms", "compiled")
    steps = quiet_table(*headings, title="own CPU, flat out")
    for row in report.steps:
        times = (row.p50_ms, row.p99_ms, row.p99_9_ms, row.longest_ms)
        steps.add_row(row.method, *(f"{ms:.3f}" for ms in times), str(row.over_2_ms), str(row.compiled))
    console.print(steps)
    for hands in report.hands:
        console.print(f"{hands.method}: {hands.hands} hands at 100 Hz take {100 * hands.core_share:.0f} % of a core")
    for paced in report.paced:
        console.print(
            f"{paced.method}: {paced.scans_in} scans at {paced.rate_hz:g} Hz, {paced.dropped} dropped; to the file p50 "
            f"{paced.p50_ms:.2f}, p99 {paced.p99_ms:.2f}, longest {paced.longest_ms:.1f} ms; "
            f"{paced.resident_mb:.0f} MB, growth {100 * paced.growth:+.1f} %; load average {paced.load_average:.1f}, "
            f"{100 * paced.core_wait:.1f} % of the time waited for a core"
        )
        for bar in report.histogram:
            if bar.method == paced.method:
                drawn = "#" * max(1, round(50 * bar.scans / paced.scans_in)) if bar.scans else ""
                console.print(f"  {bar.from_ms:9.3f} to {bar.to_ms:9.3f} ms {bar.scans:8d} {drawn}")
    for late in report.late:
        console.print(
            f"{late.scenario}: learned {late.delay_s:g} s late: {late.rms_mm:.3f} mm rms, {late.ratio:.2f} times that "
            f"without delay, {100 * late.posed:.0f} % of scans ok"
        )
