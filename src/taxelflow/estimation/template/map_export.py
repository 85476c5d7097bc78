"""A learned pattern as a map: its pressure on a fine grid, in the frame that the poses given out are in."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.ndimage import convolve

from taxelflow.estimation.template.extrapolation import coverage, near
from taxelflow.estimation.template.map import Pattern, fill
from taxelflow.messages import LearnedPattern
from taxelflow.numerics.blas import on_one_core
from taxelflow.numerics.bspline import AT_KNOT, STATE, state_of
from taxelflow.numerics.geometry import rotation

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.estimation.template.deforming import Moment
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.messages import Floats


class _Limits(NamedTuple):
    """Limits of a map, and of all maps that are kept."""

    finer: int = 8
    most_points: int = 250_000
    """Points per pitch, and the most points of a map."""
    draws: int = 64
    """Patterns drawn from the posterior, whose spread is the standard deviation of a point."""
    half_diagonal: float = 0.7
    """Pitches from a taxel's middle to its corner: a reading observes points up to there."""
    fewest: int = 5
    """Scans of a contact below which it has no map."""
    most: int = 100
    most_bytes: float = 1e8
    """Maps that are kept, and their memory, at most."""


_LIMITS = _Limits()


class Maps(list[LearnedPattern]):
    """The maps that a session keeps, oldest first: those of most scans, so that memory stays bounded."""

    def keep(self, found: LearnedPattern | None) -> None:
        """Add a map, if there is one."""
        if found is None:
            return
        self.append(found)
        while len(self) > _LIMITS.most or sum(one.pressure.nbytes for one in self) > _LIMITS.most_bytes:
            self.remove(min(self, key=lambda one: one.scans))


def as_map(
    pad: str, shown: Moment, pose: Floats, error: float, pitch_m: float, dead: NDArray[np.int64]
) -> LearnedPattern | None:
    """Map of the pattern at a moment; None if its scans are too few to show more than a scan.

    pose: (3,) that was given out for the last of its states, in m and rad.
    """
    scanned, states = shown.scanned, shown.states
    if len(states) < _LIMITS.fewest:
        return None
    with on_one_core():
        x, y, pressure, std = mapped(shown.pattern, scanned, states, pose / [pitch_m, pitch_m, 1.0], error)
    times = float(scanned.t_s[0]), float(scanned.t_s[-1])
    return LearnedPattern(pad, *times, len(states), pitch_m * x, pitch_m * y, pressure, std, shown.turns, dead)


def mapped(
    pattern: Pattern, scanned: Scanned, states: Floats, pose: Floats, error: float
) -> tuple[Floats, Floats, Floats, Floats]:
    """x (nx,), y (ny,), pressure (ny, nx) and its std, NaN where no taxel looked; lengths in pitches.

    pose: (3,) of the last state, in the frame asked for. std: with the poses held.
    """
    last, theta = states[-1], float(np.nan_to_num(pose[2]))
    turn, back = rotation(state_of(last).theta - theta), rotation(-theta)
    shift = back @ (last[:2] - pose[:2])
    looked = coverage(scanned, states) @ turn.T + shift
    low, high = pattern.box
    corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])]) @ turn.T + shift
    low = np.maximum(corners.min(axis=0), looked.min(axis=0) - 1.0)
    high = np.minimum(corners.max(axis=0), looked.max(axis=0) + 1.0)
    step = max(1.0 / _LIMITS.finer, float(np.sqrt(np.prod(high - low) / _LIMITS.most_points)))
    x, y = (np.arange(a, b, step) for a, b in zip(low, high, strict=True))
    places = (np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) - shift) @ turn
    pressure = _values(pattern, places).reshape(len(y), len(x))
    spread = replace(pattern, coefficients=_variance_at_knots(pattern, scanned, states, error))
    variance = _values(spread, places).reshape(pressure.shape)
    unseen = ~near(looked, x, y, _LIMITS.half_diagonal)
    pressure[unseen] = np.nan
    known = np.isfinite(pressure)
    rows, cols = (np.flatnonzero(known.any(axis=axis)) for axis in (1, 0))
    inside = slice(rows[0], rows[-1] + 1), slice(cols[0], cols[-1] + 1)
    std = np.where(known, np.sqrt(np.maximum(variance, 0.0)), np.nan)
    return x[inside[1]], y[inside[0]], pressure[inside], std[inside]


def _values(pattern: Pattern, places: Floats) -> Floats:
    """(n,), the spline at places (n, 2) of its own frame; NaN off the lattice."""
    return pattern.read(np.ascontiguousarray(places.T), np.zeros(STATE), np.zeros((3, 0)))[:, 0]


def _variance_at_knots(pattern: Pattern, scanned: Scanned, states: Floats, error: float) -> Floats:
    """(ny, nx) variance of the pattern at its knots, from draws of what the readings leave open."""
    own = replace(pattern)
    factor = fill(own, scanned.with_error(error), states)
    white = np.random.default_rng(0).standard_normal((own.coefficients.size, _LIMITS.draws))
    at_knots = np.outer(AT_KNOT, AT_KNOT)[np.newaxis]
    values = convolve(factor.drawn(white).T.reshape(_LIMITS.draws, *own.shape), at_knots, mode="nearest")
    variance: Floats = np.mean(values**2, axis=0)
    return variance
