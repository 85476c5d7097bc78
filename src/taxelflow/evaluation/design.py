"""Design of a skin: error of translation and turn against taxel pitch, layout, noise, rate, object size and shape.

The paper's guideline is an object ten times as large as a taxel. Here an object of known pattern lies at random on an
unlimited skin; taxels of all layouts have the same area, pitch^2, and read the mean pressure over their own shape. In
each scan gain and baseline are unknown. Two numbers each: the Cramér-Rao bound, and the error of a maximum-likelihood
fit (Levenberg-Marquardt), which shows where the bound is not attained.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Literal

import msgspec
import numpy as np
from rich.console import Console
from scipy.optimize import least_squares

from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.base import table_of, unwatched
from taxelflow.evaluation.cells import caption, shown
from taxelflow.evaluation.statistics import rms
from taxelflow.runtime.checks import at_least, positive, within

if TYPE_CHECKING:
    from taxelflow.evaluation.base import Table, Watch
    from taxelflow.messages import Floats

Skin = Literal["square", "hexagonal", "triangular"]
Body = Literal["asymmetric", "bar", "round"]
_MOST_TRIALS = 100_000
"""Trials of a design at most: a mistyped number would run for days."""


@dataclass(frozen=True)
class Design:
    """Sweep a skin's design: errors of translation and turn by pitch, layout, noise, rate, object size and shape."""

    size_mm: tuple[float, ...] = (40.0,)
    """Length of the object, mm; one or more."""
    pitch_mm: tuple[float, ...] = (2.5, 4.0, 6.67, 10.0, 13.3, 20.0)
    """Side of a square taxel, mm; taxels of other layouts have its area."""
    layouts: tuple[Skin, ...] = ("square", "hexagonal", "triangular")
    """Layouts of the skin."""
    shapes: tuple[Body, ...] = ("asymmetric",)
    """Shapes of the object. asymmetric: an ellipse with a hump. bar: an ellipse. round: a disc."""
    noise_percent: tuple[float, ...] = (0.8,)
    """Standard deviations of a reading, in percent of the largest pressure."""
    rate_hz: tuple[float, ...] = (50.0,)
    """Scan rate, Hz, for the error of the velocity."""
    fill: float = 0.9
    """Side of a taxel's sensitive area over that of the taxel, above 0 and at most 1."""
    window_s: float = 0.25
    """Window of the velocity, s."""
    trials: int = 12
    """Number of random poses of each design, 1 to 100000."""
    seed: int = 0
    """Seed of poses and noise."""

    def __post_init__(self) -> None:
        within("trials", self.trials, 1, _MOST_TRIALS)
        at_least("seed", self.seed, 0)
        for name in ("size_mm", "pitch_mm", "noise_percent", "rate_hz", "layouts", "shapes"):
            if not getattr(self, name):
                raise ParameterInvalid(name, "nothing", "name at least one")
        for name in ("size_mm", "pitch_mm", "noise_percent", "rate_hz"):
            for value in getattr(self, name):
                positive(name, value)
        for size, pitch in product(self.size_mm, self.pitch_mm):
            if not 1 <= size / pitch <= 50:
                raise ParameterInvalid("pitch_mm", pitch, f"be between 1/50 of the object and the object, {size:g} mm")
        positive("window_s", self.window_s)
        if self.window_s * min(self.rate_hz) < 2:
            raise ParameterInvalid("window_s", self.window_s, f"hold two scans or more at {min(self.rate_hz):g} Hz")
        if not 0 < self.fill <= 1:
            raise ParameterInvalid("fill", self.fill, "be above 0 and at most 1")

    def run(self, watched: Watch = unwatched) -> DesignReport:
        """Draw poses, compute bounds, fit."""
        sweep = list(product(self.shapes, self.size_mm, self.pitch_mm, self.layouts, self.noise_percent))
        rows = []
        for shape, size, pitch, layout, noise in watched(sweep, "designs"):
            found = _trials(self, shape, size, pitch, layout, noise)
            rows += [_row(self, (shape, size, pitch, layout, noise, rate), *found) for rate in self.rate_hz]
        return DesignReport(rows)


class DesignRow(msgspec.Struct, frozen=True):
    """One design, RMS over its trials. None: the turn cannot be seen."""

    shape: str
    size_mm: float
    pitch_mm: float
    ratio: float
    """Length of the object over the pitch: the paper's guideline is 10."""
    layout: str
    noise_percent: float
    rate_hz: float
    bound_mm: float
    error_mm: float
    bound_deg: float | None
    error_deg: float | None
    speed_mm_s: float
    """Standard deviation of the velocity at the bound: a straight line through the scans of the window."""
    lost_percent: float
    """Trials in which the fit found another minimum; not in the errors."""
    trials: int


class DesignReport(msgspec.Struct, frozen=True):
    """All rows."""

    rows: list[DesignRow]

    def tables(self) -> list[Table]:
        """The rows."""
        return [table_of("rows", self.rows, DesignRow)]

    def show(self) -> None:
        """One table."""
        console = Console(markup=False)
        table = shown(
            self.rows,
            ("shape:", "shape"),
            ("mm", lambda row: f"{row.size_mm:g}"),
            *(("ratio", "ratio", 1), ("layout:", "layout")),
            ("noise %", lambda row: f"{row.noise_percent:g}"),
            ("Hz", lambda row: f"{row.rate_hz:g}"),
            *(("bound mm", "bound_mm", 4), ("fit mm", "error_mm", 4)),
            *(("bound deg", "bound_deg", 3), ("fit deg", "error_deg", 3)),
            *(("mm/s", "speed_mm_s", 3), ("lost %", "lost_percent", 0)),
            title="skin designs",
        )
        console.print(table)
        caption(
            console, "ratio: object over taxel; bound and fit: RMS of one scan, pattern known; mm/s: of the velocity."
        )


def pressure_of(shape: Body, u: Floats) -> Floats:
    """Pressure (...) of an object of length 1 at places u (..., 2) in its frame, about 1 at most."""
    x, y = u[..., 0], u[..., 1]
    if shape == "round":
        return np.asarray(np.exp(-((np.hypot(x, y) / 0.4) ** 4)), dtype=np.float64)
    body = np.exp(-0.5 * ((x / 0.24) ** 2 + (y / 0.14) ** 2))
    hump = 0.6 * np.exp(-0.5 * (((x - 0.22) / 0.09) ** 2 + ((y - 0.08) / 0.09) ** 2))
    return np.asarray(body + hump if shape == "asymmetric" else body)


def lattice(layout: Skin, pitch: float, half: float, fill: float = 0.9, across: int = 8) -> tuple[Floats, Floats]:
    """Centres (taxels, 2) within +-half, and places (taxels, m, 2) over each taxel, relative to its centre.

    across: places over the width of a taxel.
    """
    grid = (np.arange(across) + 0.5) / across - 0.5
    square = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    if layout == "square":
        steps = np.arange(-np.ceil(half / pitch), np.ceil(half / pitch) + 1) * pitch
        centres = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        return centres, np.broadcast_to(fill * pitch * square, (len(centres), *square.shape))
    if layout == "hexagonal":
        apart = pitch * np.sqrt(2 / np.sqrt(3))
        count = int(np.ceil(2 * half / apart)) + 2
        i, j = np.meshgrid(np.arange(-count, count + 1), np.arange(-count, count + 1))
        centres = np.stack([apart * (i + 0.5 * (j % 2)), apart * np.sqrt(0.75) * j], axis=-1).reshape(-1, 2)
        ways = np.stack([[np.cos(a), np.sin(a)] for a in (0.0, np.pi / 3, 2 * np.pi / 3)], axis=1)
        inside = (np.abs(1.2 * square @ ways) <= 0.5).all(axis=1)
        centres = centres[np.abs(centres).max(axis=1) <= half]
        return centres, np.broadcast_to(fill * apart * 1.2 * square[inside], (len(centres), int(inside.sum()), 2))
    side = pitch * 2 / 3**0.25
    height = side * np.sqrt(0.75)
    count = int(np.ceil(half / height)) + 2
    i, j = np.meshgrid(np.arange(-3 * count, 3 * count + 1), np.arange(-count, count + 1))
    up = (i + j) % 2 == 0
    centres = np.stack([0.5 * side * i, height * (j + np.where(up, 1 / 3, 2 / 3))], axis=-1).reshape(-1, 2)
    weights = np.array([(a, b) for a in grid + 0.5 for b in grid + 0.5 if a + b < 1])
    own = fill * (weights - weights.mean(axis=0)) @ (side * np.array([[1.0, 0.0], [0.5, np.sqrt(0.75)]]))
    places = np.where(up.reshape(-1, 1, 1), own, -own)
    near = np.abs(centres).max(axis=1) <= half
    return centres[near], places[near]


def _trials(asked: Design, shape: Body, size: float, pitch: float, layout: Skin, noise: float) -> tuple[Floats, Floats]:
    """Bounds (trials, 3) and errors (trials, 3) of x, y and turn, in object lengths and rad; NaN of a lost fit."""
    random = np.random.default_rng([asked.seed, 7])
    step = pitch / size
    centres, places = lattice(layout, step, 0.75 + 2 * step, asked.fill)
    sigma = noise / 100
    turns = shape != "round"
    bounds, errors = np.full((asked.trials, 3), np.nan), np.full((asked.trials, 3), np.nan)
    for trial in range(asked.trials):
        pose = np.array([*(step * random.uniform(-0.5, 0.5, 2)), random.uniform(-np.pi, np.pi)])
        readings = _readings(shape, centres, places, pose)
        J = _derivatives(shape, centres, places, pose, readings)[:, [0, 1, *([2] if turns else []), 3, 4]]
        own = np.sqrt(np.diagonal(np.linalg.pinv(J.T @ J)))[: 3 if turns else 2] * sigma
        bounds[trial, : len(own)] = own
        y = readings + random.normal(0.0, sigma, len(readings))
        start = np.concatenate([pose[:2] + random.normal(0, 0.02, 2), [pose[2] + random.normal(0, 0.03)], [1.0, 0.0]])
        held = start.copy()
        held[2] = pose[2]

        def off(z: Floats, y: Floats = y, fixed: float = float(pose[2])) -> Floats:
            turn = z[2] if turns else fixed
            left: Floats = y - z[3] * _readings(shape, centres, places, np.array([z[0], z[1], turn])) - z[4]
            return left

        found = least_squares(off, start if turns else held, method="trf", x_scale=[0.1, 0.1, 0.1, 1.0, 1.0])
        error = found.x[:3] - pose
        if np.hypot(*error[:2]) < 0.25:  # else it has found another minimum
            errors[trial, : len(own)] = error[: len(own)]
    return bounds, errors


def _readings(shape: Body, centres: Floats, places: Floats, pose: Floats) -> Floats:
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    off = centres[:, np.newaxis] + places - pose[:2]
    u = np.stack([cos * off[..., 0] + sin * off[..., 1], cos * off[..., 1] - sin * off[..., 0]], axis=-1)
    readings: Floats = pressure_of(shape, u).mean(axis=1)
    return readings


def _derivatives(shape: Body, centres: Floats, places: Floats, pose: Floats, readings: Floats) -> Floats:
    """(taxels, 5), by x, y, turn, gain and baseline."""
    columns = []
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1e-4
        ahead, back = (_readings(shape, centres, places, pose + way * step) for way in (1, -1))
        columns.append((ahead - back) / 2e-4)
    return np.stack([*columns, readings, np.ones_like(readings)], axis=1)


def _row(
    asked: Design, design: tuple[Body, float, float, Skin, float, float], bounds: Floats, errors: Floats
) -> DesignRow:
    shape, size, pitch, layout, noise, rate = design
    turns = shape != "round"
    lost = ~np.isfinite(errors[:, 0])
    along = rms(bounds[:, :2]) * size
    scans = asked.window_s * rate
    kept = errors[~lost] if not lost.all() else np.full((1, 3), np.nan)
    return DesignRow(
        shape=shape,
        size_mm=size,
        pitch_mm=pitch,
        ratio=size / pitch,
        layout=layout,
        noise_percent=noise,
        rate_hz=rate,
        bound_mm=float(np.sqrt(2)) * along,
        error_mm=float(np.sqrt(2)) * rms(kept[:, :2]) * size,
        bound_deg=float(np.degrees(rms(bounds[:, 2]))) if turns else None,
        error_deg=float(np.degrees(rms(kept[:, 2]))) if turns else None,
        speed_mm_s=float(np.sqrt(2)) * along * rate * float(np.sqrt(12 / (scans * (scans**2 - 1)))),
        lost_percent=100 * float(lost.mean()),
        trials=asked.trials,
    )
