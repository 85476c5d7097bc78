"""Strokes that are harder than those of Table I: streamed, with dead or saturated taxels, of small objects.

The objects and lines are those of Table I's trials. Every case has the same ones, and its own bound.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow import api
from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.strokes import SPEEDS_MM_S, bounds, rms_of, trial, ungrouped
from taxelflow.evaluation.table1 import strokes_by
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from taxelflow.acquire.base import Recording
    from taxelflow.estimation.base import Mode
    from taxelflow.messages import Floats, Scans
    from taxelflow.simulation.scenario import Scenario, Solver

METHODS = ("template",)
_FAR_PERCENT = 1.0
_STREAMED = 4
_SMALL_M = 0.004
"""Eight millimetres across, on taxels of ten."""
_SATURATING_PA = 200e3
"""The sensor's full scale is 140 kPa."""
_INNER_TAXELS = (*range(144, 149), *range(151, 156))
"""Of the palm's two middle rows, between which the object slides, without those at the rows' ends."""
_DEAD = 2


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
    """A stroke that is more than 1 % off, or has no velocity (error_percent is None)."""

    nominal_mm_s: int
    method: str
    case: str
    seed: int
    stroke: int
    """In its recording, from 1."""
    error_percent: float | None


class Hard(msgspec.Struct, frozen=True):
    """All of one run."""

    seeds: int
    seed: int
    solver: str
    rows: list[HardRow]
    far: list[Far]
    silent: list[tuple[int, str, str]]
    """Speed, method and case of which no stroke has a velocity; they have no row."""


def _as_it_is(scans: Scans) -> Scans:
    return scans


@dataclass(frozen=True)
class _Case:
    """What is changed in a trial and how it is read; rows: names for some of its strokes each."""

    change: Callable[[Scenario], Scenario]
    rows: tuple[tuple[str, slice], ...]
    mode: Mode = "batch"
    prepared: Callable[[Scans], Scans] = _as_it_is


def hard(
    seeds: int,
    *,
    seed: int = 0,
    methods: Sequence[str] = (),
    solver: Solver = "analytic",
    watched: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> Hard:
    """Score `seeds` recordings of each case and speed. methods: the template if left out.

    Raises NameUnknown, ParameterInvalid, ExtraMissing (solver elastic).
    """
    chosen = tuple(methods) or METHODS
    errors: dict[tuple[int, str, str], list[Floats]] = {}
    limits: dict[tuple[int, str], list[Floats]] = {}
    far: list[Far] = []
    for number in watched(range(seeds)):
        for speed in SPEEDS_MM_S:
            for case in CASES:
                scenario = case.change(trial(seed + number, speed, solver))
                limit, found = _measured(scenario, case, chosen, speed)
                for name, own in case.rows:
                    limits.setdefault((speed, name), []).append(limit[own])
                    for method, error in found.items():
                        errors.setdefault((speed, method, name), []).append(error[own])
                        far += [Far(speed, method, name, scenario.seed, *one) for one in _far(error, own)]
    silent = [key for key, own in errors.items() if not np.isfinite(own).any()]
    rows = [_row(*key, own, limits[key[0], key[2]]) for key, own in errors.items() if key not in silent]
    for method in chosen:
        if method not in {row.method for row in rows}:
            raise ParameterInvalid("methods", method, "give a position: leave this method out")
    far = [one for one in far if (one.nominal_mm_s, one.method, one.case) not in silent]
    return Hard(seeds, seed, solver, rows, far, silent)


def _measured(
    scenario: Scenario, case: _Case, methods: Sequence[str], speed_mm_s: int
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


def _far(error: Floats, own: slice) -> list[tuple[int, float | None]]:
    """Number, from 1, and error of some strokes: those that are far off, or have no velocity."""
    strokes = list(enumerate(error.tolist(), 1))[own]
    return [(stroke, off if np.isfinite(off) else None) for stroke, off in strokes if not abs(off) <= _FAR_PERCENT]


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
        bound_percent=float(np.sqrt(np.mean(np.square(limit)))),
    )


def _plain(scenario: Scenario) -> Scenario:
    return scenario


def _repeated(scenario: Scenario) -> Scenario:
    return replace(scenario, motion=replace(scenario.motion, strokes=_STREAMED))


def _with_dead(scenario: Scenario) -> Scenario:
    dead = np.random.default_rng([scenario.seed, _DEAD]).choice(_INNER_TAXELS, _DEAD, replace=False)
    return replace(scenario, sensing=replace(scenario.sensing, dead=tuple(dead.tolist())))


def _small(scenario: Scenario) -> Scenario:
    return replace(scenario, contact=replace(scenario.contact, radius_m=_SMALL_M))


def _rolling(scenario: Scenario) -> Scenario:
    return replace(scenario, sensing=replace(scenario.sensing, scan_share=1.0))


def _saturating(scenario: Scenario) -> Scenario:
    return replace(scenario, contact=replace(scenario.contact, peak_pa=_SATURATING_PA))


def _dropped(scans: Scans) -> Scans:
    """Scans in which saturated readings are missing instead."""
    saturated = scans.pressure >= scans.ceiling
    return replace(
        scans,
        pressure=np.where(saturated, 0.0, scans.pressure),
        complete=scans.complete & ~saturated.any(axis=1, keepdims=True),
    )


def _all(name: str) -> tuple[tuple[str, slice], ...]:
    return ((name, slice(None)),)


CASES = (
    _Case(_plain, _all("as in Table I")),
    _Case(_repeated, (("stream, 1st stroke", slice(1)), ("stream, 2nd to 4th", slice(1, None))), "stream"),
    _Case(_with_dead, _all("2 unknown dead taxels")),
    _Case(_small, _all("smaller than a taxel")),
    _Case(_rolling, _all("rolling scan")),
    _Case(_saturating, _all("saturated, censored")),
    _Case(_saturating, _all("saturated, dropped"), prepared=_dropped),
)
