"""Pairs of places that are close: of many, without looking at all pairs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Floats


def near_pairs(places: Floats, reach: float) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Numbers (pairs,) of the first and the second of all places closer than `reach`, and the way (2, pairs) between.

    places: (2, n). Each pair comes both ways, and each place with itself. Candidates are those near along x: time and
    memory grow with n times the places of a few columns.
    """
    order = np.argsort(places[0], kind="stable")
    x = places[0, order]
    low, high = np.searchsorted(x, x - reach), np.searchsorted(x, x + reach, side="right")
    count = high - low
    first = np.repeat(order, count)
    second = order[np.arange(len(first)) - np.repeat(np.cumsum(count) - count - low, count)]
    way = places[:, second] - places[:, first]
    near = np.hypot(*way) < reach
    return first[near], second[near], way[:, near]
