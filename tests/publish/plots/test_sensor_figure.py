from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from costly import mostly_long
from synthetic import grid_sensor
from tabled import arched, hexagonal, table_sensor
from taxelflow.publish.plots.style import styled
from taxelflow.sensors.catalogue import catalogue, load_sensor

if TYPE_CHECKING:
    from collections.abc import Iterator

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taxelflow.sensors.sensor import Sensor

pytest.importorskip("matplotlib")

import matplotlib.pyplot as plt
from matplotlib.collections import PolyCollection

from taxelflow.publish.plots.outlines import outlines
from taxelflow.publish.plots.sensor import sensor_figure


@pytest.fixture(autouse=True)
def style() -> Iterator[None]:
    with styled():
        yield
    plt.close("all")


def taxels(figure: Figure) -> int:
    found = [item for axis in figure.axes for item in axis.collections if type(item) is PolyCollection]
    return sum(len(item.get_paths()) for item in found)


def numbers(axis: Axes) -> dict[int, tuple[float, float]]:
    return {int(text.get_text()): text.get_position() for text in axis.texts if text.get_text().isdigit()}


@pytest.mark.parametrize("name", mostly_long((name for name, _ in catalogue()), "barretthand-162", "triangle-64"))
def test_each_built_in_sensor_is_drawn_with_all_its_taxels(name: str) -> None:
    sensor = load_sensor(name.replace("PITCH", "3"))
    figure = sensor_figure(sensor)
    assert taxels(figure) == sensor.layout.taxels
    assert sum(len(numbers(axis)) for axis in figure.axes) == sensor.layout.taxels


def test_taxels_are_numbered_where_they_lie_on_the_hand() -> None:
    figure = sensor_figure(load_sensor("barretthand-162"))
    at = numbers(figure.axes[0])
    np.testing.assert_allclose(at[146], (0, 5), atol=1e-9)
    assert at[46][0] > 100  # finger 2 lies to the right


def test_curved_skin_is_shown_in_space_too() -> None:
    assert [axis.name for axis in sensor_figure(table_sensor(arched(3, 5, 0.01)[1])).axes] == ["rectilinear", "3d"]
    assert [axis.name for axis in sensor_figure(table_sensor(hexagonal(2))).axes] == ["rectilinear"]


def test_pads_without_a_place_in_the_hand_stand_side_by_side() -> None:
    figure = sensor_figure(grid_sensor(2, 3, pads=7))
    titles = [axis.get_title(loc="left") for axis in figure.axes]
    assert titles == [*(f"pad{number}" for number in range(7)), "", "", ""]


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
