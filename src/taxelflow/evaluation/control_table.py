"""Reports of controllers as a table, with intervals and paired comparisons."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console

from taxelflow.evaluation.cells import number, shown
from taxelflow.evaluation.control_summary import summary

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
    table = shown(
        rows,
        *(("controller:", "controller"), ("objects:", "objects")),
        ("grasped", lambda row: f"{row.grasped}/{row.trials}"),
        ("held %:", lambda row: share(row.held, row.held_low, row.held_high)),
        ("<5 mm %:", lambda row: share(row.within_5_mm, row.within_low, row.within_high)),
        *(("force", "force_p50", 2), ("p90", "force_p90", 2)),
        ("blind", lambda row: f"{row.blind:.0%}"),
    )
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
    trial = (("seed:", "seed"), ("object:", "object"), ("event:", "event"))
    flags = (("grasped:", lambda row: _yes(row.grasped)), ("held:", lambda row: _yes(row.held)))
    console.print(
        shown(report.trials, *trial, *flags, ("slid mm", "slid_mm", 2), ("force over least", "force_over_least", 2))
    )


def _yes(flag: bool) -> str:
    return "yes" if flag else "no"


def show_motion(report: MotionReport) -> None:
    """Print commanded motions."""
    console = Console(markup=False, highlight=False, soft_wrap=True)
    unit = report.unit
    flags = (("grasped:", lambda row: _yes(row.grasped)), ("closed:", lambda row: _yes(row.closed)))
    moves = [(f"{name} {unit}", name, 2) for name in ("asked", "felt", "moved")]
    console.print(shown(report.trials, ("seed:", "seed"), ("object:", "object"), *flags, *moves))
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
