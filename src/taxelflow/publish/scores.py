"""What the scores show in a terminal: Table I, the field, the bound, other software."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console

from taxelflow.publish.quiet import quiet_table

if TYPE_CHECKING:
    from typing import Any

    from rich.table import Table

_NAMES = {"lnorm": "L norm", "convolution": "flow", "principal_axis": "axis"}


def show_table1(table: Any) -> None:
    """The paper's Table I, then ours, in its columns."""
    console = Console(markup=False)
    paper = quiet_table(
        "mm/s", "method:", "backward", "forward", "RMSE mm/s", "RMSE %", title="Table I as published: one trial"
    )
    for row in table.paper:
        velocities = (f"{row.backward_mm_s:.2f}", f"{row.forward_mm_s:.2f}")
        paper.add_row(
            str(row.nominal_mm_s),
            _NAMES.get(row.method, row.method),
            *velocities,
            f"{row.rmse_mm_s:.2f}",
            f"{row.rmse_percent:.1f}",
        )
    console.print(paper)
    console.print()
    title = f"ours: {table.strokes} strokes a speed, seed {table.seed}" + _solved(table)
    ours = quiet_table("mm/s", "method:", "scans:", "factor", "back", "forth", "RMSE", "%", "±", "bias", title=title)
    last = {row.nominal_mm_s: row for row in table.ours}
    for row in table.ours:
        digits = _digits(row)
        ours.add_row(
            str(row.nominal_mm_s),
            _NAMES.get(row.method, row.method),
            row.scans,
            "none" if row.factor == 1.0 else f"{row.factor:.4f}({1e4 * row.factor_standard_error:.0f})",
            f"{row.backward_mm_s:.2f}",
            f"{row.forward_mm_s:.2f}",
            f"{row.rmse_mm_s:.{digits}f}",
            f"{row.rmse_percent:.{digits}f}",
            f"{row.standard_error_percent:.{digits}f}",
            f"{row.bias_percent:+.{digits - 1}f}",
            end_section=row is last[row.nominal_mm_s],
        )
    console.print(ours)
    console.print(
        "all: every scan in contact. interior: the object's centre at most 22 mm\n"
        "from the palm's. factor: one per method and set of scans, fitted at 25 mm/s\n"
        "on strokes that are not in the table, in brackets the standard error of its\n"
        "last digits. RMSE in mm/s and %, ± the standard error of the latter; bias in %.",
        style="dim",
        highlight=False,
    )


def show_field(scored: Any) -> None:
    """Errors of translation and rotation by number of slip vectors."""
    console = Console(markup=False)
    for scenario in dict.fromkeys(row.scenario for row in scored.rows):
        title = f"{scenario}, {scored.seeds} seeds"
        table = quiet_table("vectors", "hand:", "direction deg", "speed %", "turn %", "turn bias %", title=title)
        for row in scored.rows:
            if row.scenario == scenario:
                direction = "-" if row.direction_deg is None else f"{row.direction_deg:.1f}"
                speed = "-" if row.speed_percent is None else f"{row.speed_percent:.1f}"
                table.add_row(
                    str(row.vectors),
                    row.cut,
                    direction,
                    speed,
                    f"{row.turn_percent:.1f}",
                    f"{row.turn_bias_percent:+.1f}",
                )
        console.print(table)
        console.print()
    console.print(
        "direction: median; speed and turn: RMSE over the RMS of the true one; at the hand's origin", style="dim"
    )


def show_slip(scored: Any) -> None:
    """Slips found, then alarms of still objects beside the rate that was asked for."""
    console = Console(markup=False)
    for mode, how in (("stream", "called live"), ("batch", "dated afterwards")):
        title = f"slips, {how}: {scored.seeds} recordings of each object, seeds from {scored.first_seed}"
        console.print(_slips_found([row for row in scored.slips if row.mode == mode], title))
        console.print()
    title = f"still objects, {scored.alarms_per_hour:g} false alarms an hour asked for"
    still = quiet_table("scenario:", "method:", "hours", "alarms", "an hour", "95 %:", "scatter", title=title)
    for row in scored.holds:
        rates = [f"{rate:.0f}" if rate >= 100 else f"{rate:.2g}" for rate in (row.per_hour, row.low, row.high)]
        numbers = (f"{row.hours:.2f}", str(row.alarms), rates[0], f"{rates[1]} to {rates[2]}", f"{row.scatter:.2f}")
        still.add_row(row.scenario, row.method, *numbers)
    console.print(still)
    console.print(
        "n: slips. ms, p90, max: from the first slipping scan to the first called so.\n"
        "false: begun while still. split: begun anew within a slip. deg, %: median error\n"
        "of a slip's direction and speed. 95 %: interval of the rate, called live.\n"
        "scatter: learned, over the covariance's. roll and tilt are no slips; pressure\n"
        "alone cannot tell.",
        style="dim",
        highlight=False,
    )


def _slips_found(rows: list[Any], title: str) -> Table:
    found = quiet_table(
        "object:", "method:", "n", "F1", "ms", "p90", "max", "miss", "false", "split", "deg", "%", title=title
    )
    for row in rows:
        onsets = [f"{ms:.0f}" for ms in (row.onset_ms, row.onset_p90_ms, row.onset_max_ms)]
        counts = [str(count) for count in (row.missed, row.false, row.split)]
        motion = (f"{row.direction_deg:.0f}", f"{row.speed_percent:.0f}")
        found.add_row(row.object, row.method, str(row.slips), f"{row.f1:.3f}", *onsets, *counts, *motion)
    return found


def show_limits(scored: Any) -> None:
    """Errors over the bound, then the consistency of covariances."""
    console = Console(markup=False)
    ran = f"{scored.scenario}, {scored.mode}, {scored.seeds} seeds from {scored.seed}{_solved(scored)}"
    title = f"{ran}: error over the bound"
    table = quiet_table("method:", "scans:", "n", "axis:", "RMS", "bound", "x known", "x unknown", title=title)
    for row in scored.rows:
        unit, digits = ("deg", 3) if row.axis == "theta" else ("mm", 4)
        table.add_row(
            row.method,
            row.scans,
            str(row.count),
            f"{row.axis} {unit}",
            f"{row.rms:.{digits}f}",
            _number(row.bound, digits),
            _number(row.over_known, 2),
            _number(row.over_unknown, 2),
        )
    console.print(table)
    console.print(
        f"{scored.scored} scans of {scored.contact} in contact are scored: their bound is below a\n"
        "quarter of a pitch. ok: scans whose quality is ok. bound: Cramér-Rao, gain\n"
        "and baseline unknown, RMS over the same scans. x known, x unknown: RMS of each\n"
        "scan's error over its own bound, the object's pattern known and unknown; 1 is\n"
        "the best without further knowledge. One constant offset a contact is taken off.",
        style="dim",
        highlight=False,
    )
    console.print()
    title = "NEES of pose differences a degree of freedom; 1: honest"
    table = quiet_table("method:", "scans:", "over", "NEES", "95 % band:", "pairs", "independent", title=title)
    for row in scored.consistency:
        found = row.found
        table.add_row(
            row.method,
            row.scans,
            str(row.over),
            _number(found.nees, 2),
            f"{found.low:.2f}..{found.high:.2f}",
            str(found.pairs),
            f"{found.independent:.0f}",
        )
    console.print(table)
    if scored.without:
        console.print(f"no position, so not scored: {', '.join(scored.without)}", style="dim", highlight=False)


def show_peers(scored: Any) -> None:
    """Errors of all on the same strokes, and how far the best of them are apart."""
    console = Console(markup=False)
    title = f"velocity RMSE in %, {scored.strokes} strokes a speed, seed {scored.seed}" + _solved(scored)
    table = quiet_table("mm/s", "method:", "all", "interior", "all, fit", "interior, fit", "failed", title=title)
    errors = {(r.nominal_mm_s, r.method, r.scans, r.factor_standard_error > 0): r for r in scored.rows}
    failed = {row.method: f"{row.percent:.1f}" for row in scored.failed}
    bounds = {(row.nominal_mm_s, row.scans): f"{row.percent:.3f}" for row in scored.bounds}
    speeds = list(dict.fromkeys(row.nominal_mm_s for row in scored.rows))
    for speed in speeds:
        for method in dict.fromkeys(row.method for row in scored.rows):
            cells = [
                _percent(errors[speed, method, scans, fitted], scored.strokes)
                for fitted in (False, True)
                for scans in ("all", "interior")
            ]
            table.add_row(str(speed), _NAMES.get(method, method), *cells, failed.get(method, ""))
        own = (bounds[speed, "all"], bounds[speed, "interior"])
        table.add_row(str(speed), "Cramér-Rao bound", *own, "", "", "", end_section=True)
    console.print(table)
    for best in scored.best:
        if best.scans == "all":
            factor = "one factor fitted" if best.fitted else "uncalibrated"
            console.print(
                f"{best.nominal_mm_s} mm/s, all scans, {factor}: {best.peer} over "
                f"{_NAMES.get(best.ours, best.ours)}: x {best.ratio:.1f}",
                highlight=False,
            )
    if scored.silent:
        console.print(f"no velocity at all: {', '.join(scored.silent)}", highlight=False)
    console.print(
        "all: every scan in contact. interior: the object near the palm's centre.\n"
        "fit: with one factor a method and set, fitted at 25 mm/s on other strokes.\n"
        "failed: pairs of scans without an answer, in %; the sum of displacements begins\n"
        "anew after them. In brackets: strokes, where not all gave a velocity.",
        style="dim",
        highlight=False,
    )


def _percent(row: Any, strokes: int) -> str:
    return f"{row.rmse_percent:.{_digits(row)}f}" + (f" ({row.strokes})" if row.strokes < strokes else "")


def _solved(scored: Any) -> str:
    return "" if scored.solver == "analytic" else f", {scored.solver} solver"


def _digits(row: Any) -> int:
    return 3 if row.rmse_percent < 1 else 2


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
