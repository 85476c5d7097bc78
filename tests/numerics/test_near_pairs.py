"""Pairs of places that are close, beside all pairs."""

from __future__ import annotations

import numpy as np
import pytest

from taxelflow.numerics.near_pairs import near_pairs


@pytest.mark.parametrize("seed", range(4))
def test_they_are_those_of_all_pairs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    places = rng.uniform(-4.0, 4.0, (2, 60)) if seed % 2 else np.stack(np.divmod(rng.permutation(60), 8)).astype(float)
    first, second, way = near_pairs(places, 1.5)
    found = np.zeros((60, 60), dtype=bool)
    found[first, second] = True
    apart = places[:, np.newaxis, :] - places[:, :, np.newaxis]
    assert np.array_equal(found, np.hypot(*apart) < 1.5)
    assert np.array_equal(way, apart[:, first, second])
    assert len(first) == np.count_nonzero(found)


def test_of_many_places_only_near_ones_are_looked_at() -> None:
    places = np.stack([np.arange(100_000.0), np.zeros(100_000)])  # all pairs are 80 GB
    first, second, _ = near_pairs(places, 1.1)
    assert len(first) == len(second) == 3 * 100_000 - 2
