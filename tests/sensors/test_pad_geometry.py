from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synthetic import grid_sensor
from tabled import arched, hexagonal, square, table_sensor
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor


def test_x_points_right_along_columns_and_y_up_against_rows() -> None:
    layout = grid_sensor(3, 4, pitch_m=(0.01, 0.02)).layout
    np.testing.assert_allclose(layout.x_m[:4], [-0.015, -0.005, 0.005, 0.015])
    np.testing.assert_allclose(layout.y_m[[0, 4, 8]], [0.02, 0, -0.02])


@given(rows=st.integers(1, 12), cols=st.integers(1, 12))
def test_the_origin_is_the_pads_centre(rows: int, cols: int) -> None:
    layout = grid_sensor(rows, cols).layout
    assert layout.x_m.mean() == pytest.approx(0, abs=1e-15)
    assert layout.y_m.mean() == pytest.approx(0, abs=1e-15)


def test_a_missing_taxel_moves_no_other() -> None:
    whole, holed = grid_sensor(2, 3).layout, grid_sensor(2, 3, missing=((0, 1), (1, 2))).layout
    np.testing.assert_array_equal(holed.x_m, np.delete(whole.x_m, [1, 5]))
    np.testing.assert_array_equal(holed.y_m, np.delete(whole.y_m, [1, 5]))
    assert holed.taxels == 4


def test_a_flat_table_keeps_its_own_frame() -> None:
    places = square(2, 3) + np.array([0.3, -0.1])
    layout = table_sensor(places).layout
    np.testing.assert_array_equal(np.stack([layout.x_m, layout.y_m], axis=1), places)
    assert layout.tables.tolist() == [True]
    assert layout.stretch.tolist() == [0]


def test_a_curved_pad_is_unrolled_and_keeps_its_place_in_space() -> None:
    flat, table = arched(5, 9, radius_m=0.015)
    layout = table_sensor(table).layout
    np.testing.assert_allclose(np.stack([layout.x_m, layout.y_m], axis=1), flat, atol=1e-9)
    np.testing.assert_allclose(layout.place_m, table[:, :3])
    np.testing.assert_allclose(layout.normal, table[:, 3:], atol=1e-12)
    assert layout.stretch[0] < 1e-9


def test_a_pose_puts_a_pad_in_space() -> None:
    turned = Pad(
        name="a", rows=1, cols=2, pitch_m=(0.01, 0.01), pose=(0.1, 0.2, 0.3, 0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5))
    )
    elsewhere = Pad(name="b", rows=1, cols=1, pitch_m=(0.01, 0.01))
    layout = Sensor(name="hand", unit="Pa", pads=(turned, elsewhere)).layout
    np.testing.assert_allclose(layout.normal[:2], [[1, 0, 0], [1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(layout.place_m[:2], [[0.1, 0.2, 0.305], [0.1, 0.2, 0.295]], atol=1e-12)
    assert np.isnan(layout.place_m[2]).all()
    assert np.isnan(layout.normal[2]).all()


def test_the_area_of_a_taxel_is_the_product_of_the_pitches_unless_given() -> None:
    np.testing.assert_allclose(grid_sensor(2, 2, pitch_m=(0.01, 0.02)).layout.area_m2, 2e-4)
    np.testing.assert_allclose(table_sensor(hexagonal(1, 0.004)).layout.area_m2, 1.6e-5)
