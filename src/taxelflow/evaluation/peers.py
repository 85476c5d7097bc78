"""Score peers: Table I by other software, the same strokes through frame-pair methods beside the paper's and ours.

A pair of scans gives a displacement; their sum is the position, whose slope is the velocity, as for every method. A
pair for which a library fails or gives no number is left out: the sum starts again after it, and lines of one common
slope are fitted to the pieces. The share of failed pairs is reported.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from rich.console import Console

from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.base import Table, table_of, unwatched
from taxelflow.evaluation.cells import caption, decimals, short, solved_by
from taxelflow.evaluation.peer_methods import peers
from taxelflow.evaluation.statistics import rms
from taxelflow.evaluation.strokes import (
    SETS,
    TABLE1,
    Row,
    Stroke,
    Strokes,
    bounds,
    cut,
    rows_of,
    run_trials,
    scored_methods,
    strokes_by,
    ungrouped,
)
from taxelflow.pipeline import api
from taxelflow.publish.quiet import quiet_table
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray
    from rich.table import Table as Shown

    from taxelflow.acquire.base import Recording
    from taxelflow.evaluation.base import Cell, Watch
    from taxelflow.evaluation.peer_methods import Pair
    from taxelflow.evaluation.strokes import Seen
    from taxelflow.messages import Floats, Scans
    from taxelflow.simulation.scenario import Scenario


class BoundRow(msgspec.Struct, frozen=True):
    """The Cramér-Rao bound of a stroke's velocity, pattern known, RMS over the strokes, percent of the speed."""

    nominal_mm_s: int
    scans: str
    percent: float


class Failed(msgspec.Struct, frozen=True):
    """Share of a peer's pairs of scans in contact for which it gave no number, over all strokes."""

    method: str
    pairs: int
    percent: float


class Best(msgspec.Struct, frozen=True):
    """The best peer's error over that of our best method, by the same factor's use."""

    nominal_mm_s: int
    scans: str
    fitted: bool
    peer: str
    ours: str
    ratio: float


@dataclass(frozen=True)
class Peers(Strokes):
    """Compare with OpenCV, scikit-image, OpenPIV (extra `bench`).

    All estimate the velocity of the strokes of Table I.
    """

    def run(self, watched: Watch = unwatched) -> PeersReport:
        """Run the strokes through our estimators and the peers. Raises ExtraMissing, NameUnknown, ParameterInvalid."""
        ours, pairs = self.methods or scored_methods(), peers()
        measured = _Measured(ours, pairs)
        seen = run_trials(self.strokes, self.seed, measured.measure, self.solver, watched)
        silent = [name for name in (*ours, *pairs) if not _heard(seen, name)]
        if wrong := [name for name in ours if name in silent]:
            raise ParameterInvalid("methods", ", ".join(wrong), "give a position: leave these methods out")
        rows = rows_of(seen, [name for name in (*ours, *pairs) if name not in silent])
        return PeersReport(
            strokes=self.strokes + self.strokes % 2,
            seed=self.seed,
            solver=self.solver,
            ours=ours,
            rows=rows,
            bounds=measured.bounds(),
            failed=measured.failed(),
            best=_best(rows, ours),
            silent=silent,
        )


class _Measured:
    """Measures trials by our methods and the peers; sums up the strokes' bounds and the peers' failures."""

    def __init__(self, ours: tuple[str, ...], pairs: dict[str, Pair]) -> None:
        self._ours, self._pairs = ours, pairs
        self._tally = {name: [0, 0] for name in pairs}
        self._deviations: dict[tuple[int, str], list[float]] = {}

    def measure(self, scenario: Scenario) -> dict[str, list[Stroke]]:
        """The strokes of one trial by each method and peer."""
        recording = ungrouped(simulate(scenario))
        scans = api.conditioned(recording)
        for stroke in bounds(scenario, recording.known_truth):
            for scans_of in SETS:
                own = self._deviations.setdefault((round(1e3 * scenario.motion.speed_m_s), scans_of), [])
                own.append(getattr(stroke, scans_of))
        found = {method: strokes_by(method, recording, scans) for method in self._ours}
        return found | {
            name: _followed(pair, recording, scans, self._tally[name]) for name, pair in self._pairs.items()
        }

    def bounds(self) -> list[BoundRow]:
        """RMS of the strokes' bounds, by speed and set of scans."""
        return [
            BoundRow(speed, scans, 100 * rms(self._deviations[speed, scans]) / speed)
            for speed in TABLE1.speeds_mm_s
            for scans in SETS
        ]

    def failed(self) -> list[Failed]:
        """Share of each peer's pairs without a number."""
        return [Failed(name, total, 100 * lost / max(total, 1)) for name, (total, lost) in self._tally.items()]


class PeersReport(msgspec.Struct, frozen=True):
    """All of one run."""

    strokes: int
    seed: int
    solver: str
    ours: tuple[str, ...]
    rows: list[Row]
    bounds: list[BoundRow]
    failed: list[Failed]
    best: list[Best]
    silent: list[str]
    """Peers that gave no velocity of any stroke to fit a factor to."""

    def tables(self) -> list[Table]:
        """Velocity errors of all with the bound, then the ratios of the best."""
        rows: list[tuple[Cell, ...]] = []
        for speed in TABLE1.speeds_mm_s:
            rows += [(speed, *cells) for cells in self._cells(speed)]
        columns = ("all", "interior", "all_fitted", "interior_fitted")
        headings = ("speed_mm_s", "method", *(f"{column}_rmse_percent" for column in columns), "failed_pairs_percent")
        return [Table("rmse", headings, rows), table_of("best", self.best, Best)]

    def _cells(self, speed: int) -> Iterator[tuple[Cell, ...]]:
        """At one speed, of each method and of the bound: errors uncalibrated and fitted, share of failed pairs."""
        own = {
            (row.method, row.scans, row.factor_standard_error > 0): row
            for row in self.rows
            if row.nominal_mm_s == speed
        }
        failed = {row.method: row.percent for row in self.failed}
        for method in dict.fromkeys(method for method, _, _ in own):
            errors = (own[method, scans, fitted].rmse_percent for fitted in (False, True) for scans in SETS)
            yield (method, *errors, failed.get(method))
        bound = {row.scans: row.percent for row in self.bounds if row.nominal_mm_s == speed}
        yield ("Cramér-Rao bound", *(bound[scans] for scans in SETS), None, None, None)

    def show(self) -> None:
        """Errors of all on the same strokes, then the best peer's error over our best."""
        console = Console(markup=False)
        console.print(self._shown())
        for best in (best for best in self.best if best.scans == "all"):
            factor = "one factor fitted" if best.fitted else "uncalibrated"
            compared = f"{best.peer} over {short(best.ours)}: x {best.ratio:.1f}"
            console.print(f"{best.nominal_mm_s} mm/s, all scans, {factor}: {compared}", highlight=False)
        if self.silent:
            console.print(f"no velocity at all: {', '.join(self.silent)}", highlight=False)
        caption(
            console,
            "all: every scan in contact. interior: the object near the palm's centre. "
            "fit: with one factor a method and set, fitted at 25 mm/s on other strokes. "
            "failed: pairs of scans without an answer, in %; the sum of displacements starts "
            "again after them. In brackets: strokes, where not all gave a velocity.",
        )

    def _shown(self) -> Shown:
        title = f"velocity RMSE in %, {self.strokes} strokes a speed, seed {self.seed}" + solved_by(self.solver)
        table = quiet_table("mm/s", "method:", "all", "interior", "all, fit", "interior, fit", "failed", title=title)
        errors = {(r.nominal_mm_s, r.method, r.scans, r.factor_standard_error > 0): r for r in self.rows}
        failed = {row.method: f"{row.percent:.1f}" for row in self.failed}
        bounds_ = {(row.nominal_mm_s, row.scans): f"{row.percent:.3f}" for row in self.bounds}
        for speed in dict.fromkeys(row.nominal_mm_s for row in self.rows):
            for method in dict.fromkeys(row.method for row in self.rows):
                cells = [
                    _percent(errors[speed, method, scans, fitted], self.strokes)
                    for fitted in (False, True)
                    for scans in SETS
                ]
                table.add_row(str(speed), short(method), *cells, failed.get(method, ""))
            own = (bounds_[speed, "all"], bounds_[speed, "interior"])
            table.add_row(str(speed), "Cramér-Rao bound", *own, "", "", "", end_section=True)
        return table


def _percent(row: Row, strokes: int) -> str:
    """An error, with the number of strokes where some have no velocity."""
    return f"{row.rmse_percent:.{decimals(row.rmse_percent)}f}" + (f" ({row.strokes})" if row.strokes < strokes else "")


def _heard(seen: Seen, method: str) -> bool:
    return all(
        any(np.isfinite(getattr(stroke, scans)) for stroke in seen[which, method])
        for which in ("fit", *TABLE1.speeds_mm_s)
        for scans in SETS
    )


def _followed(pair: Pair, recording: Recording, scans: Scans, tally: list[int]) -> list[Stroke]:
    """The strokes of one recording by a peer. tally: [pairs, failed ones], counted up."""
    truth = recording.known_truth
    pad = recording.layout.pads.index(truth.pad)
    images = [recording.layout.grid(pad, pressure, fill=0.0) for pressure in scans.pressure]
    x_m, piece, (total, lost) = accumulated(
        pair, images, scans.contact[:, pad], float(recording.layout.pitch_m[pad, 0])
    )
    tally[0] += total
    tally[1] += lost
    return list(cut(truth, x_m, piece=piece))


def accumulated(
    pair: Pair, images: Sequence[Floats], contact: NDArray[np.bool_], pitch_m: float
) -> tuple[Floats, NDArray[np.int64], tuple[int, int]]:
    """Positions (scans,) along x by summing displacements in contact, number of the unbroken piece (scans,), and
    (pairs, failed ones).
    """
    x_m, piece = np.full(len(images), np.nan), np.zeros(len(images), dtype=np.int64)
    total = lost = 0
    for k in np.flatnonzero(contact).tolist():
        follows = k > 0 and bool(contact[k - 1])
        right = _displacement(pair, images[k - 1], images[k]) if follows else float("nan")
        total += follows
        lost += follows and not np.isfinite(right)
        whole = bool(np.isfinite(right))
        x_m[k] = x_m[k - 1] + pitch_m * right if whole else 0.0
        piece[k:] = piece[k] + (not whole)
    return x_m, piece, (total, lost)


def _displacement(pair: Pair, before: Floats, after: Floats) -> float:
    try:
        with np.errstate(all="ignore"):
            return pair(before, after)[0]
    except Exception:  # whatever a library raises on a pair of scans is its answer to it
        return float("nan")


def _best(rows: list[Row], ours: tuple[str, ...]) -> list[Best]:
    found = []
    for key in product(TABLE1.speeds_mm_s, SETS, (False, True)):
        group = [row for row in rows if (row.nominal_mm_s, row.scans, row.factor_standard_error > 0) == key]
        own = min((row for row in group if row.method in ours), key=lambda row: row.rmse_percent)
        others = [row for row in group if row.method not in ours]
        if others:
            peer = min(others, key=lambda row: row.rmse_percent)
            found.append(Best(*key, peer.method, own.method, peer.rmse_percent / own.rmse_percent))
    return found
