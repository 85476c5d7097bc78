from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from synthetic import grid_sensor, scans_of
from taxelflow.contacts.texture import TextureMeter
from taxelflow.messages import Floats, Texture

GRID = grid_sensor(12, 12, pitch_m=(0.002, 0.002), full_scale=140e3)


def measured(pressure: Floats) -> Texture:
    return TextureMeter(GRID.layout).step(scans_of(GRID, np.atleast_2d(pressure), noise=10.0))


@given(st.integers(0, 143), st.floats(1e2, 1e5))
def test_a_single_taxel_shows_no_turn(taxel: int, peak: float) -> None:
    values = np.zeros(144)
    values[taxel] = peak
    assert not measured(values).turns[0, 0]


def test_a_bar_shows_its_turn_and_no_motion_along_itself() -> None:
    layout = GRID.layout
    texture = measured(np.where(np.abs(layout.y_m) < 0.003, 1e4, 0.0))
    assert texture.turns[0, 0]
    unobservable = texture.unobservable[0, 0]
    assert unobservable[0, 0] > 0.9
    assert unobservable[1, 1] < 0.1


def test_a_pattern_with_texture_shows_everything() -> None:
    values = 1e4 + 5e3 * np.random.default_rng(1).standard_normal(144)
    texture = measured(np.maximum(values, 0.0))
    assert texture.turns[0, 0]
    assert not texture.smooth[0, 0]
    assert not texture.unobservable[0, 0].any()


def test_a_round_dome_is_smooth_and_shows_no_turn() -> None:
    layout = GRID.layout
    texture = measured(1e4 * np.maximum(1 - (layout.x_m**2 + layout.y_m**2) / 0.009**2, 0.0))
    assert texture.smooth[0, 0]
    assert not texture.turns[0, 0]
