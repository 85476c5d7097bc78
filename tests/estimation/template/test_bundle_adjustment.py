from __future__ import annotations

import numpy as np
import pytest

from taxelflow.estimation.template import bundle_adjustment
from taxelflow.estimation.template.bundle_adjustment import refine
from taxelflow.estimation.template.map import Pattern, fill
from taxelflow.estimation.template.observations import Scanned
from taxelflow.messages import Floats
from taxelflow.numerics.banded import Factor, multiply, smoothness
from taxelflow.numerics.bspline import STATE, states_of

PRECISION = np.array([0.0, 0.0, np.inf, 1.0, np.inf])


def bump() -> tuple[Pattern, Scanned, Floats]:
    """A map of zeros, six scans of a bump that it covers, and their states."""
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
    return Pattern.covering(np.array([[-3.5, -3.5], [3.5, 3.5]]), 1.0), scanned, states


def test_coefficients_that_readings_determine_are_counted_by_the_trace() -> None:
    pattern, scanned, states = bump()
    fit = refine(pattern, scanned, states, rounds=8, error=0.02, precision=PRECISION)

    knots = pattern.coefficients.size
    bending, stencil = np.empty((knots, knots)), smoothness(pattern.shape)
    for row, unit in zip(bending, np.eye(knots), strict=True):
        multiply(stencil, pattern.shape[1], unit, row)
    held = fit.factor.solve(pattern.smoothing * bending + pattern.prior * np.eye(knots))
    assert fit.free == pytest.approx(knots - np.trace(held) + 3 * len(states), rel=0.1)


@pytest.mark.parametrize("rounds", [0, 1, 2])
def test_the_last_round_judges_the_fit_and_factors_nothing(rounds: int, monkeypatch: pytest.MonkeyPatch) -> None:
    pattern, scanned, states = bump()
    states[::2, :2] += 0.5
    fill(pattern, scanned.with_error(0.02), states)
    made: list[Factor] = []

    def factored(stencil: Floats, nx: int) -> Factor:
        made.append(Factor(stencil, nx))
        return made[-1]

    monkeypatch.setattr(bundle_adjustment, "Factor", factored)
    fit = refine(pattern, scanned, states, rounds=rounds, error=0.02, precision=PRECISION)
    assert len(made) == max(rounds, 1)
    again = refine(pattern, scanned, states.copy(), rounds=0, error=0.02, precision=PRECISION)
    for name in ("chi", "counts", "residual", "weight", "model", "information"):
        np.testing.assert_allclose(getattr(fit, name), getattr(again, name), rtol=1e-12, err_msg=name)
