"""What the scores show in a terminal: Table I, the field, the bound, other software."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console

from taxelflow.publish.quiet import quiet_table

if TYPE_CHECKING:
    from typing import Any

    from rich.table import Table

_NAMES = {"lnorm": "L norm", "convolution": "flow", "principal_axis": "axis"}
_MOST_FAR = 6
"""Strokes that are named, of each case."""


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
            "none" if row.factor == 1.0 else _factor(row),
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


def show_hard(scored: Any) -> None:
    """Errors of the velocities of strokes, by what makes them hard, and the strokes that are furthest off."""
    console = Console(markup=False)
    far: dict[tuple[int, str, str], list[Any]] = {}
    for one in scored.far:
        far.setdefault((one.nominal_mm_s, one.method, one.case), []).append(one)
    for method in dict.fromkeys(row.method for row in scored.rows):
        title = f"{_NAMES.get(method, method)}, {scored.seeds} recordings a case, seed {scored.seed}{_solved(scored)}"
        table = quiet_table("mm/s", "strokes:", "n", "RMSE %", "±", "median", "bias", "bound", "far", title=title)
        own = sorted((row for row in scored.rows if row.method == method), key=lambda row: row.nominal_mm_s)
        last = {row.nominal_mm_s: row for row in own}
        for row in own:
            table.add_row(
                str(row.nominal_mm_s),
                row.case,
                str(row.strokes),
                f"{row.rmse_percent:.3f}",
                _number(row.standard_error_percent, 3),
                f"{row.median_percent:.3f}",
                f"{row.bias_percent:+.3f}",
                f"{row.bound_percent:.3f}",
                str(len(far.get((row.nominal_mm_s, method, row.case), ()))),
                end_section=row is last[row.nominal_mm_s],
            )
        console.print(table)
    for (speed, method, case), strokes in sorted(far.items()):
        console.print(f"{_NAMES.get(method, method)}, {speed} mm/s, {case}: {_furthest(strokes)}", highlight=False)
    for speed, method, case in scored.silent:
        console.print(f"{_NAMES.get(method, method)}, {speed} mm/s, {case}: no stroke has a velocity", highlight=False)
    console.print(
        "All scans in contact, no factor. ±: standard error of the RMSE. median: of the\n"
        "error's absolute value. bound: Cramér-Rao, each scan by itself, pattern known\n"
        "(saturated and dead taxels tell it nothing). far: strokes over 1 % off; below,\n"
        "the furthest as seed/stroke and error in %.",
        style="dim",
        highlight=False,
    )


def _furthest(strokes: Any) -> str:
    """The strokes that are furthest off, those without a velocity first."""
    worst = sorted(strokes, key=lambda one: -abs(one.error_percent or float("inf")))
    told = [
        f"{one.seed}/{one.stroke} " + ("none" if one.error_percent is None else f"{one.error_percent:+.2f}")
        for one in worst[:_MOST_FAR]
    ]
    return ", ".join(told) + (", ..." if len(worst) > _MOST_FAR else "")


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
        rows = [row for row in scored.slips if row.mode == mode]
        if rows:
            count = max(row.slips for row in rows)  # the same of all: a seed's motion is that of any object
            title = f"slips, {how}: {count} of each object in {scored.seeds} recordings, seeds from {scored.first_seed}"
            console.print(_slips_found(rows, title))
            console.print()
    title = f"still objects, {scored.alarms_per_hour:g} false alarms an hour asked for, seeds from {scored.first_seed}"
    still = quiet_table("scenario:", "method:", "hours", "alarms", "an hour", "95 %:", "scatter", title=title)
    for row in scored.holds:
        rates = [f"{rate:.0f}" if rate >= 100 else f"{rate:.2g}" for rate in (row.per_hour, row.low, row.high)]
        numbers = (f"{row.hours:.2f}", str(row.alarms), rates[0], f"{rates[1]} to {rates[2]}", f"{row.scatter:.2f}")
        still.add_row(row.scenario, row.method, *numbers)
    if scored.holds:
        console.print(still)
    console.print(
        "best: F1 of an oracle that keeps the rate and knows place, velocity and\n"
        "covariance of the poses, only not when it slips. ms, p90: from the first\n"
        "slipping scan to the first called so.\n"
        "false: begun while still. split: begun anew within a slip. deg, %: median error\n"
        "of a slip's direction and speed. 95 %: interval of the rate, called live.\n"
        "scatter: learned, over the covariance's. roll and tilt are no slips; pressure\n"
        "alone cannot tell.",
        style="dim",
        highlight=False,
    )


def _slips_found(rows: list[Any], title: str) -> Table:
    live = ["best"] if any(row.mode == "stream" for row in rows) else []
    found = quiet_table(
        "object:", "method:", "F1", *live, "ms", "p90", "miss", "false", "split", "deg", "%", title=title
    )
    for row in rows:
        best = [_number(row.f1_oracle, 3)] * len(live)
        onsets = [f"{ms:.0f}" for ms in (row.onset_ms, row.onset_p90_ms)]
        counts = [str(count) for count in (row.missed, row.false, row.split)]
        motion = (f"{row.direction_deg:.0f}", f"{row.speed_percent:.0f}")
        found.add_row(row.object, row.method, f"{row.f1:.3f}", *best, *onsets, *counts, *motion)
    return found


def show_limits(scored: Any) -> None:
    """Errors over the bound, then the consistency of covariances."""
    console = Console(markup=False)
    ran = f"{scored.scenario}, {scored.mode}, {scored.seeds} seeds from {scored.seed}{_solved(scored)}"
    title = f"{ran}: error over the bound"
    table = quiet_table("method:", "scans:", "n", "axis:", "RMS", "±%", "bound", "x known", "x unknown", title=title)
    for row in scored.rows:
        unit, digits = ("deg", 3) if row.axis == "theta" else ("mm", 4)
        table.add_row(
            row.method,
            row.scans,
            str(row.count),
            f"{row.axis} {unit}",
            f"{row.rms:.{digits}f}",
            _share(row),
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
        "the best without further knowledge. One constant offset a contact is taken off.\n"
        "±%: standard error of the RMS, from the scatter among contacts.",
        style="dim",
        highlight=False,
    )
    console.print()
    title = "motion since the first scan of a contact, and its bound"
    table = quiet_table("method:", "n", "axis:", "RMS", "±%", "last", "bound", "unknown", title=title)
    for row in scored.since:
        unit, digits = ("deg", 3) if row.axis == "theta" else ("mm", 4)
        numbers = [_number(value, digits) for value in (row.last, row.known, row.unknown)]
        name = f"{row.axis} {unit}"
        table.add_row(row.method, str(row.count), name, f"{row.rms:.{digits}f}", _share(row), *numbers)
    console.print(table)
    console.print(
        "Nothing is fitted or taken off. last: RMS over contacts of the error in their\n"
        "last scan. bound, unknown: of the same motion, the pattern known and unknown.\n"
        "Processor time of a recording, s: " + ", ".join(f"{one.method} {one.median:.2f}" for one in scored.seconds),
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


def _share(row: Any) -> str:
    """Standard error in percent of the RMS."""
    return "-" if row.standard_error is None else f"{100 * row.standard_error / row.rms:.0f}"


def _factor(row: Any) -> str:
    digits = 4 if row.factor_standard_error < 99.5e-4 else 3
    return f"{row.factor:.{digits}f}({10**digits * row.factor_standard_error:.0f})"


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
