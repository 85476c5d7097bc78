"""What latency and bandwidth of a gripper cost when the weight doubles at once, beside what no controller can avoid."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from rich.console import Console

from taxelflow.evaluation.base import Table, table_of
from taxelflow.evaluation.cells import number, shown
from taxelflow.evaluation.control import ControlReport
from taxelflow.numerics.gravity import G_M_S2
from taxelflow.simulation.mujoco.plant import Actuator
from taxelflow.simulation.mujoco.plants import TRIAL

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from taxelflow.evaluation.control import Outcome
    from taxelflow.simulation.mujoco.trial import Trial

GENTLE = 1.3
"""Force of the gentle bound over the least that holds the doubled weight."""


class SweepRow(msgspec.Struct, frozen=True):
    """Trials with one actuator; the weight doubles at once. slid, bounds: medians over the trials, mm.

    bound_full_mm: of a controller that commands the largest force from the first scan on in which the object moves.
    bound_gentle_mm: of one that commands 1.3 times the new least force then.
    """

    latency_ms: float
    bandwidth_hz: float
    trials: int
    grasped: int
    held: float | None
    within_5_mm: float | None
    slid_p50_mm: float | None
    slid_p90_mm: float | None
    force_p50: float | None
    bound_full_mm: float
    bound_gentle_mm: float


class SweepReport(msgspec.Struct, frozen=True):
    """A controller with slow and late grippers."""

    controller: str
    rows: list[SweepRow]

    def tables(self) -> list[Table]:
        """The rows."""
        return [table_of("actuator", self.rows, SweepRow)]

    def show(self) -> None:
        """Print the rows."""
        table = shown(
            self.rows,
            ("ms", lambda row: f"{row.latency_ms:g}"),
            ("Hz", lambda row: f"{row.bandwidth_hz:g}"),
            ("grasped", lambda row: f"{row.grasped}/{row.trials}"),
            ("held", lambda row: _share(row.held)),
            ("<5 mm", lambda row: _share(row.within_5_mm)),
            ("slid mm", lambda row: number(row.slid_p50_mm, 2)),
            ("p90", lambda row: number(row.slid_p90_mm, 2)),
            ("force", "force_p50", 2),
            ("full mm", lambda row: number(row.bound_full_mm, 2)),
            ("gentle mm", lambda row: number(row.bound_gentle_mm, 2)),
        )
        console = Console(markup=False, highlight=False, soft_wrap=True)
        console.print(f"{self.controller}: the weight doubles at once")
        console.print(table)
        for note in (
            "ms, Hz: latency and bandwidth of the gripper; slid, force over least: medians",
            f"full, gentle: medians of what is possible with the largest force, and with {GENTLE:g} times the least",
        ):
            console.print(note, style="dim")


def _share(share: float | None) -> str:
    return "-" if share is None else f"{share:.0%}"


def sweep(
    name: str,
    run: Callable[[Actuator], tuple[Sequence[Trial], Outcome]],
    latencies_ms: Sequence[float] = (0.0, 10.0, 20.0, 50.0),
    bandwidths_hz: Sequence[float] = (5.0, 10.0, 30.0),
) -> SweepReport:
    """Run the same trials with each actuator; run: trials with one of them."""
    rows = []
    for latency_ms, bandwidth_hz in product(latencies_ms, bandwidths_hz):
        actuator = Actuator(bandwidth_hz, 1e-3 * latency_ms)
        trials, outcome = run(actuator)
        rows.append(_row(actuator, trials, outcome.report))
    return SweepReport(name, rows)


def doubled_bound_m(
    trial: Trial, actuator: Actuator, command_n: float, rate_hz: float = 100.0, step_s: float = 1e-4
) -> float:
    """Way of an object whose weight doubles, from the first force on, if `command_n` follows in the first scan after.

    The scan in which the weight doubles ends before any command knows of it. A lag of first order follows the latency,
    which the plant rounds to scans. Infinite for a force that does not hold it within 2 s.
    """
    least_n = trial.least_n(TRIAL.event_s)
    late_s = (1.0 + round(actuator.latency_s * rate_hz)) / rate_hz
    since_s = np.maximum(np.arange(0.0, 2.0, step_s) - late_s, 0.0)
    shares = 1.0 - np.exp(-2.0 * np.pi * actuator.bandwidth_hz * since_s)
    force_n = trial.first_n + (min(command_n, actuator.max_n) - trial.first_n) * shares
    rising = G_M_S2 * (1.0 - force_n / least_n)  # m a = m g - 2 mu F, with the least force that carries m
    speed = step_s * np.cumsum(rising)
    rests = np.flatnonzero(speed <= 0.0)
    return float(step_s * speed[: rests[0]].sum()) if len(rests) else float("inf")


def _row(actuator: Actuator, trials: Sequence[Trial], report: ControlReport) -> SweepRow:
    grasped = [row for row in report.trials if row.grasped]
    slid = np.array([row.slid_mm for row in grasped])
    p50, p90 = (float(np.quantile(slid, share)) if len(slid) else None for share in (0.5, 0.9))
    full = [1e3 * doubled_bound_m(trial, actuator, actuator.max_n) for trial in trials]
    gentle = [1e3 * doubled_bound_m(trial, actuator, GENTLE * trial.least_n(TRIAL.event_s)) for trial in trials]
    return SweepRow(
        1e3 * actuator.latency_s,
        actuator.bandwidth_hz,
        len(report.trials),
        len(grasped),
        report.held,
        report.within_5_mm,
        p50,
        p90,
        report.force_p50,
        float(np.median(full)),
        float(np.median(gentle)),
    )
