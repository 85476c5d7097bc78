"""Score slip: slip events against truth, found how soon, missed, and how often a still object raises an alarm.

Slips: objects that stick and slip on a 16x16 grid at 100 Hz, live and as a recording whose slips are dated when all is
known. Holds: objects that stay where they are while load, growth, drift or gain change the readings. Rolling and
tilting stand apart: normal pressure does not distinguish them. Noise: poses of white noise straight into the slip
detector, the only case for which it promises its rate of false alarms.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from rich.console import Console
from scipy.stats import chi2

from taxelflow.estimation.base import Mode
from taxelflow.evaluation.base import table_of, unwatched
from taxelflow.evaluation.cells import Column, caption, shown
from taxelflow.evaluation.slip_scoring import MODES, NOISE, OBJECTS, Job, Tally, found_by
from taxelflow.pipeline import api
from taxelflow.runtime.checks import at_least, not_negative
from taxelflow.slip.parameters import SlipMonitor

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table as Shown

    from taxelflow.evaluation.base import Table, Watch

METHODS = ("template", "principal_axis", "convolution")
HOLDS = ("hold-pressed", "hold-at-edge", "hold-drifting", "hold-wobbling")
APART = ("roll", "tilt")
FRESH_SEED = 1000
"""Seeds below were used while the slip detector was made; the score's begin here."""


class SlipRow(msgspec.Struct, frozen=True):
    """One method on one object. Medians are over slips; latencies count from the first scan that is slipping."""

    object: str
    method: str
    mode: Mode
    """stream: scan by scan as they come. batch: as a recording, where onset_ms is the error of the date."""
    slips: int
    f1: float
    """Over scans: slipping as called against slipping in truth."""
    f1_oracle: float | None
    """That of `oracle.called` with this method's covariance; None for a batch, and where the poses lag or have none."""
    onset_ms: float
    onset_p90_ms: float
    onset_max_ms: float
    missed: int
    false: int
    """Slips begun while the object was still."""
    split: int
    """Slips started again within one slip."""
    dated_ms: float
    """Median error of the onset's own time, as first reported."""
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
    """Median of what the detector learned: scatter of a still object over the standard deviation of its covariance."""


@dataclass(frozen=True)
class Slip:
    """Measure slips found and missed, and false alarms an hour.

    Slips are found live and in a recording; false alarms are of objects that hold still and of white noise.
    """

    seeds: int = 10
    """Number of recordings of each object that sticks and slips, 0 or more."""
    seed: int = 0
    """Offset added to all seeds, which begin at 1000; 0 or more."""
    methods: tuple[str, ...] = METHODS
    """Estimators to score."""
    hours: float = 0.1
    """Duration of each scenario that holds an object still, h, 0 or more."""
    alarms_per_hour: float = 1.0
    """Accepted rate of false alarms of the slip detector, 1/h, above 0."""
    processes: int = 1
    """Number of recordings to process at the same time, 1 or more."""

    def __post_init__(self) -> None:
        at_least("seeds", self.seeds, 0)
        at_least("seed", self.seed, 0)
        at_least("processes", self.processes, 1)
        not_negative("hours", self.hours)
        SlipMonitor(alarms_per_hour=self.alarms_per_hour)  # refuses a rate that cannot be

    def run(self, watched: Watch = unwatched) -> SlipReport:
        """Simulate, estimate and detect; sum up by object or scenario, method and mode. Raises NameUnknown."""
        for method in self.methods:
            api.estimator(method)
        jobs = self._jobs()
        totals: dict[tuple[str, str, Mode], Tally] = defaultdict(Tally)
        for job, found in zip(watched(jobs, "recordings"), found_by(jobs, self.hours, self.processes), strict=True):
            for (method, mode), tally in found.items():
                totals[job.name, method, mode].add(tally)
        slid = [(name, method, mode) for name in OBJECTS for method in self.methods for mode in MODES if self.seeds]
        still = [(name, method) for name in (*HOLDS, *APART) for method in self.methods]
        still = [*still, (NOISE, NOISE)] if self.hours > 0 else []
        return SlipReport(
            alarms_per_hour=self.alarms_per_hour,
            seeds=self.seeds,
            first_seed=FRESH_SEED + self.seed,
            slips=[_slip_row(*key, totals[key]) for key in slid],
            holds=[_hold_row(name, method, totals[name, method, "stream"]) for name, method in still],
        )

    def _jobs(self) -> list[Job]:
        """Recordings of slips, then of still objects, then white noise."""
        first, rate = FRESH_SEED + self.seed, self.alarms_per_hour
        blocks = ceil(self.hours * 60) if self.methods else 0  # recordings of a minute
        names = [(name, k) for name in OBJECTS for k in range(self.seeds)]
        names += [(name, k) for name in (*HOLDS, *APART) for k in range(blocks)]
        jobs = [Job(name, first + k, self.methods, rate) for name, k in names]
        return [*jobs, Job(NOISE, first, (NOISE,), rate)] if self.hours > 0 else jobs


class SlipReport(msgspec.Struct, frozen=True):
    """All rows, the rate that was asked for, and where the seeds began."""

    alarms_per_hour: float
    seeds: int
    first_seed: int
    slips: list[SlipRow]
    holds: list[HoldRow]

    def tables(self) -> list[Table]:
        """Slips, then still objects."""
        return [table_of("slips", self.slips, SlipRow), table_of("holds", self.holds, HoldRow)]

    def show(self) -> None:
        """Slips found, then false alarms of still objects beside the rate that was asked for."""
        console = Console(markup=False)
        for mode, how in (("stream", "called live"), ("batch", "dated afterwards")):
            rows = [row for row in self.slips if row.mode == mode]
            if rows:
                count = max(row.slips for row in rows)  # the same of all: a seed's motion is that of any object
                seeds = f"{count} of each object in {self.seeds} recordings, seeds from {self.first_seed}"
                console.print(_slips_found(rows, f"slips, {how}: {seeds}"))
                console.print()
        if self.holds:
            console.print(self._still())
        caption(
            console,
            "best: F1 of an oracle that keeps the rate and knows place, velocity and "
            "covariance of the poses, only not when it slips. ms, p90: from the first "
            "slipping scan to the first called so. "
            "false: started while still. split: started again within a slip. deg, %: median "
            "error of a slip's direction and speed. 95 %: interval of the rate, called live. "
            "scatter: learned, over the covariance's. roll and tilt are no slips, but "
            "pressure alone cannot separate them.",
        )

    def _still(self) -> Shown:
        title = f"still objects, {self.alarms_per_hour:g} false alarms an hour asked for, seeds from {self.first_seed}"
        return shown(
            self.holds,
            *(("scenario:", "scenario"), ("method:", "method"), ("hours", "hours", 2), ("alarms", "alarms")),
            ("an hour", lambda row: _rate(row.per_hour)),
            ("95 %:", lambda row: f"{_rate(row.low)} to {_rate(row.high)}"),
            ("scatter", "scatter", 2),
            title=title,
        )


def _rate(per_hour: float) -> str:
    return f"{per_hour:.0f}" if per_hour >= 100 else f"{per_hour:.2g}"


def _slips_found(rows: Sequence[SlipRow], title: str) -> Shown:
    live: list[Column] = [("best", "f1_oracle", 3)] if any(row.mode == "stream" for row in rows) else []
    return shown(
        rows,
        *(("object:", "object"), ("method:", "method"), ("F1", "f1", 3)),
        *live,
        *(("ms", "onset_ms", 0), ("p90", "onset_p90_ms", 0)),
        *(("miss", "missed"), ("false", "false"), ("split", "split")),
        *(("deg", "direction_deg", 0), ("%", "speed_percent", 0)),
        title=title,
    )


def _slip_row(name: str, method: str, mode: Mode, tally: Tally) -> SlipRow:
    latency = np.array(tally.latency_ms or [np.nan])
    return SlipRow(
        object=name,
        method=method,
        mode=mode,
        slips=len(tally.latency_ms) + tally.missed,
        f1=2 * tally.both / max(tally.true + tally.called, 1),
        f1_oracle=2 * tally.oracle_both / (tally.oracle_true + tally.oracle_called) if tally.oracle_true else None,
        onset_ms=float(np.median(latency)),
        onset_p90_ms=float(np.quantile(latency, 0.9)),
        onset_max_ms=float(latency.max()),
        missed=tally.missed,
        false=tally.false,
        split=tally.split,
        dated_ms=float(np.median(tally.dated_ms or [np.nan])),
        direction_deg=float(np.median(tally.direction_deg or [np.nan])),
        speed_percent=float(np.median(tally.speed_percent or [np.nan])),
    )


def _hold_row(name: str, method: str, tally: Tally) -> HoldRow:
    low = float(chi2.ppf(0.025, 2 * tally.alarms)) / 2 if tally.alarms else 0.0
    high = float(chi2.ppf(0.975, 2 * tally.alarms + 2)) / 2
    return HoldRow(
        scenario=name,
        method=method,
        hours=tally.hours,
        alarms=tally.alarms,
        per_hour=tally.alarms / tally.hours,
        low=low / tally.hours,
        high=high / tally.hours,
        scatter=float(np.median(tally.scatter)),
    )
