from __future__ import annotations

import numpy as np
import pytest

from tabled import hexagonal, table_sensor
from taxelflow.numerics.cut import open_sides
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor


def test_a_hexagonal_pad_has_six_neighbours_within_and_a_border_around() -> None:
    layout = table_sensor(hexagonal(3)).layout
    pairs = layout.neighbours(0)
    count = np.bincount(pairs.ravel(), minlength=layout.taxels)
    ring = np.round(
        np.maximum(np.abs(layout.y_m) * 2 / np.sqrt(3), np.abs(layout.x_m) + np.abs(layout.y_m) / np.sqrt(3)) / 0.005
    )
    assert set(count[ring < 3]) == {6}
    assert set(count[ring == 3]) == {3, 4}
    assert not layout.border[ring < 3].any()
    assert layout.border[ring == 3].any(axis=1).all()
    np.testing.assert_allclose(layout.pitch_m, 0.005)


def test_of_triangular_taxels_those_along_the_sides_of_the_pad_are_its_border() -> None:
    layout = load_sensor("triangle-64").layout
    side_m, x, y = 0.040, layout.x_m, layout.y_m - layout.y_m.min()
    inward_m = side_m / np.sqrt(3) / 8 / 2  # from a side to the centre of a taxel that has it as its own side
    height = y + inward_m  # above the lower side
    slanted = (np.sqrt(3) * (side_m / 2 - np.abs(x)) - height) / 2
    nearest = np.minimum(height, slanted)
    assert layout.border[nearest < 1.01 * inward_m].any(axis=1).all()
    assert not layout.border[nearest > 2.01 * inward_m].any()
    places = np.stack([layout.x_m, layout.y_m]) / layout.pitch_m[0, 0]
    np.testing.assert_array_equal((open_sides(places) > 0).any(axis=0)[nearest > 2.01 * inward_m], False)


def test_scattered_taxels_are_shown_apart_and_where_they_are() -> None:
    layout = table_sensor(np.random.default_rng(3).uniform(-0.02, 0.02, (40, 2))).layout
    picture = layout.grid(0, np.arange(40.0))
    assert sorted(picture[np.isfinite(picture)]) == list(range(40))
    top = int(np.argmax(layout.y_m))
    assert layout.row[top] == 0
    assert layout.col[int(np.argmin(layout.x_m))] == 0


@pytest.mark.parametrize("taxels", [((0.01, 0.02),), ((0.0, 0.0), (0.01, 0.0)), ((0.0, 0.0), (0.01, 0.0), (0.02, 0.0))])
def test_few_taxels_or_taxels_on_a_line_have_neighbours_too(taxels: tuple[tuple[float, float], ...]) -> None:
    pad = Pad(name="a", taxels=taxels, pitch_m=(0.01, 0.01))
    layout = Sensor(name="few", unit="Pa", pads=(pad,)).layout
    assert len(layout.neighbours(0)) == len(taxels) - 1
    assert layout.border[:, 1].all()
