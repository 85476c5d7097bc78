"""Rows of the score limits: errors over the bound, motion since the first scan, consistency, errors by place."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import numpy as np
from scipy.constants import degree, milli

from taxelflow.evaluation.nees import SPANS, Consistency, consistency
from taxelflow.evaluation.statistics import finite, rms
from taxelflow.evaluation.strokes import rms_of

if TYPE_CHECKING:
    from taxelflow.evaluation.base import Cell
    from taxelflow.evaluation.pose_errors import Errors
    from taxelflow.messages import Bools, Floats

AXES = ("x", "y", "theta")
SETS = ("all", "ok")
UNITS = {"x": "mm", "y": "mm", "theta": "deg"}
_FACTORS = (1.0 / milli, 1.0 / milli, 1.0 / degree)
"""From m, m, rad to the rows' units."""
_RMS = ("axis", "unit", "rms", "rms_standard_error_percent")
ERROR = ("method", "scans", "n", *_RMS, "bound_known", "error_over_bound_known", "error_over_bound_unknown")
MOTION = ("method", "n", *_RMS, "rms_last_scan", "bound_known", "bound_unknown")
NEES = (
    "method", "scans", "over_scans",
    "nees_per_degree_of_freedom", "band_95_low", "band_95_high", "pairs", "independent_pairs",
)  # fmt: skip
TIME = ("method", "processor_time_s")


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


def _chosen(one: Errors, scans: str) -> Bools:
    known: Bools = np.isfinite(one.error[:, 0])
    return known & one.ok if scans == "ok" else known


def error_cells(row: LimitsRow) -> tuple[Cell, ...]:
    """A row as in a CSV file."""
    over = (row.bound, row.over_known, row.over_unknown)
    return row.method, row.scans, row.count, row.axis, UNITS[row.axis], row.rms, share(row), *over


def motion_cells(row: SinceRow) -> tuple[Cell, ...]:
    """A row as in a CSV file."""
    return row.method, row.count, row.axis, UNITS[row.axis], row.rms, share(row), row.last, row.known, row.unknown


def nees_cells(row: ConsistencyRow) -> tuple[Cell, ...]:
    """A row as in a CSV file."""
    return row.method, row.scans, row.over, *msgspec.structs.astuple(row.found)


def share(row: LimitsRow | SinceRow) -> float | None:
    """Standard error of the RMS in percent of it."""
    return None if row.standard_error is None else 100 * row.standard_error / row.rms


def consistency_rows(method: str, own: list[Errors]) -> list[ConsistencyRow]:
    """Consistency over each number of scans, for all poses and those with quality ok. own: one for each recording."""
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


def error_rows(method: str, own: list[Errors]) -> list[LimitsRow]:
    """Errors along each axis, for all poses and those with quality ok. own: one for each recording."""
    rows = []
    for scans in SETS:
        chosen = [_chosen(one, scans) for one in own]
        for axis, unit in enumerate(_FACTORS):
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
                error_rms, standard_error = rms_of(_by_contact(own, chosen, axis, unit))
                rows.append(
                    LimitsRow(
                        method=method,
                        scans=scans,
                        axis=AXES[axis],
                        count=int(there.sum()),
                        rms=error_rms,
                        standard_error=standard_error,
                        bound=finite(unit * rms(known[there])),
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


def since_rows(method: str, own: list[Errors]) -> list[SinceRow]:
    """Errors of the motion since the first scan of each contact, along each axis. own: one for each recording."""
    rows = []
    for axis, unit in enumerate(_FACTORS):
        known = [np.isfinite(one.since[:, axis]) for one in own]
        contacts = [
            unit * one.since[there & (one.piece == number), axis]
            for one, there in zip(own, known, strict=True)
            for number in np.unique(one.piece[there])
        ]
        if contacts:
            bounds = [
                finite(
                    unit * rms(np.concatenate([bound[there, axis] for bound, there in zip(each, known, strict=True)]))
                )
                for each in ([one.bound.since_known for one in own], [one.bound.since_unknown for one in own])
            ]
            count = sum(map(len, contacts))
            last = rms(np.array([errors[-1] for errors in contacts]))
            rows.append(SinceRow(method, AXES[axis], count, *rms_of(contacts), last, *bounds))
    return rows


def places(method: str, own: list[Errors], width_mm: float) -> list[Place]:
    """Errors by true position, in bins of this width, along the axis of the longest travel. own: one a recording."""
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
            error_mm=rms(error[here]),
            known_mm=rms(known[here]),
            unknown_mm=finite(rms(unknown[here])),
            count=int(here.sum()),
        )
        for number in np.unique(bins)
        for here in [bins == number]
    ]


def _over(error: Floats, bound: Floats) -> float | None:
    """RMS of each error over its bound, where there is one."""
    there = np.isfinite(bound)
    return rms(error[there] / bound[there]) if there.any() else None
