"""Pairs of places that are close: of many, without looking at all pairs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from taxelflow.numerics.rounding import ROUNDING

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Floats


def near_pairs(places: Floats, reach: float) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Numbers (pairs,) of the first and the second of all places closer than `reach`, and the way (2, pairs) between.

    places: (2, n). Each pair comes both ways, and each place with itself.
    """
    farther = reach * (1.0 + ROUNDING)  # the tree rounds distances in another way
    pairs = cKDTree(places.T).query_pairs(farther, output_type="ndarray")
    own = np.arange(places.shape[1])
    first, second = np.concatenate([pairs[:, 0], pairs[:, 1], own]), np.concatenate([pairs[:, 1], pairs[:, 0], own])
    way = places[:, second] - places[:, first]
    near = np.hypot(*way) < reach
    return first[near], second[near], way[:, near]
