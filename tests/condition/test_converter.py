from __future__ import annotations

import numpy as np
import pytest

from taxelflow.condition.converter import noise_floor


def test_the_floor_is_the_step_of_a_converter_over_root_twelve() -> None:
    readings = np.random.default_rng(0).integers(0, 4096, (10, 12, 30)) * 0.8
    assert noise_floor(readings) == pytest.approx(max(0.8 / 12**0.5, 1e-4 * readings.max()), rel=0.01)


def test_the_floor_of_few_distinct_values_takes_none_of_them_for_a_step() -> None:
    assert noise_floor(np.array([0.0, 1000.0, 3000.0])) < 10
