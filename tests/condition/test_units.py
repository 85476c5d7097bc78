from __future__ import annotations

import numpy as np
import pytest

from synthetic import grid_sensor
from taxelflow.condition.units import full_scale, in_si


@pytest.mark.parametrize(("unit", "factor"), [("Pa", 1.0), ("kPa", 1e3), ("N/cm2", 1e4), ("count", 1.0)])
def test_readings_become_pascal_and_counts_stay(unit: str, factor: float) -> None:
    values = np.array([[0.0, -1.5, 2.0]])
    np.testing.assert_allclose(in_si(values, grid_sensor(1, 3, unit=unit)), factor * values)


def test_what_is_not_finite_is_missing_and_the_input_stays() -> None:
    values = np.array([[np.nan, np.inf, -np.inf, 1e308]])
    si = in_si(values, grid_sensor(1, 4, unit="kPa"))  # the last one overflows
    assert np.isnan(si).all()
    assert values[0, 1] == np.inf


def test_full_scale_is_in_the_same_unit_and_infinite_if_unknown() -> None:
    np.testing.assert_allclose(full_scale(grid_sensor(1, 2, unit="kPa", full_scale=140.0)), [140e3, 140e3])
    assert np.isinf(full_scale(grid_sensor(1, 2))).all()
