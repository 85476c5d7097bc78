from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from taxelflow.publish.plots.style import styled, tick_step

if TYPE_CHECKING:
    from collections.abc import Iterator

    from matplotlib.axes import Axes

pytest.importorskip("matplotlib")

import matplotlib.pyplot as plt

from taxelflow.publish.plots.names import free_places, write_names

SQUARE = np.stack(np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 5)), axis=-1).reshape(-1, 2)


@pytest.fixture
def axis() -> Iterator[Axes]:
    with styled():
        _, axis = plt.subplots(figsize=(4, 4))
        axis.set_xlim(0, 10)
        axis.set_ylim(0, 10)
        yield axis
    plt.close("all")


def test_a_name_stands_above_its_pad(axis: Axes) -> None:
    (name,) = free_places(axis, [SQUARE + 5], ["tip"], 7.0)
    assert name.at[0] == pytest.approx(5.5)
    assert name.at[1] > 6
    assert name.covers == 0


def test_a_name_gives_way_to_another_pad(axis: Axes) -> None:
    (name, _) = free_places(axis, [SQUARE + 5, SQUARE + np.array([5.0, 6.2])], ["tip", "mid"], 7.0)
    assert name.at[1] < 5


def test_a_name_stays_on_the_axis(axis: Axes) -> None:
    (name,) = free_places(axis, [SQUARE + np.array([5.0, 9.0])], ["tip"], 7.0)
    assert name.at[1] < 9


def test_a_name_gives_way_to_other_marks(axis: Axes) -> None:
    arrow = np.column_stack([np.full(9, 5.5), np.linspace(5.5, 8, 9)])
    (name,) = free_places(axis, [SQUARE + 5], ["tip"], 7.0, arrow)
    assert name.at[1] < 5


def test_names_of_pads_that_lie_alike_do_not_meet(axis: Axes) -> None:
    first, second = free_places(axis, [SQUARE + 5, SQUARE + 5], ["tip", "mid"], 7.0)
    assert first.at != second.at
    write_names(axis, [first, second], 7.0)
    axis.figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in axis.texts]
    assert not boxes[0].overlaps(boxes[1])


def test_a_name_without_room_reports_what_it_covers(axis: Axes) -> None:
    whole = np.stack(np.meshgrid(np.linspace(0, 10, 99), np.linspace(0, 10, 99)), axis=-1).reshape(-1, 2)
    (name, _) = free_places(axis, [SQUARE + 5, whole], ["tip", "all"], 7.0)
    assert name.covers > 0


@pytest.mark.parametrize(("extent", "step"), [(10.0, 5.0), (7.9, 2.0), (300.0, 100.0), (0.03, 0.01)])
def test_ticks_are_round_and_few(extent: float, step: float) -> None:
    assert tick_step(extent, 4) == pytest.approx(step)
