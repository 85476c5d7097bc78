from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from taxelflow.runtime.compiling import kernel
from taxelflow.runtime.settled import Settled


class Pair(NamedTuple):
    one: np.ndarray
    other: np.ndarray


@kernel
def total(pair: Pair, factor: float) -> float:
    """Of both, times a factor."""
    return float(factor * (pair.one.sum() + pair.other.sum()))


PAIR = Pair(np.arange(3.0), np.ones(2))


def test_it_gives_what_the_kernel_gives() -> None:
    settled = Settled(total)
    assert [settled(PAIR, 2.0) for _ in range(3)] == [10.0] * 3
    assert settled(Pair(np.arange(5.0), np.zeros(0)), 1.0) == 10.0  # any size


def test_other_types_than_at_first_are_found_in_tests() -> None:
    settled = Settled(total)
    settled(PAIR, 2.0)
    with pytest.raises(TypeError, match="first with"):
        settled(Pair(np.zeros((2, 4))[:, ::2][0], np.zeros(2)), 1.0)
    with pytest.raises(TypeError, match="first with"):
        settled(Pair(np.arange(3), np.zeros(2)), 1.0)


def test_a_function_that_is_not_compiled_is_called_as_it_is() -> None:
    settled = Settled(sum)
    assert [settled([1, 2]), settled([3])] == [3, 3]
