from __future__ import annotations

import numpy as np
import pytest

from taxelflow.numerics.robust import gate, huber_weight, quantile
from taxelflow.runtime.compiling import kernel


@kernel
def weight(z: float, threshold: float) -> float:
    return huber_weight(z, threshold)


@pytest.mark.parametrize(("z", "expected"), [(0.0, 1.0), (4.9, 1.0), (5.0, 1.0), (10.0, 0.5), (50.0, 0.1)])
def test_the_huber_weight_bounds_the_pull_of_a_residual(z: float, expected: float) -> None:
    assert weight(z, 5.0) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("expected", "count", "bound"), [(1.0, 4, 4.0), (1.0, 100, 2.4), (1.5, 100, 3.6), (1.0, 0, 6.0)]
)
def test_the_gate_leaves_a_margin_that_shrinks_with_the_number_of_readings(
    expected: float, count: float, bound: float
) -> None:
    assert gate(expected, float(count)) == pytest.approx(bound)


def test_a_quantile_is_that_of_numpy_bit_for_bit() -> None:
    random = np.random.default_rng(0)
    for count in [1, 2, 3, 10, 11, 60] * 20:
        values = random.normal(size=count) * 10.0 ** random.integers(-5, 9)
        share = float(random.choice([0.0, 0.1, 0.5, 0.9, 1.0]))
        assert quantile(values, share) == np.quantile(values, share)
    assert np.isnan(quantile(np.array([1.0, np.nan, 2.0]), 0.5))
