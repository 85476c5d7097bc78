"""Rows of the score robustness: one method on one recording, and summaries over the cases."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow.evaluation.pose_errors import without_frame
from taxelflow.evaluation.statistics import finite, rms
from taxelflow.messages import LOST, OK
from taxelflow.numerics.rounding import LEAST_VARIANCE_M2, SIGNIFICANT
from taxelflow.simulation.relief.course import follow

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.messages import Bools, Floats, Slips
    from taxelflow.simulation.relief.parameters import Pressing

SIMPLE = ("lnorm", "convolution", "registration")
"""Methods without a map; the others are compared with the best of these."""


class CaseRow(msgspec.Struct, frozen=True):
    """One method on one recording. None: the method does not estimate it, or not in enough scans."""

    effect: str
    shape: str
    layout: str
    seed: int
    method: str
    scans: int
    """In contact, and scored."""
    known_share: float
    """Share of them with a pose."""
    error_mm: float | None
    """RMS of the distance between position and truth, one constant offset taken off."""
    error_deg: float | None
    """RMS of the turn's error, one constant angle taken off."""
    nees_position: float | None
    nees_turn: float | None
    """Mean squared error over the covariance a degree of freedom: 1 is right."""
    ok: int
    """Scans whose quality is ok."""
    wrong: int | None
    """Of these, scans off by more than 3 sigma and 0.3 mm, the offset and angle taken off that fit these scans best."""
    ratio: float | None = None
    """error_mm over that of the best simple method of the same recording."""

    @property
    def ok_share(self) -> float:
        """Share of the scored scans whose quality is ok."""
        return self.ok / self.scans if self.scans else 0.0

    @property
    def wrong_share(self) -> float | None:
        """Share of the scans called ok that are wrong."""
        return self.wrong / self.ok if self.wrong is not None and self.ok else None


class RobustnessSummary(msgspec.Struct, frozen=True):
    """One method over all cases with one effect; effect `(all rows)`: over all of them."""

    effect: str
    method: str
    cases: int
    """Those that have a best simple method."""
    worse: int
    """Cases with more than 1.1 times its error, or without an error."""
    better_share: float
    """Share of cases with less than a third of its error."""
    median_ratio: float | None
    largest_ratio: float | None
    nees_position: float | None
    nees_turn: float | None
    """Median over the cases."""
    ok_share: float
    wrong_share: float | None
    """Of all scans together."""


def row_of(names: tuple[str, str, str, int, str], pressing: Pressing, slips: Slips, pad: int, mode: str) -> CaseRow:
    """One method's row, without the ratio. names: effect, shape, layout, seed, method.

    A stream is scored from one second after the first contact on; with a pose in less than half of the scans in
    contact, a method has no error.
    """
    lag_s = np.nan_to_num(slips.lag_s[:, pad])
    path = follow(pressing.course, pressing.rate_hz, slips.t_s - lag_s)
    scored = slips.contact[:, pad] & (path.load > 0)
    if mode == "stream" and scored.any():
        scored &= slips.t_s >= slips.t_s[np.argmax(scored)] + 1.0
    pose = _poses(slips, pad, path.pose)
    known = scored & np.isfinite(pose[:, :2]).all(axis=1) & (slips.quality[:, pad] != LOST)
    scans, ok, covariance = int(scored.sum()), scored & (slips.quality[:, pad] == OK), slips.covariance[:, pad]
    share = float(known.sum()) / scans if scans else 0.0
    wrong = _wrong(_errors(pose, path.pose, known & ok), covariance)
    if not scans or share < 0.5:
        return CaseRow(*names, scans, share, None, None, None, None, int(ok.sum()), wrong)
    error = _errors(pose, path.pose, known)
    turns = error[np.isfinite(error[:, 2]), 2]
    squared, turned = _normalised(error, covariance)
    stated = np.isfinite(squared)
    return CaseRow(
        *names,
        scans=scans,
        known_share=share,
        error_mm=1e3 * rms(np.hypot(*error[known, :2].T)),
        error_deg=float(np.degrees(rms(turns))) if len(turns) else None,
        nees_position=float(squared[stated].mean()) / 2 if stated.any() else None,
        nees_turn=float(np.nanmean(turned)) if np.isfinite(turned).any() else None,
        ok=int(ok.sum()),
        wrong=wrong,
    )


def _poses(slips: Slips, pad: int, true: Floats) -> Floats:
    """Poses (scans, 3) of a pad; of a method without poses its displacements, added up from the true start."""
    pose = slips.pose[:, pad]
    if np.isfinite(pose[:, 0]).any():
        return pose
    moved = slips.displacement[:, pad]
    there = np.isfinite(moved[:, :1])
    before = true[max(int(np.argmax(there)) - 1, 0)]
    summed: Floats = np.where(there, before + np.cumsum(np.nan_to_num(moved), axis=0), np.nan)
    return summed


def _errors(pose: Floats, true: Floats, scans: Bools) -> Floats:
    """Errors (scans, 3) of the poses in these scans, their best constant offset and angle taken off; else NaN."""
    error = np.full(pose.shape, np.nan)
    if scans.any():
        error[scans] = without_frame(pose[scans], true[scans], np.ones((int(scans.sum()), 3)))
    return error


def _normalised(error: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Squared errors over the covariance (scans,), of the position (two degrees of freedom) and of the turn (one).

    error: (scans, 3). covariance: (scans, 3, 3). NaN where one of them is unknown.
    """
    a, b, c = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    x, y = error[:, 0], error[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        position = (c * x**2 - 2 * b * x * y + a * y**2) / (a * c - b**2)
        turn = error[:, 2] ** 2 / covariance[:, 2, 2]
    return np.where(np.isfinite(position), position, np.nan), np.where(np.isfinite(turn), turn, np.nan)


def _wrong(error: Floats, covariance: Floats) -> int | None:
    """Number of positions that are off by more than 3 sigma and 0.3 mm; None without covariances.

    error: (scans, 3), NaN where it does not count. covariance: (scans, 3, 3).
    """
    squared, _ = _normalised(error, covariance)
    far = np.hypot(error[:, 0], error[:, 1]) > 3e-4
    return int(np.sum(far & (squared > SIGNIFICANT**2))) if np.isfinite(squared).any() else None


def with_ratios(rows: Sequence[CaseRow]) -> list[CaseRow]:
    """The rows with their ratios to the best simple method of the same recording.

    None where that has no error but rounding, as a method that found no motion of an object that is held.
    """
    least_mm = 1e3 * float(np.sqrt(LEAST_VARIANCE_M2))
    best: dict[tuple[str, str, str, int], float] = {}
    for row in rows:
        if row.method in SIMPLE and row.error_mm is not None:
            key = (row.effect, row.shape, row.layout, row.seed)
            best[key] = min(best.get(key, np.inf), row.error_mm)
    found = []
    for row in rows:
        known = best.get((row.effect, row.shape, row.layout, row.seed), 0.0)
        ratio = row.error_mm / known if known > least_mm and row.error_mm is not None else None
        found.append(msgspec.structs.replace(row, ratio=ratio))
    return found


ALL_ROWS = "(all rows)"


def summaries(rows: Sequence[CaseRow]) -> list[RobustnessSummary]:
    """One for each effect and method that is not simple, and over all effects if there are several."""
    methods = [name for name in dict.fromkeys(row.method for row in rows) if name not in SIMPLE]
    effects = list(dict.fromkeys(row.effect for row in rows))
    groups = [(effect, [row for row in rows if row.effect == effect]) for effect in effects]
    groups += [(ALL_ROWS, list(rows))] if len(effects) > 1 else []
    return [_summary(effect, method, own) for method in methods for effect, own in groups]


def _summary(effect: str, method: str, rows: Sequence[CaseRow]) -> RobustnessSummary:
    rivals = {
        (row.effect, row.shape, row.layout, row.seed)
        for row in rows
        if row.method in SIMPLE and row.error_mm is not None
    }
    own = [row for row in rows if row.method == method]
    compared = [row for row in own if (row.effect, row.shape, row.layout, row.seed) in rivals]
    ratios = np.array([np.inf if row.ratio is None else row.ratio for row in compared])
    judged = [row for row in own if row.wrong is not None]
    ok, scans = sum(row.ok for row in judged), sum(row.scans for row in own)
    return RobustnessSummary(
        effect=effect,
        method=method,
        cases=len(compared),
        worse=int((ratios > 1.1).sum()),
        better_share=float((ratios < 1 / 3).mean()) if len(ratios) else 0.0,
        median_ratio=finite(np.median(ratios)) if len(ratios) else None,
        largest_ratio=finite(ratios.max()) if len(ratios) else None,
        nees_position=_median([row.nees_position for row in own]),
        nees_turn=_median([row.nees_turn for row in own]),
        ok_share=sum(row.ok for row in own) / scans if scans else 0.0,
        wrong_share=sum(row.wrong or 0 for row in judged) / ok if ok else None,
    )


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None
