from __future__ import annotations

import numpy as np

from taxelflow.messages import Floats
from taxelflow.numerics.centroid import loaded_centroid

PLACES = np.array([[0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 1.0, 1.0]])


def found(reading: list[float], variance: list[float] | None = None) -> Floats:
    out = np.full(4, np.nan)
    edge = np.array([True, False, False, True])
    loaded_centroid(np.array(reading), np.array(variance or [1.0] * 4), PLACES, edge, out)
    return out


def test_it_is_the_mean_place_of_the_load() -> None:
    np.testing.assert_allclose(found([0.0, 100.0, 300.0, 0.0]), [1.75, 0.75, 0.0, 400.0])


def test_the_share_at_the_border_is_that_of_the_load() -> None:
    np.testing.assert_allclose(found([100.0, 0.0, 0.0, 300.0])[2:], [1.0, 400.0])
    np.testing.assert_allclose(found([100.0, 0.0, 300.0, 0.0])[2:], [0.25, 400.0])


def test_readings_below_4_standard_deviations_or_5_percent_of_the_peak_do_not_count() -> None:
    np.testing.assert_allclose(found([3.9, 4.1, 0.0, 0.0])[[0, 3]], [1.0, 4.1])
    np.testing.assert_allclose(found([49.0, 51.0, 1000.0, 0.0])[3], 1051.0)


def test_masked_taxels_do_not_count_and_no_load_gives_zeros() -> None:
    np.testing.assert_allclose(found([100.0, 100.0, 0.0, 0.0], [0.0, 1.0, 1.0, 1.0])[[0, 3]], [1.0, 100.0])
    assert not found([-50.0, 1.0, 0.0, 3.0]).any()
