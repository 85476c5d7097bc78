"""Observability of a rotation: its Fisher information over that which noise in the pattern alone would give."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.bspline import state_of
from taxelflow.numerics.rounding import NEGLIGIBLE

if TYPE_CHECKING:
    from taxelflow.estimation.template.map import Pattern
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.messages import Floats
    from taxelflow.numerics.banded import Factor

_DRAWS = 8
"""Patterns drawn from the posterior, whose mean information stands for that of noise."""


def observability(
    pattern: Pattern,
    scanned: Scanned,
    states: Floats,
    factor: Factor,
    scan: int,
    error: float,
    *,
    pressed: bool = False,
) -> float:
    """Observability of theta in a given scan; 0 for a line of taxels, see `scanned.across`.

    Errors of a pattern have slopes, too, which look like information. How much is measured on patterns of pure noise,
    drawn from the posterior covariance, whose inverse `factor` factors. pressed: whether only taxels on which the
    pattern presses count.
    """
    if scanned.across.any():
        return 0.0
    here = scanned.places, states[scan], scanned.bends[scan]
    base = pattern.read(*here)
    known = np.isfinite(base[:, 0]) & (scanned.variance[scan] > 0)
    if pressed:
        known &= base[:, 0] > 0.0
    gain = state_of(states[scan]).gain
    w = 1.0 / (scanned.variance[scan, known] + (error * scanned.amplitude) ** 2)
    slopes = gain * base[known, 1:4]
    others = np.concatenate([slopes[:, :2], base[known, :1]], axis=1)  # by x, y and the gain
    weighted = (others * w[:, np.newaxis]).T
    normal = weighted @ others + NEGLIGIBLE * np.eye(3)

    def information(by: Floats) -> float:
        """Information of slopes by theta (taxels,), with x, y and the gain unknown."""
        mixed = weighted @ by
        return float((w * by * by).sum() - mixed @ np.linalg.solve(normal, mixed))

    random = np.random.default_rng(0)
    pretended = 0.0
    for _ in range(_DRAWS):
        white = random.standard_normal((pattern.coefficients.size, 1))
        drawn = replace(pattern, coefficients=factor.drawn(white).reshape(pattern.shape))
        pretended += information((gain * drawn.read(*here)[known, 1:4])[:, 2]) / _DRAWS
    return information(slopes[:, 2]) / max(pretended, 1e-300)
