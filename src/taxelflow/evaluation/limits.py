"""Score limits: estimators against the Cramér-Rao bound of a rig's scenario, and the consistency of their covariances.

Errors are those of pose_errors. Scans whose bound with a known pattern is a quarter of a pitch or more are not scored.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import process_time
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from rich.console import Console
from tyro.conf import Positional

from taxelflow.errors import NameUnknown, ParameterInvalid
from taxelflow.estimation.base import Mode
from taxelflow.evaluation.base import Table, unwatched
from taxelflow.evaluation.bound import bound_of
from taxelflow.evaluation.cells import Column, caption, number, seeds_from, shown, solved_by
from taxelflow.evaluation.limits_rows import (
    ERROR,
    MOTION,
    NEES,
    TIME,
    UNITS,
    ConsistencyRow,
    LimitsRow,
    Place,
    SinceRow,
    consistency_rows,
    error_cells,
    error_rows,
    motion_cells,
    nees_cells,
    places,
    share,
    since_rows,
)
from taxelflow.evaluation.pose_errors import Errors, errors_of
from taxelflow.evaluation.strokes import ungrouped
from taxelflow.pipeline import api
from taxelflow.runtime import registry
from taxelflow.runtime.checks import at_least
from taxelflow.simulation.scenario import SCENARIOS, Solver
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from rich.table import Table as Shown

    from taxelflow.evaluation.base import Cell, Watch


class Seconds(msgspec.Struct, frozen=True):
    """Processor time that a method took for one recording through the whole pipeline, s: median over the seeds."""

    method: str
    median: float


@dataclass(frozen=True)
class Limits:
    """Compare estimators with the Cramér-Rao bound of a scenario.

    Their covariances are checked, too, and the drift of the motion since the first scan of a contact.
    """

    scenario: Positional[str] = "stroke"
    """Scenario of `taxelflow simulate`, on one pad."""
    seeds: int = 10
    """Number of recordings of the scenario, 1 or more."""
    seed: int = 0
    """Seed of the first recording, 0 or more; the others count up from it."""
    methods: tuple[str, ...] = ()
    """Estimators to score; all that give a position if left out."""
    mode: Mode = "batch"
    """Processing mode. batch: learn tare and noise from the whole recording first. stream: scan by scan, as from a live
    device."""
    solver: Solver = "analytic"
    """Contact model of the rig: analytic, or elastic (seconds a contact; extra `elastic`)."""

    def __post_init__(self) -> None:
        at_least("seeds", self.seeds, 1)
        at_least("seed", self.seed, 0)
        if self.scenario not in SCENARIOS:
            raise NameUnknown("scenario", self.scenario, SCENARIOS)

    def run(self, watched: Watch = unwatched) -> LimitsReport:
        """Simulate, estimate, compare. Raises NameUnknown, ParameterInvalid, ExtraMissing (solver elastic)."""
        runs = _Runs(self)
        for count in watched(range(self.seeds), "seeds"):
            runs.add(self.seed + count)
        found, without = runs.found, runs.without()
        if self.methods and without:
            raise ParameterInvalid("methods", ", ".join(without), "give a position: leave these methods out")
        kept = {method: own for method, own in found.items() if method not in without}
        return LimitsReport(
            scenario=self.scenario,
            solver=self.solver,
            mode=self.mode,
            seeds=self.seeds,
            seed=self.seed,
            scored=sum(int(one.bound.scored.sum()) for one in next(iter(found.values()))),
            contact=runs.contact,
            rows=[row for method, own in kept.items() for row in error_rows(method, own)],
            since=[row for method, own in kept.items() for row in since_rows(method, own)],
            seconds=[Seconds(method, float(np.median(runs.took_s[method]))) for method in kept],
            consistency=[row for method, own in kept.items() for row in consistency_rows(method, own)],
            places=[row for method, own in kept.items() for row in places(method, own, runs.pitch_mm / 4)],
            without=without,
        )


class _Runs:
    """Errors and processor time by method, recording by recording."""

    def __init__(self, asked: Limits) -> None:
        self._asked = asked
        self._kinds = {method: api.estimator(method) for method in asked.methods or registry.names("estimator")}
        self.found: dict[str, list[Errors]] = {method: [] for method in self._kinds}
        self.took_s: dict[str, list[float]] = {method: [] for method in self._kinds}
        self.contact = 0
        self.pitch_mm = 0.0

    def add(self, seed: int) -> None:
        """Simulate the scenario with this seed and estimate it by every method."""
        asked = self._asked
        drawn = replace(SCENARIOS[asked.scenario], seed=seed, solver=asked.solver)
        recording = ungrouped(simulate(drawn))
        t_s = recording.known_truth.t_s
        bound = bound_of(drawn, t_s)
        pad = recording.layout.pads.index(drawn.pad)
        self.pitch_mm = 1e3 * float(recording.layout.pitch_m[pad].min())
        for method, kind in self._kinds.items():
            begun = process_time()
            slips = api.estimate(recording, kind, mode=asked.mode).slips
            self.took_s[method].append(process_time() - begun)
            self.found[method].append(errors_of(drawn, t_s, slips, pad, bound))
        self.contact += int(slips.contact[:, pad].sum())

    def without(self) -> list[str]:
        """Methods that gave no position."""
        return [method for method, own in self.found.items() if not any(np.isfinite(one.error).any() for one in own)]


class LimitsReport(msgspec.Struct, frozen=True):
    """All of one scenario."""

    scenario: str
    solver: str
    mode: str
    seeds: int
    seed: int
    scored: int
    """Scans, over all seeds, whose bound is below a quarter of a pitch."""
    contact: int
    """Scans, over all seeds, in which the pad was in contact."""
    rows: list[LimitsRow]
    since: list[SinceRow]
    seconds: list[Seconds]
    consistency: list[ConsistencyRow]
    places: list[Place]
    without: list[str]
    """Methods that gave no position."""

    def tables(self) -> list[Table]:
        """Errors over the bound, motion since the first scan, NEES, errors by place, processor time.

        Every row begins with scenario, mode and number of seeds, so that files of several runs can be joined.
        """
        return [
            self._table("error", ERROR, map(error_cells, self.rows)),
            self._table("motion", MOTION, map(motion_cells, self.since)),
            self._table("nees", NEES, map(nees_cells, self.consistency)),
            self._table("place", Place.__struct_fields__, map(msgspec.structs.astuple, self.places)),
            self._table("time", TIME, map(msgspec.structs.astuple, self.seconds)),
        ]

    def _table(self, name: str, columns: Iterable[str], rows: Iterable[tuple[Cell, ...]]) -> Table:
        run = (self.scenario, self.mode, self.seeds)
        return Table(name, ("scenario", "mode", "seeds", *columns), [(*run, *row) for row in rows])

    def show(self) -> None:
        """Errors over the bound, motion since the first scan, then the consistency of covariances."""
        console = Console(markup=False)
        console.print(self._errors())
        caption(
            console,
            f"{self.scored} scans of {self.contact} in contact are scored: their bound is below a "
            "quarter of a pitch. ok: scans whose quality is ok. bound: Cramér-Rao, gain "
            "and baseline unknown, RMS over the same scans. x known, x unknown: RMS of each "
            "scan's error over its own bound, the object's pattern known and unknown; 1 is "
            "the best without further knowledge. One constant offset a contact is taken off. "
            "±%: standard error of the RMS, from the scatter among contacts.",
        )
        console.print()
        console.print(_since(self.since))
        caption(
            console,
            "Nothing is fitted or taken off. last: RMS over contacts of the error in their "
            "last scan. bound, unknown: of the same motion, the pattern known and unknown. "
            "Processor time of a recording, s: " + ", ".join(f"{one.method} {one.median:.2f}" for one in self.seconds),
        )
        console.print()
        console.print(_consistency(self.consistency))
        if self.without:
            caption(console, f"no position, so not scored: {', '.join(self.without)}")

    def _errors(self) -> Shown:
        ran = f"{self.scenario}, {self.mode}, {seeds_from(self.seed, self.seeds)}{solved_by(self.solver)}"
        return shown(
            self.rows,
            *(("method:", "method"), ("scans:", "scans"), ("n", "count"), _AXIS),
            ("RMS", _digits("rms")),
            ("±%", lambda row: number(share(row), 0)),
            ("bound", _digits("bound")),
            *(("x known", "over_known", 2), ("x unknown", "over_unknown", 2)),
            title=f"{ran}: error over the bound",
        )


def _since(rows: Sequence[SinceRow]) -> Shown:
    return shown(
        rows,
        *(("method:", "method"), ("n", "count"), _AXIS),
        ("RMS", _digits("rms")),
        ("±%", lambda row: number(share(row), 0)),
        *(("last", _digits("last")), ("bound", _digits("known")), ("unknown", _digits("unknown"))),
        title="motion since the first scan of a contact, and its bound",
    )


def _consistency(rows: Sequence[ConsistencyRow]) -> Shown:
    return shown(
        rows,
        *(("method:", "method"), ("scans:", "scans"), ("over", "over")),
        ("NEES", lambda row: number(row.found.nees, 2)),
        ("95 % band:", lambda row: f"{row.found.low:.2f}..{row.found.high:.2f}"),
        ("pairs", lambda row: str(row.found.pairs)),
        ("independent", lambda row: f"{row.found.independent:.0f}"),
        title="NEES of pose differences a degree of freedom; 1: the covariance is right",
    )


_AXIS: Column = ("axis:", lambda row: f"{row.axis} {UNITS[row.axis]}")


def _digits(field: str) -> Callable[[Any], str]:
    """A number in mm, or in degrees with one decimal less."""
    return lambda row: number(getattr(row, field), 3 if row.axis == "theta" else 4)
