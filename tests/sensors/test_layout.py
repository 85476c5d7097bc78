from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synthetic import grid_sensor
from tabled import arched, hexagonal, square, table_sensor
from taxelflow.sensors.pads import Group, Pad, Patch
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


def test_a_scan_becomes_a_picture_with_row_0_on_top() -> None:
    layout = grid_sensor(2, 3, pads=2, missing=((0, 1),)).layout
    picture = layout.grid(1, np.arange(10.0))
    np.testing.assert_array_equal(picture, [[5, np.nan, 6], [7, 8, 9]])
    assert layout.grid(1, np.arange(10.0), fill=0.0)[0, 1] == 0


def test_a_border_is_where_a_neighbour_lacks() -> None:
    border = grid_sensor(3, 4).layout.border.reshape(3, 4, 2)
    assert border[..., 0].tolist() == [[True, False, False, True]] * 3
    assert border[..., 1].tolist() == [[True] * 4, [False] * 4, [True] * 4]


def test_a_hole_in_the_grid_is_a_border_for_its_neighbours() -> None:
    layout = grid_sensor(3, 3, missing=((1, 1),)).layout
    border = dict(zip(zip(layout.row.tolist(), layout.col.tolist(), strict=True), layout.border.tolist(), strict=True))
    assert border[1, 0] == [True, False]
    assert border[0, 1] == [False, True]


def test_a_layout_is_computed_once() -> None:
    assert grid_sensor(3, 3).layout is grid_sensor(3, 3).layout


# Tables


def test_a_flat_table_keeps_its_own_frame() -> None:
    places = square(2, 3) + np.array([0.3, -0.1])
    layout = table_sensor(places).layout
    np.testing.assert_array_equal(np.stack([layout.x_m, layout.y_m], axis=1), places)
    assert layout.tables.tolist() == [True]
    assert layout.stretch.tolist() == [0]


def test_a_square_grid_is_the_same_as_a_table() -> None:
    grid, table = grid_sensor(4, 6).layout, table_sensor(square(4, 6)).layout
    np.testing.assert_allclose(table.pitch_m, grid.pitch_m)
    for field in ("border", "adjacent", "starts", "source"):
        np.testing.assert_array_equal(getattr(table, field), getattr(grid, field), err_msg=field)
    for field in ("x_m", "y_m", "area_m2", "T_hand", "place_m", "normal"):
        np.testing.assert_allclose(getattr(table, field), getattr(grid, field), atol=1e-15, err_msg=field)


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


def test_scattered_taxels_are_shown_apart_and_where_they_are() -> None:
    layout = table_sensor(np.random.default_rng(3).uniform(-0.02, 0.02, (40, 2))).layout
    picture = layout.grid(0, np.arange(40.0))
    assert sorted(picture[np.isfinite(picture)]) == list(range(40))
    top = int(np.argmax(layout.y_m))
    assert layout.row[top] == 0
    assert layout.col[int(np.argmin(layout.x_m))] == 0


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


def test_pads_of_different_kind_stand_in_one_sensor() -> None:
    grid = Pad(name="palm", rows=2, cols=3, pitch_m=(0.01, 0.012), missing=((0, 0),), area_m2=5e-5)
    table = Pad(name="tip", taxels=((0.0, 0.0), (0.003, 0.0), (0.0, 0.004)), area_m2=(1e-6, 2e-6, 3e-6))
    layout = Sensor(name="hand", unit="Pa", pads=(grid, table)).layout
    assert layout.starts.tolist() == [0, 5, 8]
    assert layout.tables.tolist() == [False, True]
    np.testing.assert_allclose(layout.area_m2, [5e-5] * 5 + [1e-6, 2e-6, 3e-6])
    np.testing.assert_allclose(layout.pitch_m, [[0.01, 0.012], [0.003, 0.003]])


def test_the_area_of_a_taxel_is_the_product_of_the_pitches_unless_given() -> None:
    np.testing.assert_allclose(grid_sensor(2, 2, pitch_m=(0.01, 0.02)).layout.area_m2, 2e-4)
    np.testing.assert_allclose(table_sensor(hexagonal(1, 0.004)).layout.area_m2, 1.6e-5)


def test_a_group_may_list_the_taxels_of_a_table() -> None:
    halves = tuple(
        Group(name=n, patches=(Patch(pad="pad0", taxels=t),)) for n, t in (("left", (0, 3)), ("right", (2, 5)))
    )
    layout = table_sensor(square(2, 3), groups=halves).layout
    assert layout.source[layout.of_pad(1)].tolist() == [0, 3]
    assert layout.tables.tolist() == [True] * 3
    assert layout.border[layout.of_pad(1)].tolist() == [[True, True]] * 2
    assert layout.adjacent[layout.of_pad(1)][:, 1].tolist() == [[1, -1], [-1, 0]]  # below, above


@pytest.mark.parametrize("taxels", [((0.01, 0.02),), ((0.0, 0.0), (0.01, 0.0)), ((0.0, 0.0), (0.01, 0.0), (0.02, 0.0))])
def test_few_taxels_or_taxels_on_a_line_have_neighbours_too(taxels: tuple[tuple[float, float], ...]) -> None:
    pad = Pad(name="a", taxels=taxels, pitch_m=(0.01, 0.01))
    layout = Sensor(name="few", unit="Pa", pads=(pad,)).layout
    assert len(layout.neighbours(0)) == len(taxels) - 1
    assert layout.border[:, 1].all()
