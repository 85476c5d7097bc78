"""Table I of the paper beside ours: velocity of many strokes of an airbag over the palm, by both methods.

Each trial is the paper's: backward along -x, then forward, at 7 Hz, with object, line and phase drawn at random.
Velocity is the slope of a straight line through the positions of a stroke, as in the paper.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow import api
from taxelflow.acquire.rig.scenario import SCENARIOS, Scenario
from taxelflow.acquire.rig.simulate import simulate
from taxelflow.compiling import announced
from taxelflow.messages import Slips

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from taxelflow.acquire.base import Recording, Truth
    from taxelflow.messages import Bools, Floats

METHODS = ("lnorm", "convolution")
SPEEDS_MM_S = (25, 50)
_INTERIOR_M = 0.022
"""Further out, a contact of this size leaves the 70 mm of the palm."""
_FEWEST = 3
"""A line through fewer positions is no velocity."""


class Row(msgspec.Struct, frozen=True):
    """One row of the table; velocities in mm/s, errors in mm/s and percent of the nominal speed."""

    nominal_mm_s: int
    method: str
    scans: str
    """all: every scan in contact. interior: the object's centre is at most 22 mm from the palm's."""
    factor: float
    """1 for the uncalibrated method, else fitted at 25 mm/s on strokes of their own."""
    factor_standard_error: float
    """0 for the uncalibrated method."""
    backward_mm_s: float
    forward_mm_s: float
    rmse_mm_s: float
    rmse_percent: float
    bias_percent: float
    """Mean error of the speed: negative is too slow."""
    standard_error_percent: float
    """Of rmse_percent, from the number of strokes."""
    strokes: int


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
    paper: tuple[PaperRow, ...]
    ours: list[Row]


@dataclass(frozen=True)
class Stroke:
    """Velocity of one stroke as a method sees it, in mm/s, by set of scans; NaN where too few scans are left."""

    backward: bool
    all: float
    interior: float


def table1(strokes: int, seed: int, watched: Callable[[Iterable[int]], Iterable[int]] = iter) -> Table1:
    """Run `strokes` strokes at each speed, and as many again at 25 mm/s to fit the factors."""
    trials = (strokes + 1) // 2
    first = {"fit": seed, 25: seed + trials, 50: seed + 2 * trials}  # no trial is used twice
    seen: dict[tuple[str | int, str], list[Stroke]] = {}
    for trial in watched(range(3 * trials)):
        which: str | int = ("fit", *SPEEDS_MM_S)[trial // trials]
        scenario = _trial(first[which] + trial % trials, which if isinstance(which, int) else SPEEDS_MM_S[0])
        for method, found in _strokes(simulate(scenario)).items():
            seen.setdefault((which, method), []).extend(found)
    rows = []
    for speed in SPEEDS_MM_S:
        for method in METHODS:
            for scans in ("all", "interior"):
                fitted = _factor(_velocities(seen["fit", method], scans), SPEEDS_MM_S[0])
                measured = seen[speed, method]
                rows += [_row(speed, method, scans, factor, measured) for factor in ((1.0, 0.0), fitted)]
    return Table1(2 * trials, seed, PAPER, rows)


def _trial(seed: int, speed_mm_s: int) -> Scenario:
    """The paper's experiment with an airbag, line and offsets of its own."""
    random = np.random.default_rng([seed, speed_mm_s])
    paper = SCENARIOS["stroke"]
    return replace(
        paper,
        seed=seed,
        contact=replace(paper.contact, radius_m=random.uniform(0.013, 0.017)),
        motion=replace(paper.motion, speed_m_s=speed_mm_s / 1e3, middle_m=(0.0, 0.005 + random.uniform(-0.002, 0.002))),
    )


def _strokes(recording: Recording) -> dict[str, list[Stroke]]:
    """Both methods on the same conditioned scans, cut into strokes."""
    truth = recording.known_truth
    pad = recording.layout.pads.index(truth.pad)
    scans = api.conditioned(recording)
    with announced():
        slips = {m: api.estimator(m).start(recording.layout, "batch").step(scans) for m in METHODS}
    return {method: list(_cut(slips[method], pad, truth)) for method in METHODS}


def _cut(slips: Slips, pad: int, truth: Truth) -> Iterable[Stroke]:
    direction = np.sign(np.round(np.gradient(truth.pose[:, 0], truth.t_s), 6))
    known = np.isfinite(slips.pose[:, pad, 0])
    inner = np.abs(truth.pose[:, 0]) <= _INTERIOR_M
    interior = inner & np.concatenate([[False], inner[:-1]])  # the index of Method II spans two scans
    for sign in (-1.0, 1.0):
        used = known & (direction == sign)
        x_mm = 1e3 * slips.pose[:, pad, 0]
        yield Stroke(sign < 0, _slope(truth.t_s, x_mm, used), _slope(truth.t_s, x_mm, used & interior))


def _slope(t_s: Floats, x_mm: Floats, used: Bools) -> float:
    """Slope of the regression line, mm/s."""
    if used.sum() < _FEWEST:
        return float("nan")
    return float(np.polyfit(t_s[used], x_mm[used], 1)[0])


def _velocities(strokes: list[Stroke], scans: str) -> Floats:
    """(strokes, 2): sign of the stroke, velocity; strokes without a velocity left out."""
    pairs = np.array([(-1.0 if stroke.backward else 1.0, getattr(stroke, scans)) for stroke in strokes])
    known: Floats = pairs[np.isfinite(pairs[:, 1])]
    return known


def _factor(velocities: Floats, speed_mm_s: float) -> tuple[float, float]:
    """Least squares: the factor that brings the velocities closest to the nominal ones, and its standard error."""
    sign, velocity = velocities.T
    factor = float(speed_mm_s * np.sum(sign * velocity) / np.sum(velocity**2))
    residual = speed_mm_s - factor * sign * velocity
    freedom = max(len(velocity) - 1, 1)
    return factor, float(np.sqrt(np.sum(residual**2) / freedom / np.sum(velocity**2)))


def _row(speed: int, method: str, scans: str, fitted: tuple[float, float], strokes: list[Stroke]) -> Row:
    sign, velocity = _velocities(strokes, scans).T
    factor, factor_error = fitted
    velocity = factor * velocity
    error = sign * velocity - speed
    rmse = float(np.sqrt(np.mean(error**2)))
    spread = float(np.std(error**2) / np.sqrt(len(error)) / (2 * rmse))
    return Row(
        nominal_mm_s=speed,
        method=method,
        scans=scans,
        factor=factor,
        factor_standard_error=factor_error,
        backward_mm_s=float(velocity[sign < 0].mean()),
        forward_mm_s=float(velocity[sign > 0].mean()),
        rmse_mm_s=rmse,
        rmse_percent=100 * rmse / speed,
        bias_percent=100 * float(error.mean()) / speed,
        standard_error_percent=100 * spread / speed,
        strokes=len(error),
    )
