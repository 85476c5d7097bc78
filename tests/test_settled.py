from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
import pytest

from taxelflow.runtime.compiling import kernel, routine
from taxelflow.runtime.settled import Settled, _kinds_of


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


RECORDS = np.zeros(2, dtype=[("x", float), ("n", np.int64)])


@pytest.mark.parametrize(
    ("first", "other"),
    [
        (np.zeros((2, 3)), np.zeros((3, 2)).T),
        (np.zeros((2, 3)), np.zeros(6)),
        (np.zeros(4), np.zeros(8)[::2]),
        (np.zeros(4), np.zeros(4, dtype=np.float32)),
        (RECORDS, np.zeros(2, dtype=[("n", np.int64), ("x", float)])),
        (RECORDS, np.zeros(2, dtype=np.dtype([("x", float), ("n", np.int64)], align=True))),
        (RECORDS[0], np.zeros(1, dtype=[("x", float), ("m", np.int64)])[0]),
        (1, 1.0),
        (True, 1),
        (np.float64(1.0), np.float32(1.0)),
        ((1.0, 2), (1.0, 2.0)),
        ((1.0, 2), (1.0, 2, 3)),
        ((PAIR, 1), (Pair(PAIR.one, PAIR.other.astype(int)), 1)),
        ((1.0, 2.0), Pair(1.0, 2.0)),  # type: ignore[arg-type]
    ],
)
def test_what_is_compared_differs_where_numbas_types_do(first: Any, other: Any) -> None:
    assert numba.typeof(first) != numba.typeof(other)
    assert _kinds_of((first,)) != _kinds_of((other,))
    assert _kinds_of((first,)) == _kinds_of((first,))


def test_arrays_that_may_not_be_written_are_another_type() -> None:
    fixed = np.zeros(3)
    fixed.flags.writeable = False
    assert numba.typeof(fixed) != numba.typeof(np.zeros(3))
    assert _kinds_of((fixed,)) != _kinds_of((np.zeros(3),))


def test_arrays_of_one_row_or_none_have_the_type_of_others() -> None:
    settled = Settled(total)
    settled(PAIR, 2.0)
    assert settled(Pair(np.zeros((1, 4))[0], np.zeros(0)[::2]), 1.0) == 0.0
    assert _kinds_of((np.zeros((1, 3)),)) == _kinds_of((np.zeros((2, 3)),))


def test_a_function_that_is_not_compiled_is_called_as_it_is() -> None:
    settled = Settled(sum)
    assert [settled([1, 2]), settled([3])] == [3, 3]


def test_a_routine_is_refused_in_tests_for_it_is_plain_python() -> None:
    @routine
    def double(number: float) -> float:
        return 2.0 * number

    with pytest.raises(TypeError, match="is a routine"):
        Settled(double)(1.0)
