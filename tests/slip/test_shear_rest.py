from __future__ import annotations

import numpy as np
import pytest

from taxelflow.slip.evidence import CHANGE
from taxelflow.slip.pattern_change import PatternChanges
from taxelflow.slip.shear_rest import ShearRest


def bin_of(spread: float, rise: float = 0.0, noise: float = 0.0) -> PatternChanges:
    parts = (np.array([[number]]) for number in (0.0, 0.0, rise, 0.0, np.nan, spread**2, noise**2))
    return PatternChanges(np.zeros(1), np.zeros(1), np.ones((1, 1), dtype=np.bool_), *parts, np.empty((1, 1, 0, 3)))


def learned(spread: float, ratio: float, rise: float = 0.0, noise: float = 0.0) -> tuple[float, float]:
    rest = ShearRest(1)
    for _ in range(200):
        rest.update(bin_of(spread, rise, noise), 0, np.array([ratio]))
    return float(rest.spread[0]), float(rest.growth[0])


def test_the_spread_at_rest_is_learned_where_the_pattern_rests() -> None:
    assert learned(0.05, -1.0)[0] == pytest.approx(0.05)
    assert learned(0.05, 1.0) == learned(np.nan, -1.0) == (0.01, CHANGE.growth)


def test_noise_is_no_spread_of_the_skin() -> None:
    assert learned(0.05, -1.0, noise=0.04)[0] == pytest.approx(0.03)


def test_a_changing_load_shows_the_growth() -> None:
    usual, growth = learned(np.hypot(0.01, 0.4 * 0.3), -1.0, rise=-0.3)
    assert usual == 0.01
    assert growth == pytest.approx(0.4)


def test_it_follows_the_skin() -> None:
    rest = ShearRest(1)
    for spread in (0.05, 0.02):
        for _ in range(150):
            rest.update(bin_of(spread), 0, np.array([-1.0]))
    assert rest.spread[0] == pytest.approx(0.02)
