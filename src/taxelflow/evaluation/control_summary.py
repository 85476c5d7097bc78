"""Rows of the comparison of controllers: shares with intervals, and wins in the same trials."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np
from scipy.stats import binomtest

from taxelflow.evaluation.base import Table, table_of
from taxelflow.evaluation.control import ControlReport, TrialRow, cost, cost_of, is_near
from taxelflow.evaluation.statistics import resampled
from taxelflow.simulation.mujoco.objects import FEATURELESS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from taxelflow.evaluation.control import Outcome
    from taxelflow.messages import Floats


class SummaryRow(msgspec.Struct, frozen=True):
    """One controller on objects that can be felt, or on featureless ones. Shares are of the grasped trials.

    held_low and so on: Wilson's 95 % interval. blind: share of the scans in which the controller knows that its pads
    cannot detect a slip. step_ms: processor time of the estimator for both pads. wins, losses: trials within 5 mm
    of the first controller only, and of this one only; gain: difference of the shares, with a 95 % interval over
    trials. cost: 1 for an object lost or slid 5 mm or more, 0.25 for a force of twice the least, mean; cost_more: by
    how much it is above that of the first controller, with a 95 % interval over trials.
    """

    controller: str
    objects: str
    trials: int
    grasped: int
    held: float | None
    held_low: float | None
    held_high: float | None
    within_5_mm: float | None
    within_low: float | None
    within_high: float | None
    force_p50: float | None
    force_p90: float | None
    blind: float
    step_ms_p50: float
    step_ms_p99: float
    wins: int | None
    losses: int | None
    gain: float | None
    gain_low: float | None
    gain_high: float | None
    cost: float | None
    cost_more: float | None
    cost_more_low: float | None
    cost_more_high: float | None


class Difference(NamedTuple):
    """A mean over trials, with a 95 % interval."""

    mean: float
    low: float
    high: float


class Paired(NamedTuple):
    """Trials in which both grasped: how often one was within 5 mm and the other was not, and what the other cost more.

    gain: of the share within 5 mm.
    """

    trials: int
    wins: int
    losses: int
    gain: Difference
    cost_more: Difference


def summary(outcomes: Sequence[Outcome]) -> list[SummaryRow]:
    """A row for each controller and kind of object; the first controller is compared with each other one."""
    rows = []
    for name, chosen in (("felt", is_felt), ("featureless", is_featureless)):
        parts = [_part(outcome.report, chosen) for outcome in outcomes]
        if parts[0].trials:
            first = [None, *(paired(parts[0], other) for other in parts[1:])]
            rows += [_row(name, *each, chosen) for each in zip(outcomes, parts, first, strict=True)]
    return rows


def tables_of(outcomes: Sequence[Outcome]) -> list[Table]:
    """The rows of the comparison, and the trials behind them."""
    rows = summary(outcomes)
    trials = [(one.report.controller, *msgspec.structs.astuple(row)) for one in outcomes for row in one.report.trials]
    return [table_of("summary", rows, SummaryRow), Table("trials", ("controller", *TrialRow.__struct_fields__), trials)]


def is_felt(row: TrialRow) -> bool:
    """Whether the pads had something to feel."""
    return row.object not in FEATURELESS


def is_featureless(row: TrialRow) -> bool:
    """Whether the pads had nothing to feel."""
    return row.object in FEATURELESS


def wilson(flags: Sequence[bool]) -> tuple[float, float] | None:
    """Wilson's 95 % interval of a share; None for no trials."""
    if not flags:
        return None
    found = binomtest(sum(flags), len(flags)).proportion_ci(method="wilson")
    return float(found.low), float(found.high)


def paired(ours: ControlReport, other: ControlReport) -> Paired | None:
    """Wins and losses with bootstrap intervals over trials; None without a trial in which both grasped."""
    both = [pair for pair in zip(ours.trials, other.trials, strict=True) if pair[0].grasped and pair[1].grasped]
    if not both:
        return None
    gains = np.array([int(is_near(mine)) - int(is_near(its)) for mine, its in both])
    more = np.array([cost(its) - cost(mine) for mine, its in both])
    wins, losses = int((gains > 0).sum()), int((gains < 0).sum())
    return Paired(len(gains), wins, losses, _difference(gains), _difference(more))


def _difference(values: Floats) -> Difference:
    return Difference(float(values.mean()), *resampled(values, lambda drawn: drawn.mean(axis=1), 10_000))


def _part(report: ControlReport, chosen: Callable[[TrialRow], bool]) -> ControlReport:
    return ControlReport.of(report.controller, [row for row in report.trials if chosen(row)])


def _row(
    objects: str, outcome: Outcome, part: ControlReport, against: Paired | None, chosen: Callable[[TrialRow], bool]
) -> SummaryRow:
    grasped = [row for row in part.trials if row.grasped]
    held_low, held_high = wilson([row.held for row in grasped]) or (None, None)
    within_low, within_high = wilson([is_near(row) for row in grasped]) or (None, None)
    mine = [trial for trial, row in zip(outcome.scans, outcome.report.trials, strict=True) if chosen(row)]
    blind = float(np.mean(np.concatenate([scans.blind for scans in mine])))
    p50, p99 = 1e3 * np.quantile(np.concatenate([scans.step_s for scans in mine]), [0.5, 0.99])
    return SummaryRow(
        controller=part.controller,
        objects=objects,
        trials=len(part.trials),
        grasped=len(grasped),
        held=part.held,
        held_low=held_low,
        held_high=held_high,
        within_5_mm=part.within_5_mm,
        within_low=within_low,
        within_high=within_high,
        force_p50=part.force_p50,
        force_p90=part.force_p90,
        blind=blind,
        step_ms_p50=float(p50),
        step_ms_p99=float(p99),
        wins=against and against.wins,
        losses=against and against.losses,
        gain=against and against.gain.mean,
        gain_low=against and against.gain.low,
        gain_high=against and against.gain.high,
        cost=cost_of(grasped) if grasped else None,
        cost_more=against and against.cost_more.mean,
        cost_more_low=against and against.cost_more.low,
        cost_more_high=against and against.cost_more.high,
    )
