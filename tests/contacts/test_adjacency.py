from __future__ import annotations

import numpy as np

from synthetic import grid_sensor
from tabled import hexagonal, table_sensor
from taxelflow.contacts.adjacency import adjacency
from taxelflow.sensors.layout import Layout


def neighbours(layout: Layout, pads: list[int]) -> list[list[int]]:
    found = adjacency(layout, np.array(pads))
    return [found.taxels[found.first[k] : found.first[k + 1]].tolist() for k in range(layout.taxels)]


def test_in_a_grid_taxels_that_share_a_side_or_a_corner_are_neighbours() -> None:
    found = neighbours(grid_sensor(3, 3).layout, [0])
    assert found[4] == [0, 1, 2, 3, 5, 6, 7, 8]
    assert found[0] == [1, 3, 4]
    assert found[5] == [1, 2, 4, 7, 8]


def test_missing_taxels_are_nobodys_neighbours() -> None:
    assert neighbours(grid_sensor(1, 4, missing=((0, 1),)).layout, [0]) == [[], [2], [1]]


def test_pads_are_apart_and_only_those_asked_for_have_neighbours() -> None:
    layout = grid_sensor(1, 2, pads=3).layout
    assert neighbours(layout, [0, 2]) == [[1], [0], [], [], [5], [4]]


def test_in_a_table_neighbours_are_edges_of_its_triangulation() -> None:
    layout = table_sensor(hexagonal(5)).layout
    found = neighbours(layout, [0])
    pairs = {(one, other) for one, near in enumerate(found) for other in near}
    edges = {tuple(pair) for pair in layout.neighbours(0).tolist()}
    assert pairs == edges | {(other, one) for one, other in edges}
