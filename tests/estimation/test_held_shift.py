"""What a load shifts before a slip, by hand-made excursions of one pad or two."""

from __future__ import annotations

import numpy as np
import pytest

from taxelflow.estimation.held_shift import HeldShift
from taxelflow.messages import Bools, Floats


def column(*values: float, kind: type = bool) -> Bools:
    return np.array(values, dtype=kind)[:, np.newaxis]


def away(*x: float) -> Floats:
    """(scans, 1, 2), distances from the reference along x."""
    return np.stack([column(*x, kind=float), np.zeros((len(x), 1))], axis=-1)


STAYS = column(0, 0, 0, 0, 0)


def test_the_distance_at_the_begin_of_a_slip_is_held_from_then_on() -> None:
    held = HeldShift(1).step(away(0, 1, 2, 5, 9), column(0, 0, 1, 1, 0), STAYS, STAYS.astype(int))
    assert held[:, 0, 0, 0].tolist() == [0, 0, 4, 4, 4]
    np.testing.assert_array_equal(held[..., 1], 0.0)


def test_an_excursion_has_one_begin_and_each_adds_its_own() -> None:
    slides = column(1, 0, 1, 0, 1)
    held = HeldShift(1).step(away(1, 1, 3, 3, 2), slides, STAYS, column(0, 0, 0, 1, 1, kind=int))
    assert held[:, 0, 0, 0].tolist() == [1, 1, 1, 1, 5]


def test_nothing_is_held_where_a_slide_explains_the_distance_already() -> None:
    held = HeldShift(1).step(away(2, 3), column(1, 1), column(1, 1), column(0, 0, kind=int))
    np.testing.assert_array_equal(held, 0.0)


def test_a_release_ends_it() -> None:
    numbers = column(0, 0, 1, 2, 2, kind=int)
    held = HeldShift(1).step(away(2, 2, np.nan, 0, 1), column(1, 1, 1, 0, 1), STAYS, numbers)
    assert held[:, 0, 0, 0].tolist() == [4, 4, 0, 0, 1]


@pytest.mark.parametrize("size", [1, 2, 3])
def test_blocks_of_any_size_hold_the_same(size: int) -> None:
    random = np.random.default_rng(4)
    scans = 40
    places = random.normal(size=(scans, 2, 2))
    places[random.random((scans, 2)) < 0.1] = np.nan
    slides, moved = random.random((2, scans, 2)) < 0.3
    numbers = np.cumsum(random.random((scans, 2)) < 0.2, axis=0)
    whole = HeldShift(2).step(places, slides, moved, numbers)
    assert whole.any()
    shifts = HeldShift(2)
    cuts = range(0, scans, size)
    parts = [shifts.step(*(each[at : at + size] for each in (places, slides, moved, numbers))) for at in cuts]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
