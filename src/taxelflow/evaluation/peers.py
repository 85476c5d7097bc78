"""Table I by other software: the same strokes through frame-pair methods, beside the paper's methods and ours.

A pair of scans gives a displacement; their sum is the position, whose slope is the velocity, as for every method. A
pair for which a library gives no number, or fails, is no motion and no zero either: the sum begins anew after it, and
lines of one slope are fitted to the pieces. How many pairs failed is said.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow import api
from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.pairs import peers
from taxelflow.evaluation.strokes import SETS, SPEEDS_MM_S, Row, Stroke, bounds, cut, rows_of, run_trials, ungrouped
from taxelflow.evaluation.table1 import scored_methods, strokes_by
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import NDArray

    from taxelflow.acquire.base import Recording
    from taxelflow.evaluation.pairs import Pair
    from taxelflow.evaluation.strokes import Seen
    from taxelflow.messages import Floats, Scans
    from taxelflow.simulation.scenario import Scenario, Solver


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


class Peers(msgspec.Struct, frozen=True):
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


def score_peers(
    strokes: int,
    seed: int,
    watched: Callable[[Iterable[int]], Iterable[int]] = iter,
    methods: Sequence[str] = (),
    solver: Solver = "analytic",
) -> Peers:
    """Run the strokes of `table1` with that seed through our estimators and the peers.

    methods: ours; the paper's and the template if left out. Raises ExtraMissing, NameUnknown, ParameterInvalid.
    """
    ours, pairs = tuple(methods) or scored_methods(), peers()
    tally: dict[str, list[int]] = {name: [0, 0] for name in pairs}
    deviations: dict[tuple[int, str], list[float]] = {}

    def measure(scenario: Scenario) -> dict[str, list[Stroke]]:
        recording = ungrouped(simulate(scenario))
        scans = api.conditioned(recording)
        for stroke in bounds(scenario, recording.known_truth):
            for scans_of in SETS:
                own = deviations.setdefault((round(1e3 * scenario.motion.speed_m_s), scans_of), [])
                own.append(getattr(stroke, scans_of))
        found = {method: strokes_by(method, recording, scans) for method in ours}
        return found | {name: _followed(pair, recording, scans, tally[name]) for name, pair in pairs.items()}

    seen = run_trials(strokes, seed, measure, watched, solver)
    silent = [name for name in (*ours, *pairs) if not _heard(seen, name)]
    if wrong := [name for name in ours if name in silent]:
        raise ParameterInvalid("methods", ", ".join(wrong), "give a position: leave these methods out")
    rows = rows_of(seen, [name for name in (*ours, *pairs) if name not in silent])
    return Peers(
        strokes=strokes + strokes % 2,
        seed=seed,
        solver=solver,
        ours=ours,
        rows=rows,
        bounds=[
            BoundRow(speed, scans, 100 * float(np.sqrt(np.mean(np.square(deviations[speed, scans])))) / speed)
            for speed in SPEEDS_MM_S
            for scans in SETS
        ],
        failed=[Failed(name, total, 100 * lost / max(total, 1)) for name, (total, lost) in tally.items()],
        best=_best(rows, ours),
        silent=silent,
    )


def _heard(seen: Seen, method: str) -> bool:
    return all(
        any(np.isfinite(getattr(stroke, scans)) for stroke in seen[which, method])
        for which in ("fit", *SPEEDS_MM_S)
        for scans in SETS
    )


def _followed(pair: Pair, recording: Recording, scans: Scans, tally: list[int]) -> list[Stroke]:
    """The strokes of one recording as a peer sees them. tally: [pairs, failed ones], counted up."""
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
    for speed in SPEEDS_MM_S:
        for scans in SETS:
            for fitted in (False, True):
                group = [
                    r for r in rows if (r.nominal_mm_s, r.scans, r.factor_standard_error > 0) == (speed, scans, fitted)
                ]
                own = min((r for r in group if r.method in ours), key=lambda r: r.rmse_percent)
                others = [r for r in group if r.method not in ours]
                if others:
                    peer = min(others, key=lambda r: r.rmse_percent)
                    ratio = peer.rmse_percent / own.rmse_percent
                    found.append(Best(speed, scans, fitted, peer.method, own.method, ratio))
    return found
