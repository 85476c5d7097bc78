"""Score hard: strokes that are harder than those of Table I: streamed, with dead or saturated taxels, of small objects.

The objects and lines are those of Table I's trials. Every case has the same ones, and its own bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from rich.console import Console

from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.base import table_of, unwatched
from taxelflow.evaluation.cells import caption, short, shown, solved_by
from taxelflow.evaluation.hard_cases import CASES
from taxelflow.evaluation.statistics import rms
from taxelflow.evaluation.strokes import TABLE1, bounds, rms_of, strokes_by, trial, ungrouped
from taxelflow.pipeline import api
from taxelflow.runtime.checks import at_least
from taxelflow.simulation.scenario import Solver
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table as Shown

    from taxelflow.acquire.base import Recording
    from taxelflow.estimation.base import Mode
    from taxelflow.evaluation.base import Table, Watch
    from taxelflow.evaluation.hard_cases import Case
    from taxelflow.messages import Floats, Scans
    from taxelflow.simulation.scenario import Scenario

METHODS = ("template",)


class HardRow(msgspec.Struct, frozen=True):
    """Errors of the velocities of one case's strokes, all scans in contact, uncalibrated, in percent of the speed."""

    nominal_mm_s: int
    method: str
    case: str
    strokes: int
    """Those with a velocity."""
    rmse_percent: float
    standard_error_percent: float | None
    """Of rmse_percent, from the scatter among the recordings; None for a single one."""
    median_percent: float
    """Of the error's absolute value."""
    bias_percent: float
    bound_percent: float
    """The Cramér-Rao bound of the velocity, each scan by itself and the pattern known, RMS over the strokes."""


class Far(msgspec.Struct, frozen=True):
    """A stroke that is far off, or has no velocity (error_percent is None)."""

    nominal_mm_s: int
    method: str
    case: str
    seed: int
    stroke: int
    """In its recording, from 1."""
    error_percent: float | None


@dataclass(frozen=True)
class Hard:
    """Measure the velocity of strokes harder than Table I's.

    They are streamed, with dead or saturated taxels, with a rolling scan, or of an object smaller than a taxel.
    """

    seeds: int = 10
    """Number of recordings of each case and speed, 1 or more."""
    seed: int = 0
    """Seed of the first recording, 0 or more; the others count up from it."""
    methods: tuple[str, ...] = METHODS
    """Estimators to score."""
    far_percent: float = 1.0
    """Limit of a stroke's error, in percent of the speed, above which the stroke is listed."""
    solver: Solver = "analytic"
    """Contact model of the rig: analytic, or elastic (seconds a contact; extra `elastic`)."""

    def __post_init__(self) -> None:
        at_least("seeds", self.seeds, 1)
        at_least("seed", self.seed, 0)

    def run(self, watched: Watch = unwatched) -> HardReport:
        """Simulate every case, estimate, compare. Raises NameUnknown, ParameterInvalid, ExtraMissing (elastic)."""
        found = _Found(self.far_percent)
        for count in watched(range(self.seeds), "seeds"):
            for speed, case in product(TABLE1.speeds_mm_s, CASES):
                scenario = case.change(trial(self.seed + count, speed, self.solver))
                found.add(case, speed, scenario.seed, *_measured(scenario, case, self.methods, speed))
        rows = found.rows()
        for method in self.methods:
            if method not in {row.method for row in rows}:
                raise ParameterInvalid("methods", method, "give a position: leave this method out")
        return HardReport(self.seeds, self.seed, self.solver, rows, found.far(), found.silent())


class HardReport(msgspec.Struct, frozen=True):
    """All of one run."""

    seeds: int
    seed: int
    solver: str
    rows: list[HardRow]
    far: list[Far]
    silent: list[tuple[int, str, str]]
    """Speed, method and case of which no stroke has a velocity; they have no row."""

    def tables(self) -> list[Table]:
        """The rows, then the strokes that are far off."""
        return [table_of("rows", self.rows, HardRow), table_of("far", self.far, Far)]

    def show(self) -> None:
        """Errors by what makes the strokes hard, then the strokes that are furthest off."""
        console = Console(markup=False)
        far: dict[tuple[int, str, str], list[Far]] = {}
        for one in self.far:
            far.setdefault((one.nominal_mm_s, one.method, one.case), []).append(one)
        for method in dict.fromkeys(row.method for row in self.rows):
            console.print(self._shown(method, far))
        for (speed, method, case), strokes in sorted(far.items()):
            console.print(f"{short(method)}, {speed} mm/s, {case}: {_furthest(strokes)}", highlight=False)
        for speed, method, case in self.silent:
            console.print(f"{short(method)}, {speed} mm/s, {case}: no stroke has a velocity", highlight=False)
        caption(
            console,
            "All scans in contact, no factor. ±: standard error of the RMSE. median: of the "
            "error's absolute value. bound: Cramér-Rao, each scan by itself, pattern known "
            "(without saturated and dead taxels). far: strokes beyond --far-percent; below, the "
            "furthest as seed/stroke and error in %.",
        )

    def _shown(self, method: str, far: dict[tuple[int, str, str], list[Far]]) -> Shown:
        title = f"{short(method)}, {self.seeds} recordings a case, seed {self.seed}{solved_by(self.solver)}"
        own = sorted((row for row in self.rows if row.method == method), key=lambda row: row.nominal_mm_s)
        return shown(
            own,
            *(("mm/s", "nominal_mm_s"), ("strokes:", "case"), ("n", "strokes")),
            *(("RMSE %", "rmse_percent", 3), ("±", "standard_error_percent", 3), ("median", "median_percent", 3)),
            ("bias", lambda row: f"{row.bias_percent:+.3f}"),
            ("bound", "bound_percent", 3),
            ("far", lambda row: str(len(far.get((row.nominal_mm_s, method, row.case), ())))),
            title=title,
            section="nominal_mm_s",
        )


def _furthest(strokes: Sequence[Far], most: int = 6) -> str:
    """The strokes that are furthest off, those without a velocity first."""
    worst = sorted(strokes, key=lambda one: -abs(one.error_percent or float("inf")))
    named = [
        f"{one.seed}/{one.stroke} " + ("none" if one.error_percent is None else f"{one.error_percent:+.2f}")
        for one in worst[:most]
    ]
    return ", ".join(named) + (", ..." if len(worst) > most else "")


class _Found:
    """Errors of all strokes by speed, method and case, recording by recording."""

    def __init__(self, far_percent: float) -> None:
        self._far_percent = far_percent
        self._errors: dict[tuple[int, str, str], list[Floats]] = {}
        self._bounds: dict[tuple[int, str], list[Floats]] = {}
        self._far: list[Far] = []

    def add(self, case: Case, speed: int, seed: int, bound: Floats, errors: dict[str, Floats]) -> None:
        """Count one recording. bound, errors by method: (strokes,), percent of the speed."""
        for name, own in case.rows:
            self._bounds.setdefault((speed, name), []).append(bound[own])
            for method, error in errors.items():
                self._errors.setdefault((speed, method, name), []).append(error[own])
                self._far += [Far(speed, method, name, seed, *one) for one in _far(error, own, self._far_percent)]

    def silent(self) -> list[tuple[int, str, str]]:
        """Speed, method and case without any velocity."""
        return [key for key, own in self._errors.items() if not np.isfinite(own).any()]

    def rows(self) -> list[HardRow]:
        """A row for each speed, method and case with a velocity."""
        silent = self.silent()
        return [_row(*key, own, self._bounds[key[0], key[2]]) for key, own in self._errors.items() if key not in silent]

    def far(self) -> list[Far]:
        """Strokes that are far off, in cases with a velocity."""
        silent = self.silent()
        return [one for one in self._far if (one.nominal_mm_s, one.method, one.case) not in silent]


def _measured(
    scenario: Scenario, case: Case, methods: Sequence[str], speed_mm_s: int
) -> tuple[Floats, dict[str, Floats]]:
    """(strokes,) of one recording: the bound of its velocities, and by method their errors, percent of the speed."""
    recording = ungrouped(simulate(scenario))
    scans = case.prepared(api.conditioned(recording))
    limit = np.array([100 * stroke.all / speed_mm_s for stroke in bounds(scenario, recording.known_truth)])
    return limit, {method: _errors(method, recording, scans, case.mode, speed_mm_s) for method in methods}


def _errors(method: str, recording: Recording, scans: Scans, mode: Mode, speed_mm_s: int) -> Floats:
    """(strokes,) of the speeds of one recording, percent of the nominal one, NaN where a stroke has none."""
    found = strokes_by(method, recording, scans, mode)
    return np.array([100 * ((-1 if one.backward else 1) * one.all / speed_mm_s - 1) for one in found])


def _far(error: Floats, own: slice, percent: float) -> list[tuple[int, float | None]]:
    """Number, from 1, and error of some strokes: those that are far off, or have no velocity."""
    strokes = list(enumerate(error.tolist(), 1))[own]
    return [(stroke, off if np.isfinite(off) else None) for stroke, off in strokes if not abs(off) <= percent]


def _row(speed: int, method: str, name: str, error: list[Floats], limit: list[Floats]) -> HardRow:
    """error, limit: (strokes,) of each recording."""
    errors = [one[np.isfinite(one)] for one in error]
    known = np.concatenate(errors)
    rmse, standard_error = rms_of(errors)
    return HardRow(
        nominal_mm_s=speed,
        method=method,
        case=name,
        strokes=len(known),
        rmse_percent=rmse,
        standard_error_percent=standard_error,
        median_percent=float(np.median(np.abs(known))),
        bias_percent=float(known.mean()),
        bound_percent=rms(limit),
    )
