"""Observability of a pose: its Fisher information over that which noise in the pattern alone would give."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.numerics.bspline import state_of

if TYPE_CHECKING:
    from taxelflow.estimation.template.map import Pattern
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.messages import Floats
    from taxelflow.numerics.banded import Factor

_DRAWS = 8
"""Patterns drawn from the posterior, whose mean information stands for that of noise."""


class Observability(NamedTuple):
    """Observability of each part of a pose: information by the pattern over information by its noise."""

    x: float
    y: float
    theta: float


def observability(
    pattern: Pattern,
    scanned: Scanned,
    states: Floats,
    factor: Factor,
    scan: int,
    error: float,
    *,
    pressed: bool = False,
) -> Observability:
    """Observability of x, y and theta in a given scan.

    Errors of a pattern have slopes, too, which look like information. How much is measured on patterns of pure noise,
    drawn from the posterior covariance, whose inverse `factor` factors. 0 across a line of taxels, and for its angle:
    see `scanned.across`. pressed: whether only taxels on which the pattern presses count.
    """
    here = scanned.places, states[scan], scanned.bends[scan]
    base = pattern.read(*here)
    known = np.isfinite(base[:, 0]) & (scanned.variance[scan] > 0)
    if pressed:
        known &= base[:, 0] > 0.0
    gain = state_of(states[scan]).gain
    w = 1.0 / (scanned.variance[scan, known] + (error * scanned.amplitude) ** 2)
    slopes, load = gain * base[known, 1:4], base[known, :1]

    def information(by: Floats, of: int) -> float:
        """Information of slopes (taxels,) on one number while gain and the other two are unknown."""
        others = np.concatenate([np.delete(slopes, of, axis=1), load], axis=1)
        normal = (others * w[:, np.newaxis]).T @ others + 1e-12 * np.eye(3)
        mixed = (others * w[:, np.newaxis]).T @ by
        return float((w * by * by).sum() - mixed @ np.linalg.solve(normal, mixed))

    random = np.random.default_rng(0)
    pretended = np.zeros(3)
    for _ in range(_DRAWS):
        white = random.standard_normal((pattern.coefficients.size, 1))
        drawn = factor.drawn(white).reshape(pattern.shape)
        values = gain * replace(pattern, coefficients=drawn).read(*here)[known, 1:4]
        pretended += [information(values[:, of], of) / _DRAWS for of in range(3)]
    real = np.array([information(slopes[:, of], of) for of in range(3)])
    unobservable = scanned.across
    return Observability(*np.where([*unobservable, unobservable.any()], 0.0, real / np.maximum(pretended, 1e-300)))
