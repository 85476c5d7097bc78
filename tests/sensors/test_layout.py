from __future__ import annotations

import numpy as np

from synthetic import grid_sensor
from tabled import square, table_sensor
from taxelflow.sensors.pads import Group, Pad, Patch
from taxelflow.sensors.sensor import Sensor, with_contacts


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


def test_a_full_grid_is_that_of_a_single_pad_without_gaps() -> None:
    assert grid_sensor(2, 3).layout.full_grid == (2, 3)
    assert with_contacts(grid_sensor(2, 3), 2).layout.full_grid == (2, 3)
    others = (grid_sensor(2, 3, pads=2), grid_sensor(2, 3, missing=((1, 1),)), table_sensor(square(2, 3)))
    assert [sensor.layout.full_grid for sensor in others] == [None] * 3


# Tables


def test_a_square_grid_is_the_same_as_a_table() -> None:
    grid, table = grid_sensor(4, 6).layout, table_sensor(square(4, 6)).layout
    np.testing.assert_allclose(table.pitch_m, grid.pitch_m)
    for field in ("border", "adjacent", "starts", "source"):
        np.testing.assert_array_equal(getattr(table, field), getattr(grid, field), err_msg=field)
    for field in ("x_m", "y_m", "area_m2", "T_hand", "place_m", "normal"):
        np.testing.assert_allclose(getattr(table, field), getattr(grid, field), atol=1e-15, err_msg=field)


def test_pads_of_different_kind_stand_in_one_sensor() -> None:
    grid = Pad(name="palm", rows=2, cols=3, pitch_m=(0.01, 0.012), missing=((0, 0),), area_m2=5e-5)
    table = Pad(name="tip", taxels=((0.0, 0.0), (0.003, 0.0), (0.0, 0.004)), area_m2=(1e-6, 2e-6, 3e-6))
    layout = Sensor(name="hand", unit="Pa", pads=(grid, table)).layout
    assert layout.starts.tolist() == [0, 5, 8]
    assert layout.tables.tolist() == [False, True]
    np.testing.assert_allclose(layout.area_m2, [5e-5] * 5 + [1e-6, 2e-6, 3e-6])
    np.testing.assert_allclose(layout.pitch_m, [[0.01, 0.012], [0.003, 0.003]])


def test_a_group_may_list_the_taxels_of_a_table() -> None:
    halves = tuple(
        Group(name=n, patches=(Patch(pad="pad0", taxels=t),)) for n, t in (("left", (0, 3)), ("right", (2, 5)))
    )
    layout = table_sensor(square(2, 3), groups=halves).layout
    assert layout.source[layout.of_pad(1)].tolist() == [0, 3]
    assert layout.tables.tolist() == [True] * 3
    assert layout.border[layout.of_pad(1)].tolist() == [[True, True]] * 2
    assert layout.adjacent[layout.of_pad(1)][:, 1].tolist() == [[1, -1], [-1, 0]]  # below, above


def test_entries_of_contacts_are_those_of_their_pad() -> None:
    layout = with_contacts(grid_sensor(3, 4, pads=2), {"pad1": 2}).layout
    assert layout.contact_of.tolist() == [-1, -1, 1, 1]
    assert (layout.taxels, layout.entries, layout.pad_count) == (24, 48, 2)
    pad, first = layout.of_pad(1), layout.of_pad(2)
    for name in ("source", "row", "col", "x_m", "y_m", "border", "adjacent", "delay_s", "area_m2"):
        np.testing.assert_array_equal(getattr(layout, name)[pad], getattr(layout, name)[first], err_msg=name)
    assert layout.independent.tolist() == [True, True, False, False]  # the rigid object goes by pads
