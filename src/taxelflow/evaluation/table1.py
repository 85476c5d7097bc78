"""Score table1: the paper's Table I beside ours, the velocity of many strokes of an airbag over the palm.

Each trial is the paper's: backward along -x, then forward, at 7 Hz, with object, line and phase drawn at random.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from rich.console import Console

from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.base import table_of, unwatched
from taxelflow.evaluation.cells import Column, caption, decimals, short, shown, solved_by
from taxelflow.evaluation.strokes import (
    Row,
    Stroke,
    Strokes,
    rows_of,
    run_trials,
    scored_methods,
    strokes_by,
    ungrouped,
)
from taxelflow.pipeline import api
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rich.table import Table as Shown

    from taxelflow.evaluation.base import Table, Watch
    from taxelflow.simulation.scenario import Scenario


class PaperRow(msgspec.Struct, frozen=True):
    """A row as printed in the paper: one trial of one backward and one forward stroke."""

    nominal_mm_s: int
    method: str
    backward_mm_s: float
    forward_mm_s: float
    rmse_mm_s: float
    rmse_percent: float


PAPER = (
    PaperRow(25, "lnorm", -24.24, 20.88, 2.96, 11.9),
    PaperRow(25, "convolution", -25.32, 24.26, 0.57, 2.3),
    PaperRow(50, "lnorm", -42.22, 38.22, 9.98, 20.0),
    PaperRow(50, "convolution", -44.52, 46.46, 4.61, 9.2),
)


@dataclass(frozen=True)
class Table1(Strokes):
    """Compare the velocity of strokes with the paper's Table I.

    An airbag is slid over the palm, backward and forward, with object, line and phase drawn at random.
    """

    def run(self, watched: Watch = unwatched) -> Table1Report:
        """Simulate and estimate the strokes, and as many again at 25 mm/s to fit the factors.

        Raises NameUnknown, ParameterInvalid, ExtraMissing (solver elastic).
        """
        chosen = self.methods or scored_methods()
        seen = run_trials(self.strokes, self.seed, lambda scenario: _measured(scenario, chosen), self.solver, watched)
        for method in chosen:
            if not any(np.isfinite(stroke.all) for stroke in seen["fit", method]):
                raise ParameterInvalid("methods", method, "give a position: leave this method out")
        strokes = self.strokes + self.strokes % 2
        return Table1Report(strokes, self.seed, self.solver, PAPER, rows_of(seen, chosen))


def _measured(scenario: Scenario, methods: Sequence[str]) -> dict[str, list[Stroke]]:
    """The strokes of one trial by each method."""
    recording = ungrouped(simulate(scenario))
    scans = api.conditioned(recording)
    return {method: strokes_by(method, recording, scans) for method in methods}


class Table1Report(msgspec.Struct, frozen=True):
    """The paper's rows and ours."""

    strokes: int
    seed: int
    solver: str
    paper: tuple[PaperRow, ...]
    ours: list[Row]

    def tables(self) -> list[Table]:
        """Our rows, then the paper's."""
        return [table_of("ours", self.ours, Row), table_of("paper", self.paper, PaperRow)]

    def show(self) -> None:
        """The paper's Table I, then ours, in its columns."""
        console = Console(markup=False)
        console.print(_paper_table(self.paper))
        console.print()
        console.print(_our_table(self))
        caption(
            console,
            "all: every scan in contact. interior: the object's centre at most 22 mm "
            "from the palm's. factor: one per method and set of scans, fitted at 25 mm/s "
            "on strokes that are not in the table, in brackets the standard error of its "
            "last digits. RMSE in mm/s and %, ± the standard error of the latter; bias in %.",
        )


def _paper_table(rows: Sequence[PaperRow]) -> Shown:
    speeds = (("backward", "backward_mm_s", 2), ("forward", "forward_mm_s", 2), ("RMSE mm/s", "rmse_mm_s", 2))
    columns = (("mm/s", "nominal_mm_s"), _METHOD, *speeds, ("RMSE %", "rmse_percent", 1))
    return shown(rows, *columns, title="Table I as published: one trial")


def _our_table(report: Table1Report) -> Shown:
    def error(field: str, form: str = ".{}f", fewer: int = 0) -> Callable[[Row], str]:
        return lambda row: format(getattr(row, field), form.format(decimals(row.rmse_percent) - fewer))

    return shown(
        report.ours,
        *(("mm/s", "nominal_mm_s"), _METHOD, ("scans:", "scans")),
        ("factor", lambda row: "none" if row.factor == 1.0 else _factor(row)),
        *(("back", "backward_mm_s", 2), ("forth", "forward_mm_s", 2)),
        *(("RMSE", error("rmse_mm_s")), ("%", error("rmse_percent")), ("±", error("standard_error_percent"))),
        ("bias", error("bias_percent", "+.{}f", fewer=1)),
        title=f"ours: {report.strokes} strokes a speed, seed {report.seed}" + solved_by(report.solver),
        section="nominal_mm_s",
    )


_METHOD: Column = ("method:", lambda row: short(row.method))


def _factor(row: Row) -> str:
    """A factor, in brackets the standard error of its last digits."""
    digits = 4 if row.factor_standard_error < 99.5e-4 else 3
    return f"{row.factor:.{digits}f}({10**digits * row.factor_standard_error:.0f})"
