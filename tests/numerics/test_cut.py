"""What the border hides of a motion, against how far the centre of pressure moves; sides that have no neighbour."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taxelflow.messages import Floats
from taxelflow.numerics.centroid import pressure_centre
from taxelflow.numerics.cut import find_hidden, open_sides
from taxelflow.sensors.catalogue import load_sensor

X, Y = (axis.ravel() for axis in np.meshgrid(np.arange(12.0), np.arange(12.0)))
GRID = np.stack([X - 5.5, Y - 5.5])


def hidden(reading: Floats, places: Floats) -> tuple[Floats, Floats]:
    """H (2, 2), and the centre of pressure (2,)."""
    variance, middle, found = np.full(len(reading), 1e-12), np.empty(5), np.empty(4)
    pressure_centre(reading, variance, places, np.zeros(len(reading), np.bool_), middle)
    find_hidden(reading, variance, places, open_sides(places), middle, found)
    return found.reshape(2, 2), middle[:2]


def hill(x: float, y: float, width: float, length: float, angle: float) -> Floats:
    """Readings of a smooth ridge of this width and length, in pitches."""
    cos, sin = np.cos(angle), np.sin(angle)
    along, across = cos * (GRID[0] - x) + sin * (GRID[1] - y), cos * (GRID[1] - y) - sin * (GRID[0] - x)
    pressed: Floats = np.exp(-0.5 * ((along / length) ** 2 + (across / width) ** 2))
    return pressed


angles, places_of_hills = st.floats(0, np.pi), st.floats(-2, 2)


@given(places_of_hills, places_of_hills, st.floats(1.5, 3), st.floats(3, 8), angles, angles)
def test_the_centre_of_pressure_moves_by_what_is_not_hidden(
    x: float, y: float, width: float, length: float, angle: float, way: float
) -> None:
    step = 0.05 * np.array([np.cos(way), np.sin(way)])
    before, after = (hill(x + sign * step[0], y + sign * step[1], width, length, angle) for sign in (-0.5, 0.5))
    found, _ = hidden(0.5 * (before + after), GRID)
    moved = hidden(after, GRID)[1] - hidden(before, GRID)[1]
    np.testing.assert_allclose(moved / 0.05, (np.eye(2) - found) @ step / 0.05, atol=0.15)


def test_nothing_is_hidden_of_an_object_that_lies_on_the_pad() -> None:
    np.testing.assert_allclose(hidden(hill(0, 0, 1, 1, 0), GRID)[0], 0.0, atol=1e-5)


@given(angles)
def test_a_motion_along_a_rod_that_reaches_across_the_pad_is_hidden(angle: float) -> None:
    found, _ = hidden(hill(0, 0, 1, 1e3, angle), GRID)
    along = np.array([np.cos(angle), np.sin(angle)])
    assert np.hypot(*(along - found @ along)) < 0.3


@pytest.mark.parametrize("name", ["schunk-sdh2", "barretthand-162", "hexagon-61", "triangle-64"])
def test_all_motion_of_a_plate_that_covers_the_pad_is_hidden(name: str) -> None:
    layout = load_sensor(name).layout
    own = layout.of_pad(0)
    places = np.stack([layout.x_m[own], layout.y_m[own]]) / np.sqrt(layout.pitch_m[0].prod())
    found, _ = hidden(np.ones(places.shape[1]), places)
    np.testing.assert_allclose(found, np.eye(2), atol=0.36)  # hexagons jut out


def test_without_a_load_nothing_is_hidden() -> None:
    assert not hidden(np.zeros(144), GRID)[0].any()


def test_the_sides_of_a_grid_that_are_open_are_its_border() -> None:
    left, right, below, above = open_sides(GRID) > 0
    np.testing.assert_array_equal(left, GRID[0] == -5.5)
    np.testing.assert_array_equal(right, GRID[0] == 5.5)
    np.testing.assert_array_equal(below, GRID[1] == -5.5)
    np.testing.assert_array_equal(above, GRID[1] == 5.5)


def test_a_single_taxel_that_is_missing_is_no_border() -> None:
    places = GRID[:, ~((GRID[0] == 0.5) & (GRID[1] == 0.5))]
    assert open_sides(places).sum(axis=1).tolist() == [12, 12, 12, 12]


def test_a_cut_out_that_pressure_does_not_cross_is_a_border() -> None:
    places = GRID[:, ~((np.abs(GRID[0]) < 2) & (np.abs(GRID[1]) < 2))]
    assert open_sides(places).sum(axis=1).tolist() == [14, 14, 14, 14]  # of the four sides the two in the middle
