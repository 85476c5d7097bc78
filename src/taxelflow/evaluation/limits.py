"""Estimators against the Cramér-Rao bound of a rig's scenario, and whether their covariances are honest.

What an estimator calls the object's place is some point of its body at some angle, which nothing in the scans fixes.
So errors are what is left of a contact's poses when one constant body offset and one constant angle, those that fit
best (weights: information at the known bound), were taken off; a contact begins anew where the pad was free or the
estimator was lost. Scans whose bound with a known pattern is a quarter of a pitch or more are not scored.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import process_time
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow import api, registry
from taxelflow.errors import NameUnknown, ParameterInvalid
from taxelflow.evaluation.bound import Bound, bound_of
from taxelflow.evaluation.nees import SPANS, Consistency, consistency
from taxelflow.evaluation.strokes import rms_of, ungrouped
from taxelflow.geometry import rotation
from taxelflow.messages import LOST, OK
from taxelflow.simulation.motion import move
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import NDArray

    from taxelflow.estimation.base import Mode
    from taxelflow.messages import Bools, Floats, Slips
    from taxelflow.simulation.scenario import Scenario, Solver

AXES = ("x", "y", "theta")
SETS = ("all", "ok")
_UNITS = (1e3, 1e3, float(np.degrees(1.0)))
_FEWEST = 3
_BINS_A_PITCH = 4


class LimitsRow(msgspec.Struct, frozen=True):
    """Error of one method along one axis, in mm or degrees, over all seeds."""

    method: str
    scans: str
    """all: every scored scan with a pose. ok: those whose quality is ok."""
    axis: str
    count: int
    rms: float
    standard_error: float | None
    """Of rms, from the scatter among contacts; None for a single one."""
    bound: float | None
    """RMS over the same scans of the bound with the pattern known; None for a turn that cannot be observed."""
    over_known: float | None
    """RMS of each scan's error over its own bound with the pattern known: 1 is the best there is."""
    over_unknown: float | None
    """The same with the pattern unknown; None where the scenario's pattern changes as the object moves."""


class SinceRow(msgspec.Struct, frozen=True):
    """Error of the object's motion since the first scored scan of each contact, in mm or degrees, over all seeds."""

    method: str
    axis: str
    count: int
    rms: float
    standard_error: float | None
    """Of rms, from the scatter among contacts; None for a single one."""
    last: float
    """RMS over contacts of the error in their last scan: the drift."""
    known: float | None
    unknown: float | None
    """RMS of the bound of the same motions, pattern known and unknown."""


class Seconds(msgspec.Struct, frozen=True):
    """Processor time that a method took for one recording through the whole pipeline, s: median over the seeds."""

    method: str
    median: float


class ConsistencyRow(msgspec.Struct, frozen=True):
    """Whether a method's covariance holds over some scans: see `Consistency`."""

    method: str
    scans: str
    over: int
    found: Consistency


class Place(msgspec.Struct, frozen=True):
    """Error of one method along the pad's axis on which the object travels most, by true position; RMS in mm."""

    method: str
    axis: str
    at_mm: float
    """Middle of a bin a quarter of a pitch wide."""
    error_mm: float
    known_mm: float
    unknown_mm: float | None
    count: int


class Limits(msgspec.Struct, frozen=True):
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


@dataclass(frozen=True, slots=True)
class Errors:
    """One method on one seed. error: (scans, 3) in m, m, rad, NaN where unknown; since: (scans, 3), the same of the
    motion since the contact's first scan. covariance: (scans, 3, 3) as the estimator gave it. ok: (scans,). piece:
    (scans,), number of the contact.
    """

    error: Floats
    since: Floats
    covariance: Floats
    ok: Bools
    piece: NDArray[np.int64]
    bound: Bound


def limits(
    scenario: str,
    seeds: int,
    *,
    seed: int = 0,
    mode: Mode = "batch",
    solver: Solver = "analytic",
    methods: Sequence[str] = (),
    watched: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> Limits:
    """Score estimators (all registered ones that know a position, if none is named) on `seeds` seeds of a scenario.

    Raises NameUnknown, ParameterInvalid, ExtraMissing (solver elastic).
    """
    if scenario not in SCENARIOS:
        raise NameUnknown("scenario", scenario, SCENARIOS)
    kinds = {method: api.estimator(method) for method in methods or registry.names("estimator")}
    found: dict[str, list[Errors]] = {method: [] for method in kinds}
    took: dict[str, list[float]] = {method: [] for method in kinds}
    contact = 0
    for number in watched(range(seeds)):
        drawn = replace(SCENARIOS[scenario], seed=seed + number, solver=solver)
        recording = ungrouped(simulate(drawn))
        bound = bound_of(drawn, recording.known_truth.t_s)
        pad = recording.layout.pads.index(drawn.pad)
        pitch_mm = 1e3 * float(recording.layout.pitch_m[pad].min())
        for method, kind in kinds.items():
            begun = process_time()
            slips = api.estimate(recording, kind, mode=mode).slips
            took[method].append(process_time() - begun)
            found[method].append(errors_of(drawn, recording.known_truth.t_s, slips, pad, bound))
        contact += int(slips.contact[:, pad].sum())
    without = [method for method, own in found.items() if not any(np.isfinite(one.error).any() for one in own)]
    if methods and without:
        raise ParameterInvalid("methods", ", ".join(without), "give a position: leave these methods out")
    kept = {method: own for method, own in found.items() if method not in without}
    return Limits(
        scenario=scenario,
        solver=solver,
        mode=mode,
        seeds=seeds,
        seed=seed,
        scored=sum(int(one.bound.scored.sum()) for one in next(iter(found.values()))),
        contact=contact,
        rows=[row for method, own in kept.items() for row in _rows(method, own)],
        since=[row for method, own in kept.items() for row in _sinces(method, own)],
        seconds=[Seconds(method, float(np.median(took[method]))) for method in kept],
        consistency=[row for method, own in kept.items() for row in _consistencies(method, own)],
        places=[place for method, own in kept.items() for place in _places(method, own, pitch_mm / _BINS_A_PITCH)],
        without=without,
    )


def errors_of(scenario: Scenario, t_s: Floats, slips: Slips, pad: int, bound: Bound) -> Errors:
    """Errors of one run, each contact's constant body offset and angle taken off. t_s: (scans,), true times."""
    pose, quality, lag_s = slips.pose[:, pad], slips.quality[:, pad], slips.lag_s[:, pad]
    true = move(scenario.motion, t_s - np.nan_to_num(lag_s), scenario.seed).pose
    known = bound.scored & np.isfinite(pose[:, :2]).all(axis=1) & (quality != LOST)
    broken = ~slips.contact[:, pad] | (quality == LOST)
    piece = np.cumsum(broken)
    error, since = np.full(pose.shape, np.nan), np.full(pose.shape, np.nan)
    for number in np.unique(piece[known]):
        own = np.flatnonzero(known & (piece == number))
        if len(own) >= _FEWEST:
            error[own] = without_frame(pose[own], true[own], bound.known[own])
            since[own[1:]] = _moved(pose[own], true[own])
    return Errors(error, since, slips.covariance[:, pad], quality == OK, piece, bound)


def without_frame(pose: Floats, true: Floats, deviation: Floats) -> Floats:
    """What is left of poses (scans, 3) of a body point when it was put where it fits the true poses best.

    deviation: (scans, 3), how sure each is, NaN for a turn that nothing tells.
    """
    turn = rotation(true[:, 2])
    apart = pose[:, :2] - true[:, :2]
    in_body = np.einsum("kji,kj->ki", turn, apart)
    weight = 1 / np.sum(deviation[:, :2] ** 2, axis=1)
    body = weight @ in_body / weight.sum()
    error = np.full(pose.shape, np.nan)
    error[:, :2] = apart - turn @ body
    sure = np.where(np.isfinite(deviation[:, 2]), 1 / deviation[:, 2] ** 2, 1.0) * np.isfinite(pose[:, 2])
    turned = np.nan_to_num(pose[:, 2] - true[:, 2])
    off = turned - np.angle(np.sum(sure * np.exp(1j * turned)))
    error[:, 2] = np.where(np.isfinite(pose[:, 2]), (off + np.pi) % (2 * np.pi) - np.pi, np.nan)
    return error


def _moved(pose: Floats, true: Floats) -> Floats:
    """Errors (scans - 1, 3) of the motion since the first scan, of the object's centre.

    Turns count from the first one that is known; where none is, the true turn carries the point that is followed.
    """
    gap = pose[:, 2] - true[:, 2]
    told = np.flatnonzero(np.isfinite(gap))
    turned = (gap - (gap[told[0]] if len(told) else 0.0) + np.pi) % (2 * np.pi) - np.pi
    way = rotation(true[:, 2] - true[0, 2] + np.nan_to_num(turned))
    centre = pose[:, :2] + way @ (true[0, :2] - pose[0, :2])
    turned[told[:1]] = np.nan
    return np.column_stack([centre - true[:, :2], turned])[1:]


def _chosen(one: Errors, scans: str) -> Bools:
    known: Bools = np.isfinite(one.error[:, 0])
    return known & one.ok if scans == "ok" else known


def _consistencies(method: str, own: list[Errors]) -> list[ConsistencyRow]:
    rows = []
    for scans in SETS:
        contacts = [piece for one in own for piece in _pieces(one, scans)]
        rows += [ConsistencyRow(method, scans, over, consistency(contacts, over)) for over in SPANS]
    return [row for row in rows if row.found.pairs]


def _pieces(one: Errors, scans: str) -> list[tuple[Floats, Floats]]:
    """Errors and covariances of each contact, scan by scan from its first to its last, NaN where not chosen."""
    chosen = _chosen(one, scans)
    error = np.where(chosen[:, np.newaxis], one.error, np.nan)
    cuts = [np.flatnonzero(chosen & (one.piece == number)) for number in np.unique(one.piece[chosen])]
    spans = [slice(cut[0], cut[-1] + 1) for cut in cuts]
    return [(error[span], one.covariance[span]) for span in spans]


def _rows(method: str, own: list[Errors]) -> list[LimitsRow]:
    rows = []
    for scans in SETS:
        chosen = [_chosen(one, scans) for one in own]
        for axis, unit in enumerate(_UNITS):
            error, known, unknown = (
                np.concatenate([array[use, axis] for array, use in zip(arrays, chosen, strict=True)])
                for arrays in (
                    [one.error for one in own],
                    [one.bound.known for one in own],
                    [one.bound.unknown for one in own],
                )
            )
            there = np.isfinite(error)
            if there.any():
                rms, standard_error = rms_of(_by_contact(own, chosen, axis, unit))
                rows.append(
                    LimitsRow(
                        method=method,
                        scans=scans,
                        axis=AXES[axis],
                        count=int(there.sum()),
                        rms=rms,
                        standard_error=standard_error,
                        bound=_known(unit * _rms(known[there])),
                        over_known=_over(error[there], known[there]),
                        over_unknown=_over(error[there], unknown[there]),
                    )
                )
    return rows


def _by_contact(own: list[Errors], chosen: list[Bools], axis: int, unit: float) -> list[Floats]:
    """Errors of the chosen scans along one axis, in mm or degrees, contact by contact."""
    known = [use & np.isfinite(one.error[:, axis]) for one, use in zip(own, chosen, strict=True)]
    return [
        unit * one.error[there & (one.piece == number), axis]
        for one, there in zip(own, known, strict=True)
        for number in np.unique(one.piece[there])
    ]


def _sinces(method: str, own: list[Errors]) -> list[SinceRow]:
    rows = []
    for axis, unit in enumerate(_UNITS):
        known = [np.isfinite(one.since[:, axis]) for one in own]
        contacts = [
            unit * one.since[there & (one.piece == number), axis]
            for one, there in zip(own, known, strict=True)
            for number in np.unique(one.piece[there])
        ]
        if contacts:
            bounds = [
                _known(
                    unit * _rms(np.concatenate([bound[there, axis] for bound, there in zip(each, known, strict=True)]))
                )
                for each in ([one.bound.since_known for one in own], [one.bound.since_unknown for one in own])
            ]
            count = sum(map(len, contacts))
            last = _rms(np.array([errors[-1] for errors in contacts]))
            rows.append(SinceRow(method, AXES[axis], count, *rms_of(contacts), last, *bounds))
    return rows


def _places(method: str, own: list[Errors], width_mm: float) -> list[Place]:
    travelled = np.ptp(np.concatenate([one.bound.pose[one.bound.scored, :2] for one in own]), axis=0)
    axis = int(np.argmax(travelled))
    chosen = [_chosen(one, "all") for one in own]
    at, error, known, unknown = (
        1e3 * np.concatenate([array[use, axis] for array, use in zip(arrays, chosen, strict=True)])
        for arrays in (
            [one.bound.pose for one in own],
            [one.error for one in own],
            [one.bound.known for one in own],
            [one.bound.unknown for one in own],
        )
    )
    bins = np.floor(at / width_mm + 0.5).astype(np.int64)
    return [
        Place(
            method=method,
            axis=AXES[axis],
            at_mm=width_mm * float(number),
            error_mm=_rms(error[here]),
            known_mm=_rms(known[here]),
            unknown_mm=_known(_rms(unknown[here])),
            count=int(here.sum()),
        )
        for number in np.unique(bins)
        for here in [bins == number]
    ]


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _over(error: Floats, bound: Floats) -> float | None:
    """RMS of each error over its bound, where there is one."""
    there = np.isfinite(bound)
    return _rms(error[there] / bound[there]) if there.any() else None


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None
