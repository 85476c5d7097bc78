from __future__ import annotations

import numpy as np
import pytest

from taxelflow.estimation.template.bundle_adjustment import refine
from taxelflow.estimation.template.map import Pattern
from taxelflow.estimation.template.observations import Scanned
from taxelflow.numerics.banded import multiply, smoothness
from taxelflow.numerics.bspline import STATE, states_of


def test_coefficients_that_readings_determine_are_counted_by_the_trace() -> None:
    random = np.random.default_rng(0)
    axis = np.arange(8.0)
    places = np.stack([grid.ravel() for grid in np.meshgrid(axis, axis)])
    states = np.zeros((6, STATE))
    states_of(states).gain[:] = 1.0
    states[:, :2] = random.uniform(3.0, 4.0, (6, 2))
    away = places[np.newaxis] - states[:, :2, np.newaxis]
    readings = np.exp(-(away**2).sum(axis=1) / 4.0) + 0.01 * random.standard_normal((6, 64))
    scanned = Scanned.of(
        np.arange(6.0), places, readings, np.full(readings.shape, 1e-4), np.full(64, np.inf), np.zeros(64)
    )
    pattern = Pattern.covering(np.array([[-3.5, -3.5], [3.5, 3.5]]), 1.0)
    precision = np.array([0.0, 0.0, np.inf, 1.0, np.inf])
    fit = refine(pattern, scanned, states, rounds=8, error=0.02, precision=precision)

    knots = pattern.coefficients.size
    bending, stencil = np.empty((knots, knots)), smoothness(pattern.shape)
    for row, unit in zip(bending, np.eye(knots), strict=True):
        multiply(stencil, pattern.shape[1], unit, row)
    held = fit.factor.solve(pattern.smoothing * bending + pattern.prior * np.eye(knots))
    assert fit.free == pytest.approx(knots - np.trace(held) + 3 * len(states), rel=0.1)
