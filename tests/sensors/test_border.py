from __future__ import annotations

import numpy as np
import pytest

from synthetic import dome, grid_sensor, scans_of
from taxelflow.messages import Bools, Floats
from taxelflow.sensors.border import Boundary

PAD = grid_sensor(4, 7)
TWO = grid_sensor(4, 7, pads=2)


def flags(*images: Floats, noise: float = 1.0, contact: bool | list[bool] = True) -> Bools:
    border, _ = Boundary(PAD.layout).step(scans_of(PAD, np.array(images), noise=noise, contact=contact))
    return border[:, 0]


def loaded(*taxels: int) -> Floats:
    scan = np.zeros(28)
    scan[list(taxels)] = 1e3
    return scan


@pytest.mark.parametrize(
    ("taxel", "expected"),
    [(10, (False, False)), (7, (True, False)), (13, (True, False)), (3, (False, True)), (27, (True, True))],
    ids=["inside", "left", "right", "top", "corner"],
)
def test_a_contact_reaches_the_border_at_which_a_loaded_taxel_lies(taxel: int, expected: tuple[bool, bool]) -> None:
    assert tuple(flags(loaded(taxel))[0]) == expected


def test_taxels_at_two_borders_set_both_flags() -> None:
    assert flags(loaded(3, 7)).tolist() == [[True, True]]


@pytest.mark.parametrize(("sigmas", "expected"), [(5.99, False), (6.01, True)])
def test_a_taxel_is_loaded_above_6_standard_deviations_of_its_noise(sigmas: float, expected: bool) -> None:
    assert flags(np.full(28, sigmas * 20.0), noise=20.0).tolist() == [[expected, expected]]


def test_masked_taxels_and_pads_without_contact_reach_no_border() -> None:
    assert not flags(loaded(0), noise=0.0).any()
    assert flags(loaded(0), loaded(0), contact=[False, True]).tolist() == [[False, False], [True, True]]


def test_one_pad_does_not_mark_the_other() -> None:
    scan = np.zeros((1, 56))
    scan[0, 28] = 1e3
    border, load = Boundary(TWO.layout).step(scans_of(TWO, scan, noise=1.0))
    assert border[0].tolist() == [[False, False], [True, True]]
    assert load.tolist() == [[0.0, 1e3]]


def test_a_pad_one_taxel_wide_is_all_border_along_x() -> None:
    column = grid_sensor(5, 1)
    border, _ = Boundary(column.layout).step(scans_of(column, [[0.0, 0.0, 1e3, 0.0, 0.0]], noise=1.0))
    assert border[0, 0].tolist() == [True, False]


def test_the_load_is_the_sum_of_the_readings_with_or_without_contact() -> None:
    values = np.array([dome(TWO) + dome(TWO, 0.01, pad=1) - 3.0, dome(TWO, pad=1)])
    _, load = Boundary(TWO.layout).step(scans_of(TWO, values, contact=[True, False]))
    np.testing.assert_allclose(load, values.reshape(2, 2, 28).sum(axis=2), rtol=1e-14)


def test_no_scans_have_no_border_and_no_load() -> None:
    border, load = Boundary(TWO.layout).step(scans_of(TWO, np.zeros((0, 56)), contact=np.zeros((0, 2))))
    assert border.shape == (0, 2, 2)
    assert load.shape == (0, 2)
