"""Many strokes of an airbag over the palm, each the paper's experiment with an object, line and phase of its own.

Shared by the scores table1, hard and peers: the trials, the velocity of a stroke by a method, and the rows. Velocity is
the slope of a straight line through the positions of a stroke, as in the paper. For methods that are not the paper's,
whose variance differs from scan to scan, each position has the weight 1 / variance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow.estimation.completion import start_slips
from taxelflow.evaluation.bound import bound_of
from taxelflow.evaluation.statistics import rms
from taxelflow.messages import LOST, joined
from taxelflow.numerics.rounding import LINE_POINTS
from taxelflow.pipeline import api
from taxelflow.runtime import registry
from taxelflow.runtime.checks import at_least
from taxelflow.runtime.compiling import announced
from taxelflow.simulation.scenario import SCENARIOS, Scenario, Solver

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from taxelflow.acquire.base import Recording, Truth
    from taxelflow.estimation.base import Mode
    from taxelflow.evaluation.base import Watch
    from taxelflow.messages import Bools, Floats, Scans, Slips

PAPER_METHODS = ("lnorm", "convolution")
OUR_METHODS = ("template",)
"""Scored beside the paper's where they are registered."""


@dataclass(frozen=True, slots=True)
class _Table1:
    """Strokes of the paper's Table I."""

    speeds_mm_s: tuple[int, int] = (25, 50)
    """Their speeds."""
    interior_m: float = 0.022
    """Further out, a contact of this size leaves the 70 mm of the palm."""


TABLE1 = _Table1()
SETS = ("all", "interior")


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


@dataclass(frozen=True)
class Stroke:
    """Velocity of one stroke by a method, mm/s, by set of scans; NaN where too few scans are left."""

    backward: bool
    all: float
    interior: float


@dataclass(frozen=True)
class Strokes:
    """Options of the scores on many strokes."""

    strokes: int = 1000
    """Strokes at each speed, 2 or more; half of them go backward, so an odd number is rounded up."""
    seed: int = 0
    """Seed of the first trial, 0 or more; the others count up from it. Scores with one seed have the same trials."""
    methods: tuple[str, ...] = ()
    """Estimators to score; lnorm, convolution and template if left out."""
    solver: Solver = "analytic"
    """Contact model of the rig: analytic, or elastic (seconds a contact; extra `elastic`)."""

    def __post_init__(self) -> None:
        at_least("strokes", self.strokes, 2)
        at_least("seed", self.seed, 0)


Seen = dict[tuple[str | int, str], list[Stroke]]
"""Strokes by what they are for (`fit`, or the speed of the table's rows) and method."""


def run_trials(
    strokes: int,
    seed: int,
    measure: Callable[[Scenario], dict[str, list[Stroke]]],
    solver: Solver,
    watched: Watch,
) -> Seen:
    """Measure `strokes` strokes at each speed, and as many again at 25 mm/s to fit the factors, two a trial."""
    trials = (strokes + 1) // 2
    first = {"fit": seed, 25: seed + trials, 50: seed + 2 * trials}  # no trial is used twice
    seen: Seen = {}
    for number in watched(range(3 * trials), "trials"):
        which: str | int = ("fit", *TABLE1.speeds_mm_s)[number // trials]
        speed = which if isinstance(which, int) else TABLE1.speeds_mm_s[0]
        scenario = trial(first[which] + number % trials, speed, solver)
        for method, found in measure(scenario).items():
            seen.setdefault((which, method), []).extend(found)
    return seen


def trial(seed: int, speed_mm_s: int, solver: Solver = "analytic") -> Scenario:
    """The paper's experiment with an airbag, line and offsets of its own."""
    random = np.random.default_rng([seed, speed_mm_s])
    paper = SCENARIOS["stroke"]
    return replace(
        paper,
        seed=seed,
        solver=solver,
        contact=replace(paper.contact, radius_m=random.uniform(0.013, 0.017)),
        motion=replace(paper.motion, speed_m_s=speed_mm_s / 1e3, middle_m=(0.0, 0.005 + random.uniform(-0.002, 0.002))),
    )


def ungrouped(recording: Recording) -> Recording:
    """The recording on its sensor's pads alone: groups that lie on them would be estimated beside them, for nothing."""
    return replace(recording, sensor=msgspec.structs.replace(recording.sensor, groups=()))


def scored_methods() -> tuple[str, ...]:
    """The paper's methods and those of ours that are registered."""
    return (*PAPER_METHODS, *(method for method in OUR_METHODS if method in registry.names("estimator")))


def strokes_by(method: str, recording: Recording, scans: Scans, mode: Mode = "batch") -> list[Stroke]:
    """The strokes of one recording, given its conditioned scans, by an estimator."""
    truth = recording.known_truth
    pad = recording.layout.pads.index(truth.pad)
    with announced():
        session = start_slips(api.estimator(method), recording.layout, mode)
        slips = joined([session.step(scans), session.finish()])
    weight = None if method in PAPER_METHODS else _weight(slips, pad)
    return list(cut(truth, slips.pose[:, pad, 0], weight, np.cumsum(slips.quality[:, pad] == LOST)))


def _weight(slips: Slips, pad: int) -> Floats | None:
    """(scans,): 1 / variance of x; None if some position has no variance."""
    variance = slips.covariance[:, pad, 0, 0]
    known = np.isfinite(slips.pose[:, pad, 0])
    if not (variance[known] > 0).all():
        return None
    return 1 / np.where(known, variance, np.inf)


def passes(truth: Truth) -> list[tuple[bool, Bools]]:
    """Each stroke along x, in order: whether it goes backward, and its scans (scans,)."""
    direction = np.sign(np.round(np.gradient(truth.pose[:, 0], truth.t_s), 6))
    moving = np.flatnonzero(direction)
    number = np.zeros(len(direction), dtype=np.int64)  # 0: at rest
    number[moving] = 1 + np.cumsum(np.diff(direction[moving], prepend=direction[moving[:1]]) != 0)
    return [(bool(direction[number == one][0] < 0), number == one) for one in range(1, number.max(initial=0) + 1)]


def cut(
    truth: Truth, x_m: Floats, weight: Floats | None = None, piece: NDArray[np.int64] | None = None
) -> Iterator[Stroke]:
    """Velocities of all strokes, in order, from positions x_m (scans,), NaN where unknown.

    weight, piece: as in `slope`, (scans,).
    """
    known = np.isfinite(x_m)
    for backward, own in passes(truth):
        used = known & own
        whole, inner = (slope(truth.t_s, 1e3 * x_m, chosen, weight, piece) for chosen in (used, used & interior(truth)))
        yield Stroke(backward, whole, inner)


def bounds(scenario: Scenario, truth: Truth) -> list[Stroke]:
    """The smallest standard deviation of an unbiased slope, mm/s, of all strokes, the pattern known."""
    weight = 1 / np.square(1e3 * bound_of(scenario, truth.t_s, jointly=False).known[:, 0])
    return [
        Stroke(backward, *(_deviation(truth.t_s, weight * chosen) for chosen in (own, own & interior(truth))))
        for backward, own in passes(truth)
    ]


def _deviation(t_s: Floats, weight: Floats) -> float:
    """Standard deviation of a slope through positions whose information is weight (scans,)."""
    middle = np.sum(weight * t_s) / np.sum(weight)
    return float(1 / np.sqrt(np.sum(weight * (t_s - middle) ** 2)))


def interior(truth: Truth) -> Bools:
    """(scans,): the object is near the palm's centre, and was in the scan before: Method II spans two scans."""
    inner = np.abs(truth.pose[:, 0]) <= TABLE1.interior_m
    return np.asarray(inner & np.concatenate([[False], inner[:-1]]), dtype=np.bool_)


def slope(
    t_s: Floats, x: Floats, used: Bools, weight: Floats | None = None, piece: NDArray[np.int64] | None = None
) -> float:
    """Slope of the regression line through the used positions; NaN where they are fewer than 3.

    weight: (scans,), 1 for all if left out. piece: (scans,); positions of different numbers have origins of their own,
    so that lines of one slope are fitted side by side.
    """
    if used.sum() < LINE_POINTS:
        return float("nan")
    t, x = t_s[used], x[used]
    w = np.ones(len(t)) if weight is None else weight[used]
    own = np.zeros(len(t), dtype=np.int64) if piece is None else np.unique(piece[used], return_inverse=True)[1]
    total = np.bincount(own, w)
    t = t - (np.bincount(own, w * t) / total)[own]
    x = x - (np.bincount(own, w * x) / total)[own]
    spread = float(np.sum(w * t**2))
    return float(np.sum(w * t * x)) / spread if spread > 0 else float("nan")


def rms_of(errors: Sequence[Floats]) -> tuple[float, float | None]:
    """RMS over all errors, and its standard error; errors of one array are of one object, and scatter together.

    A single object shows no scatter: None.
    """
    square = np.array([np.sum(own**2) for own in errors])
    count = np.array([len(own) for own in errors])
    rms = float(np.sqrt(square.sum() / count.sum()))
    if len(errors) == 1 or rms == 0.0:
        return rms, None
    return rms, float(np.sqrt(np.sum((square - rms**2 * count) ** 2)) / count.sum() / (2 * rms))


def rows_of(seen: Seen, methods: Sequence[str]) -> list[Row]:
    """Every method's rows: by speed, set of scans, and uncalibrated or with the factor fitted at 25 mm/s."""
    rows = []
    for speed in TABLE1.speeds_mm_s:
        for method in methods:
            for scans in SETS:
                fitted = _factor(_velocities(seen["fit", method], scans), TABLE1.speeds_mm_s[0])
                measured = seen[speed, method]
                rows += [_row(speed, method, scans, factor, measured) for factor in ((1.0, 0.0), fitted)]
    return rows


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
    rmse = rms(error)
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
