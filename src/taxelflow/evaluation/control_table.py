"""Reports of controllers as a table, with intervals and paired comparisons."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console

from taxelflow.evaluation.cells import number
from taxelflow.evaluation.control_summary import summary
from taxelflow.publish.quiet import quiet_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.evaluation.control import ControlReport, MotionReport, Outcome
    from taxelflow.evaluation.control_summary import SummaryRow
    from taxelflow.evaluation.control_tune import TuneReport


_COST_NOTE = (
    "cost: 1 for an object lost or slid 5 mm or more, 0.25 for a force of twice the least; mean over the trials"
)


def show_holding(outcomes: Sequence[Outcome]) -> list[SummaryRow]:
    """Print the reports; the first is compared with each other one, trial by trial. The rows that were printed."""
    console = Console(markup=False, highlight=False, soft_wrap=True)
    rows = summary(outcomes)
    table = quiet_table("controller:", "objects:", "grasped", "held %:", "<5 mm %:", "force", "p90", "blind")
    for row in rows:
        held = share(row.held, row.held_low, row.held_high)
        near = share(row.within_5_mm, row.within_low, row.within_high)
        forces, blind = (number(row.force_p50, 2), number(row.force_p90, 2)), f"{row.blind:.0%}"
        table.add_row(row.controller, row.objects, f"{row.grasped}/{row.trials}", held, near, *forces, blind)
    console.print(table)
    for note in (
        "in brackets: 95 % intervals; force: of the last second over the least that holds, of held trials",
        _COST_NOTE,
        "blind: scans in which the controller knows that its pads cannot detect a slip",
    ):
        console.print(note, style="dim")
    for row in rows:
        if row.wins is not None:
            console.print(_paired(rows[0].controller, row))
    for row in rows:
        step = f"p50 {row.step_ms_p50:.2f}, p99 {row.step_ms_p99:.2f} ms of processor time"
        cost = f"cost {number(row.cost, 2)}; a step of the estimator for both pads {step}"
        console.print(f"{row.controller}, {row.objects}: {cost}")
    if len(outcomes) == 1:
        _show_trials(console, outcomes[0].report)
    return rows


def _show_trials(console: Console, report: ControlReport) -> None:
    table = quiet_table("seed:", "object:", "event:", "grasped:", "held:", "slid mm", "force over least")
    for row in report.trials:
        yes = ["yes" if flag else "no" for flag in (row.grasped, row.held)]
        table.add_row(str(row.seed), row.object, row.event, *yes, f"{row.slid_mm:.2f}", number(row.force_over_least, 2))
    console.print(table)


def show_motion(report: MotionReport) -> None:
    """Print commanded motions."""
    console = Console(markup=False, highlight=False, soft_wrap=True)
    unit = report.unit
    table = quiet_table("seed:", "object:", "grasped:", "closed:", f"asked {unit}", f"felt {unit}", f"moved {unit}")
    for row in report.trials:
        yes = ["yes" if flag else "no" for flag in (row.grasped, row.closed)]
        table.add_row(str(row.seed), row.object, *yes, f"{row.asked:.2f}", f"{row.felt:.2f}", f"{row.moved:.2f}")
    console.print(table)
    if report.error_p50 is not None and report.error_p90 is not None:
        console.print(f"{report.controller}: error p50 {report.error_p50:.2f}, p90 {report.error_p90:.2f} {unit}")


def show_tuned(reports: Sequence[TuneReport]) -> None:
    """Print what a search has tried: what was tried on all trials first, each the cheapest first."""
    console = Console(markup=False, highlight=False, soft_wrap=True)
    for report in reports:
        for one in report.tried:  # lines, as a table would cut long parameters
            shares = f"held {_share(one.held)}, within 5 mm {_share(one.within_5_mm)}"
            forces = f"force p50 {number(one.force_p50, 2)}, p90 {number(one.force_p90, 2)}"
            console.print(
                f"{report.controller}, {one.trials} trials: cost {one.cost:.3f}, {shares}, {forces}: {one.words}"
            )
    console.print(_COST_NOTE, style="dim")


def share(middle: float | None, low: float | None, high: float | None) -> str:
    """A share with its interval, in percent."""
    if middle is None or low is None or high is None:
        return "-"
    return f"{100 * middle:.0f} ({100 * low:.0f}-{100 * high:.0f})"


def _paired(ours: str, row: SummaryRow) -> str:
    """The first controller against that of a row."""
    return (
        f"{ours} against {row.controller}, {row.objects}, within 5 mm: {row.wins} wins, {row.losses} losses of "
        f"{row.trials}; difference {row.gain:+.0%} [{row.gain_low:+.0%} {row.gain_high:+.0%}]; "
        f"{row.controller} costs {row.cost_more:+.2f} [{row.cost_more_low:+.2f} {row.cost_more_high:+.2f}]"
    )


def _share(share: float | None) -> str:
    return "-" if share is None else f"{share:.1%}"
