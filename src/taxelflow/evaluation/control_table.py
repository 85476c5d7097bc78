"""Reports of controllers as a table, with intervals and paired comparisons."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console

from taxelflow.evaluation.control import ControlReport, MotionReport, is_near
from taxelflow.publish.quiet import quiet_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.evaluation.control_tune import TuneReport

_RESAMPLES = 10_000
_Z = 1.96


def show(reports: Sequence[ControlReport | MotionReport]) -> None:
    """Print the reports; the first is compared with each other one, trial by trial."""
    console = Console(markup=False, highlight=False, soft_wrap=True)
    holding = [report for report in reports if isinstance(report, ControlReport)]
    if holding:
        _show_holding(console, holding)
    for report in reports:
        if isinstance(report, MotionReport):
            _show_motion(console, report)


def _show_holding(console: Console, reports: list[ControlReport]) -> None:
    table = quiet_table("controller:", "trials", "grasped", "held", "95 %:", "within 5 mm", "95 %:", "force p50", "p90")
    for report in reports:
        rows = [row for row in report.trials if row.grasped]
        held, near = [row.held for row in rows], [is_near(row) for row in rows]
        cells = [_share(report.held), interval(held), _share(report.within_5_mm), interval(near)]
        forces = [_ratio(report.force_p50), _ratio(report.force_p90)]
        table.add_row(report.controller, str(len(report.trials)), str(len(rows)), *cells, *forces)
    console.print(table)
    console.print("force: of the last second over the least that holds, of held trials", style="dim")
    for other in reports[1:]:
        console.print(paired(reports[0], other))
    if len(reports) == 1:
        table = quiet_table("seed:", "object:", "event:", "grasped:", "held:", "slid mm", "force over least")
        for row in reports[0].trials:
            yes = ["yes" if flag else "no" for flag in (row.grasped, row.held)]
            table.add_row(
                str(row.seed), row.object, row.event, *yes, f"{row.slid_mm:.2f}", _ratio(row.force_over_least)
            )
        console.print(table)


def _show_motion(console: Console, report: MotionReport) -> None:
    unit = report.unit
    table = quiet_table("seed:", "object:", "grasped:", "closed:", f"asked {unit}", f"felt {unit}", f"moved {unit}")
    for row in report.trials:
        yes = ["yes" if flag else "no" for flag in (row.grasped, row.closed)]
        table.add_row(str(row.seed), row.object, *yes, f"{row.asked:.2f}", f"{row.felt:.2f}", f"{row.moved:.2f}")
    console.print(table)
    if report.error_p50 is not None and report.error_p90 is not None:
        console.print(f"{report.controller}: error p50 {report.error_p50:.2f}, p90 {report.error_p90:.2f} {unit}")


def show_tuned(reports: Sequence[TuneReport]) -> None:
    """Print what a search has tried, the cheapest first."""
    console = Console(markup=False, highlight=False, soft_wrap=True)
    for report in reports:
        for one in report.tried:  # lines, as a table would cut long parameters
            values = " ".join(f"{name}={value:g}" for name, value in one.parameters.items()) or "defaults"
            shares = f"held {_share(one.held)}, within 5 mm {_share(one.within_5_mm)}"
            forces = f"force p50 {_ratio(one.force_p50)}, p90 {_ratio(one.force_p90)}"
            console.print(f"{report.controller}: cost {one.cost:.3f}, {shares}, {forces}: {values}")
    note = "cost: 1 for an object lost or slid 5 mm or more, 0.25 for a force of twice the least; mean over the trials"
    console.print(note, style="dim")


def interval(flags: Sequence[bool]) -> str:
    """Wilson's 95 % interval of a share."""
    count = len(flags)
    if not count:
        return "-"
    share = sum(flags) / count
    middle = (share + _Z**2 / (2 * count)) / (1 + _Z**2 / count)
    half = _Z / (1 + _Z**2 / count) * float(np.sqrt(share * (1 - share) / count + _Z**2 / (4 * count**2)))
    return f"{middle - half:.0%}-{middle + half:.0%}"


def paired(ours: ControlReport, other: ControlReport) -> str:
    """Wins and losses in trials within 5 mm, with a bootstrap interval over trials of the difference of the shares."""
    both = [pair for pair in zip(ours.trials, other.trials, strict=True) if pair[0].grasped and pair[1].grasped]
    gains = np.array([int(is_near(mine)) - int(is_near(its)) for mine, its in both])
    if not len(gains):
        return f"{ours.controller} against {other.controller}: no trial in which both grasped"
    picks = np.random.default_rng(0).integers(len(gains), size=(_RESAMPLES, len(gains)))
    low, high = np.quantile(gains[picks].mean(axis=1), [0.025, 0.975])
    wins, losses = int((gains > 0).sum()), int((gains < 0).sum())
    return (
        f"{ours.controller} against {other.controller}, within 5 mm: {wins} wins, {losses} losses of {len(gains)}; "
        f"difference {gains.mean():+.0%} [{low:+.0%} {high:+.0%}]"
    )


def _share(share: float | None) -> str:
    return "-" if share is None else f"{share:.1%}"


def _ratio(ratio: float | None) -> str:
    return "-" if ratio is None else f"{ratio:.2f}"
