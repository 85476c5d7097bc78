"""Score robustness: estimators on reliefs pressed on an elastic skin, with each fault of a real sensor and with all.

The contact model shares no code with any estimator. Every case is one recording with a known path.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, get_args

import msgspec
from rich.console import Console

from taxelflow.errors import NameUnknown, TipsOver
from taxelflow.estimation.base import Mode
from taxelflow.evaluation.base import table_of, unwatched
from taxelflow.evaluation.cells import Column, caption, number, percent, seeds_from, short, shown
from taxelflow.evaluation.robustness_rows import SIMPLE, CaseRow, RobustnessSummary, row_of, summaries, with_ratios
from taxelflow.pipeline import api
from taxelflow.publish.quiet import quiet_table
from taxelflow.runtime.checks import at_least
from taxelflow.simulation.relief.cases import EFFECTS, PLACES, Moved, case, sensor_at
from taxelflow.simulation.relief.parameters import Shape
from taxelflow.simulation.relief.simulate import simulate_relief

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from rich.table import Table as Shown

    from taxelflow.evaluation.base import Table, Watch

SHAPES: tuple[Shape, ...] = get_args(Shape)
METHODS = (*SIMPLE, "template")
PAIRS: tuple[tuple[Shape, str], ...] = (
    ("handle", "grid"), ("fine-handle", "palm"), ("nut", "hex"), ("bolt", "grid"), ("key", "sdh"), ("coin", "sdh"),
    ("ring", "grid"), ("letters", "hex"), ("dome", "palm"), ("bar", "xela"), ("cloth", "xela"), ("tripod", "sdh"),
)  # fmt: skip
"""Each shape on one layout: the cases of a run that names neither shapes nor layouts."""


@dataclass(frozen=True)
class Robustness:
    """Measure estimators on reliefs with the faults of real sensors.

    Twelve rigid shapes slide and turn on five layouts; faults act one by one or all together. Without options: each
    shape on one layout, all faults together.
    """

    seeds: int = 1
    """Number of recordings of each case, 1 or more."""
    seed: int = 0
    """Seed of the first recording, 0 or more; the others count up from it."""
    methods: tuple[str, ...] = METHODS
    """Estimators to score. Ratios are to the best of lnorm, convolution and registration, as far as they are named."""
    mode: Mode = "batch"
    """Processing mode. batch: learn tare and noise from the whole recording first. stream: scan by scan, scored from
    one second after the first contact on."""
    effects: tuple[str, ...] = ("all",)
    """Faults of the sensor to simulate; an unknown name lists them."""
    shapes: tuple[str, ...] = ()
    """Shapes of the object, on every layout given; each on one layout if both are left out."""
    layouts: tuple[str, ...] = ()
    """Layouts of taxels: palm, sdh, grid, xela, hex; all of them if shapes are given."""
    moved: Moved = "slide-turn"
    """Motion of the object: hold, slide, turn or slide-turn."""
    full: bool = False
    """Run every effect on every shape and layout; this takes hours."""

    def __post_init__(self) -> None:
        at_least("seeds", self.seeds, 1)
        at_least("seed", self.seed, 0)
        for what, asked, known in (
            ("effect", self.effects, EFFECTS),
            ("shape", self.shapes, SHAPES),
            ("layout", self.layouts, PLACES),
            ("motion", (self.moved,), get_args(Moved)),
        ):
            _check(what, asked, known)

    def cases(self) -> list[tuple[str, Shape, str]]:
        """Effect, shape and layout of each case."""
        effects = tuple(EFFECTS) if self.full else self.effects
        if not (self.full or self.shapes or self.layouts):
            return [(effect, *pair) for effect, pair in product(effects, PAIRS)]
        shapes = [shape for shape in SHAPES if shape in (self.shapes or SHAPES)]
        return list(product(effects, shapes, self.layouts or PLACES))

    def run(self, watched: Watch = unwatched) -> RobustnessReport:
        """Simulate, estimate, compare. Raises NameUnknown."""
        kinds = {method: api.estimator(method) for method in self.methods}
        rows: list[CaseRow] = []
        tipped: list[str] = []
        runs = list(product(self.cases(), range(self.seed, self.seed + self.seeds)))
        for (effect, shape, layout), seed in watched(runs, "cases"):
            place = PLACES[layout]
            pressing = case(shape, layout, effect, self.moved, seed)
            try:
                recording = simulate_relief(pressing, sensor_at(place), place.pad)
            except TipsOver:
                tipped.append(f"{effect}, {shape} on {layout}, seed {seed}")
                continue
            for method, kind in kinds.items():
                result = api.estimate(recording, kind, mode=self.mode)
                slips, pad = result.slips, result.pads.index(place.pad)
                rows.append(row_of((effect, shape, layout, seed, method), pressing, slips, pad, self.mode))
        rows = with_ratios(rows)
        return RobustnessReport(self.mode, self.moved, self.seeds, self.seed, rows, summaries(rows), tipped)


def _check(what: str, asked: Collection[str], known: Collection[str]) -> None:
    """Raises NameUnknown if a name is none of the known ones."""
    for name in asked:
        if name not in known:
            raise NameUnknown(what, name, known)


class RobustnessReport(msgspec.Struct, frozen=True):
    """All of one run."""

    mode: str
    moved: str
    seeds: int
    seed: int
    rows: list[CaseRow]
    summaries: list[RobustnessSummary]
    tipped: list[str]
    """Cases without rows, because the object tips over."""

    def tables(self) -> list[Table]:
        """A row for each case and method, then the summary of each effect and method."""
        return [
            table_of("cases", self.rows, CaseRow),
            table_of("summary", self.summaries, RobustnessSummary),
        ]

    def show(self) -> None:
        """Errors of all methods by case, then each method's honesty, then the summary."""
        console = Console(markup=False)
        console.print(self._errors())
        caption(
            console,
            "RMS of the position's error in mm, one constant offset a recording taken off; -: a "
            "pose in fewer than half of the scans in contact.",
        )
        for method in dict.fromkeys(one.method for one in self.summaries):
            console.print()
            console.print(self._honesty(method))
        caption(
            console,
            "ratio: to the best of the simple methods. NEES: 1 is right, above: the "
            "covariance is too small. ok: share of scans in contact. wrong: share of these off "
            "by over 3 sigma and 0.3 mm, the offset taken off that fits the ok poses best.",
        )
        console.print()
        console.print(_summary(self.summaries))
        caption(
            console,
            "worse: cases more than 1.1 times the error of the best simple method. better: "
            "share of cases with less than a third of it. NEES: median over the cases. ok, "
            "wrong: of all scans.",
        )
        if self.tipped:
            caption(console, f"left out, because the object tips over: {'; '.join(self.tipped)}")

    def _errors(self) -> Shown:
        methods = list(dict.fromkeys(row.method for row in self.rows))
        title = (
            f"reliefs on an elastic skin, {self.moved}, {self.mode}, {seeds_from(self.seed, self.seeds)}: error in mm"
        )
        table = quiet_table("effect:", "shape:", "layout:", "seed", *map(short, methods), title=title)
        by_case: dict[tuple[str, str, str, int], dict[str, CaseRow]] = {}
        for row in self.rows:
            by_case.setdefault((row.effect, row.shape, row.layout, row.seed), {})[row.method] = row
        for (effect, shape, layout, seed), own in by_case.items():
            errors = [number(own[method].error_mm, 3) for method in methods]
            table.add_row(effect, shape, layout, str(seed), *errors)
        return table

    def _honesty(self, method: str) -> Shown:
        return shown(
            [row for row in self.rows if row.method == method],
            *(("effect:", "effect"), ("shape:", "shape"), ("layout:", "layout")),
            *(("ratio", "ratio", 2), ("mm", "error_mm", 3), ("deg", "error_deg", 2)),
            *(("NEES xy", "nees_position", 1), ("NEES turn", "nees_turn", 1), *_SHARES),
            title=method,
        )


def _summary(rows: Sequence[RobustnessSummary]) -> Shown:
    return shown(
        rows,
        *(("effect:", "effect"), ("method:", "method"), ("cases", "cases"), ("worse", "worse")),
        ("better %", lambda row: percent(row.better_share)),
        *(("ratio", "median_ratio", 2), ("worst", "largest_ratio", 2)),
        *(("NEES xy", "nees_position", 1), ("NEES turn", "nees_turn", 1), *_SHARES),
        title="summary",
    )


_SHARES: tuple[Column, Column] = (
    ("ok %", lambda row: percent(row.ok_share)),
    ("wrong %", lambda row: percent(row.wrong_share, 1)),
)
