"""Table I of the paper beside ours: velocity of many strokes of an airbag over the palm, by its methods and ours.

Each trial is the paper's: backward along -x, then forward, at 7 Hz, with object, line and phase drawn at random.
Velocity is the slope of a straight line through the positions of a stroke, as in the paper; methods of ours, whose
variance differs from scan to scan, weigh each position by 1 / variance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow import api, registry
from taxelflow.compiling import announced
from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.strokes import Row, Stroke, cut, rows_of, run_trials, ungrouped
from taxelflow.messages import LOST, joined
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from taxelflow.acquire.base import Recording
    from taxelflow.estimation.base import Mode
    from taxelflow.messages import Floats, Scans, Slips
    from taxelflow.simulation.scenario import Solver

METHODS = ("lnorm", "convolution")
"""The paper's."""
OURS = ("template",)
"""Scored beside them where they are registered."""


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


class Table1(msgspec.Struct, frozen=True):
    """The paper's rows and ours."""

    strokes: int
    seed: int
    solver: str
    paper: tuple[PaperRow, ...]
    ours: list[Row]


def table1(
    strokes: int,
    seed: int,
    watched: Callable[[Iterable[int]], Iterable[int]] = iter,
    methods: Sequence[str] = (),
    solver: Solver = "analytic",
) -> Table1:
    """Run `strokes` strokes at each speed, and as many again at 25 mm/s to fit the factors.

    methods: the paper's and ours if left out. Raises NameUnknown, ParameterInvalid, ExtraMissing (solver elastic).
    """
    chosen = tuple(methods) or scored_methods()
    seen = run_trials(strokes, seed, lambda scenario: _measured(simulate(scenario), chosen), watched, solver)
    for method in chosen:
        if not any(np.isfinite(stroke.all) for stroke in seen["fit", method]):
            raise ParameterInvalid("methods", method, "give a position: leave this method out")
    return Table1(strokes + strokes % 2, seed, solver, PAPER, rows_of(seen, chosen))


def scored_methods() -> tuple[str, ...]:
    """The paper's methods and those of ours that are registered."""
    return (*METHODS, *(method for method in OURS if method in registry.names("estimator")))


def _measured(recording: Recording, methods: Sequence[str]) -> dict[str, list[Stroke]]:
    recording = ungrouped(recording)
    scans = api.conditioned(recording)
    return {method: strokes_by(method, recording, scans) for method in methods}


def strokes_by(method: str, recording: Recording, scans: Scans, mode: Mode = "batch") -> list[Stroke]:
    """The strokes of one recording's conditioned scans as an estimator sees them."""
    truth = recording.known_truth
    pad = recording.layout.pads.index(truth.pad)
    with announced():
        session = api.estimator(method).start(recording.layout, mode)
        slips = joined([session.step(scans), session.finish()])
    weight = None if method in METHODS else _weight(slips, pad)
    return list(cut(truth, slips.pose[:, pad, 0], weight, np.cumsum(slips.quality[:, pad] == LOST)))


def _weight(slips: Slips, pad: int) -> Floats | None:
    """(scans,): 1 / variance of x; None if some position has no variance."""
    variance = slips.covariance[:, pad, 0, 0]
    known = np.isfinite(slips.pose[:, pad, 0])
    if not (variance[known] > 0).all():
        return None
    return 1 / np.where(known, variance, np.inf)
