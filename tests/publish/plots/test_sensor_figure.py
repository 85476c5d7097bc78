from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from costly import mostly_long
from synthetic import grid_sensor
from tabled import arched, hexagonal, square, table_sensor
from taxelflow.publish.plots.style import styled
from taxelflow.sensors.catalogue import catalogue, load_sensor
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taxelflow.messages import Floats

pytest.importorskip("matplotlib")

import matplotlib.pyplot as plt
from matplotlib.collections import PolyCollection

from taxelflow.publish.plots.outlines import outlines
from taxelflow.publish.plots.packing import packed
from taxelflow.publish.plots.sensor import sensor_figure

pytestmark = pytest.mark.usefixtures("style")


def taxels(figure: Figure) -> int:
    found = [item for axis in figure.axes[:1] for item in axis.collections if type(item) is PolyCollection]
    return sum(len(item.get_paths()) for item in found)


def numbers(axis: Axes) -> dict[int, tuple[float, float]]:
    return {int(text.get_text()): text.get_position() for text in axis.texts if text.get_text().isdigit()}


@pytest.mark.parametrize("name", mostly_long((name for name, _ in catalogue()), "barretthand-162", "triangle-64"))
def test_each_built_in_sensor_is_drawn_with_all_its_taxels(name: str) -> None:
    sensor = load_sensor(name.replace("PITCH", "3"))
    figure = sensor_figure(sensor)
    assert taxels(figure) == sensor.layout.taxels
    assert len(numbers(figure.axes[0])) == sensor.layout.taxels


def test_a_single_taxel_is_numbered() -> None:
    with styled():
        figure = sensor_figure(grid_sensor(1, 1))
        assert "0" in [text.get_text() for text in figure.axes[0].texts]
        plt.close(figure)


def test_taxels_are_numbered_where_they_lie_on_the_hand() -> None:
    figure = sensor_figure(load_sensor("barretthand-162"))
    at = numbers(figure.axes[0])
    np.testing.assert_allclose(at[146], (0, 5), atol=1e-9)
    assert at[46][0] > 100  # finger 2 lies to the right


def test_curved_skin_is_shown_in_space_too() -> None:
    assert [axis.name for axis in sensor_figure(table_sensor(arched(3, 5, 0.01)[1])).axes] == ["rectilinear", "3d"]
    assert [axis.name for axis in sensor_figure(table_sensor(hexagonal(2))).axes] == ["rectilinear"]


def test_each_axis_in_space_has_two_ticks_or_more() -> None:
    space: Any = sensor_figure(load_sensor("icub-fingertip-12")).axes[1]
    for one in (space.xaxis, space.yaxis, space.zaxis):
        low, high = one.get_view_interval()
        assert sum(low <= tick <= high for tick in one.get_majorticklocs()) >= 2


def words(axis: Axes) -> list[str]:
    return [text.get_text() for text in axis.texts if text.get_text() and not text.get_text().isdigit()]


def test_pads_without_a_place_in_the_hand_stand_in_rows_at_one_scale() -> None:
    figure = sensor_figure(grid_sensor(2, 3, pads=7))
    (axis,) = figure.axes
    assert {f"pad{number}" for number in range(7)} < set(words(axis))
    assert any(word.endswith(" mm") for word in words(axis))
    at = np.array([numbers(axis)[taxel] for taxel in range(42)]).reshape(7, 6, 2)
    apart = np.linalg.norm(at[:, np.newaxis, :, np.newaxis] - at[:, np.newaxis], axis=-1).min(axis=(2, 3))
    assert (apart + np.diag(np.full(7, np.inf)) > 0).all()
    np.testing.assert_allclose(np.ptp(at, axis=1), np.tile(np.ptp(at[0], axis=0), (7, 1)))


def test_the_bar_of_length_and_its_number_cover_no_taxel() -> None:
    (axis,) = sensor_figure(grid_sensor(40, 12, pads=6)).axes
    (number,) = (text for text in axis.texts if text.get_text().endswith(" mm"))
    taxels = [path.get_extents(axis.transData) for item in axis.collections for path in item.get_paths()]
    assert number.get_window_extent().y1 < min(taxel.y0 for taxel in taxels)


def test_pads_of_one_finger_stand_in_one_row() -> None:
    sensor = load_sensor("inspire-rh56dftp@3mm")
    T = packed(sensor.layout)
    tops = {pad.name: place[1] + 0.5e-3 * 3 * pad.rows for pad, place in zip(sensor.pads, T, strict=True)}
    assert tops["index_tip"] == pytest.approx(tops["index_palm"], abs=1e-6)


@pytest.mark.parametrize("name", ["barretthand-162", "schunk-sdh2", "icub-fingertips-60"])
def test_names_of_pads_cover_no_taxel(name: str) -> None:
    sensor = load_sensor(name)
    (axis,) = sensor_figure(sensor).axes
    taxels = [path.get_extents(axis.transData) for item in axis.collections for path in item.get_paths()]
    for text in (text for text in axis.texts if text.get_text() in sensor.layout.pads):
        assert not any(text.get_window_extent().overlaps(taxel) for taxel in taxels)


def test_names_that_would_cover_taxels_have_a_drawing_of_their_own() -> None:
    sensor = load_sensor("icub-forearm")
    figure = sensor_figure(sensor)
    flat, pads, space = figure.axes
    assert words(flat) == []
    assert [text.get_text() for text in pads.texts] == [name.removeprefix("triangle") for name in sensor.layout.pads]
    assert space.name == "3d"


@pytest.mark.parametrize("sensor", [table_sensor(hexagonal(2)), grid_sensor(3, 4), load_sensor("icub-fingertip-12")])
def test_outlines_hold_their_taxel_and_do_not_meet(sensor: Sensor) -> None:
    layout = sensor.layout
    shapes = outlines(layout, 0)
    middle = np.stack([layout.x_m, layout.y_m], axis=1)
    np.testing.assert_allclose(shapes.mean(axis=1), middle, atol=1e-12)
    reach = np.abs(shapes - middle[:, np.newaxis]).max(axis=(1, 2))
    apart = np.abs(middle[:, np.newaxis] - middle).max(axis=2) + np.diag(np.full(len(middle), np.inf))
    if layout.tables[0]:
        apart = np.linalg.norm(middle[:, np.newaxis] - middle, axis=2) + np.diag(np.full(len(middle), np.inf))
    assert (reach[:, np.newaxis] + reach < apart + 1e-12).all()


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_cells_of_a_hexagonal_grid_are_hexagons_side_by_side(turn: float) -> None:
    cos, sin = np.cos(turn), np.sin(turn)
    places = hexagonal(2) @ np.array([[cos, sin], [-sin, cos]])
    cells = np.column_stack([places, np.full(len(places), np.sqrt(0.75) * 0.005**2)])
    shapes = outlines(_of_areas(cells).layout, 0)
    assert shapes.shape == (19, 6, 2)
    sides = (shapes + np.roll(shapes, -1, axis=1))[9] / 2 - places[9]
    towards = places[np.argsort(np.linalg.norm(places - places[9], axis=1))[1:7]] - places[9]
    np.testing.assert_allclose(sorted(np.angle(sides @ [1, 1j])), sorted(np.angle(towards @ [1, 1j])), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(sides, axis=1), 0.45 * 0.005)


@pytest.mark.parametrize(
    ("places", "area_m2"),
    [(hexagonal(2), 1.5e-5), (square(4, 4, 0.005), 2.165e-5), (hexagonal(2)[:2], 2.165e-5)],
    ids=["smaller than cells", "square grid", "a pair"],
)
def test_other_taxels_of_tables_are_discs(places: Floats, area_m2: float) -> None:
    sensor = _of_areas(np.column_stack([places, np.full(len(places), area_m2)]))
    assert outlines(sensor.layout, 0).shape[1] == 24


def _of_areas(table: Floats) -> Sensor:
    """A sensor of taxels (taxels, 3) at x, y with areas."""
    places, area_m2 = tuple(map(tuple, table[:, :2].tolist())), tuple(table[:, 2].tolist())
    return Sensor(name="table", unit="Pa", pads=(Pad(name="pad", taxels=places, area_m2=area_m2),))
