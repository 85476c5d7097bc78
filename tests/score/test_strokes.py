from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taxelflow.score.strokes import slope


@given(speed=st.floats(-50, 50), start=st.floats(-100, 100), seed=st.integers(0, 100))
def test_a_straight_way_has_its_speed_whatever_the_weights_and_pieces(speed: float, start: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    t_s = np.sort(random.uniform(0, 5, 20))
    piece = np.sort(random.integers(0, 4, 20))
    x = start + speed * t_s + 7.0 * piece
    used, weight = np.ones(20, dtype=np.bool_), random.uniform(0.1, 2, 20)
    assert slope(t_s, x, used, weight, piece) == pytest.approx(speed, abs=1e-6)


def test_it_is_the_regression_line_of_the_used_positions() -> None:
    random = np.random.default_rng(0)
    t_s, x, used = np.arange(30.0), random.normal(size=30), random.uniform(size=30) > 0.3
    x[~used] = np.nan
    assert slope(t_s, x, used) == pytest.approx(np.polyfit(t_s[used], x[used], 1)[0])
    weight = random.uniform(0.5, 3, 30)
    fitted = np.polyfit(t_s[used], x[used], 1, w=np.sqrt(weight[used]))[0]
    assert slope(t_s, x, used, weight) == pytest.approx(fitted)


def test_fewer_than_three_positions_or_pieces_of_one_have_no_slope() -> None:
    t_s, x, none = np.arange(5.0), np.arange(5.0), np.zeros(5, dtype=np.bool_)
    assert np.isnan(slope(t_s, x, none))
    assert np.isnan(slope(t_s, x, np.array([1, 1, 0, 0, 0], dtype=np.bool_)))
    assert np.isnan(slope(t_s, x, ~none, piece=np.arange(5)))
