from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, cast

import numba
import numpy as np
import pytest
from numba.core.lowering import Lower
from numpy.typing import NDArray

from taxelflow.messages import Floats
from taxelflow.numerics.records import Records, Vector, records
from taxelflow.runtime import lowering, pipeline
from taxelflow.runtime.compiling import kernel, routine
from taxelflow.runtime.lowering import KernelLower


class Part:
    weight: float
    count: int


class Whole:
    is_on: bool
    place: Vector
    table: Annotated[Floats, 2, 3]
    parts: Annotated[Records, Part, 2]


Both = Callable[..., tuple[Any, Any]]


@pytest.fixture
def both(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Both:
    """What a function gives as a kernel, which is compiled as it is now, and as Python, each with its own arguments."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))

    def run(function: Any, *arguments: Any) -> tuple[Any, Any]:
        own = [np.array(one, copy=True, order="K") if isinstance(one, np.ndarray) else one for one in arguments]
        # Python reads the fields of records as attributes, too
        plain = [one.view(np.recarray) if getattr(one, "dtype", np.dtype(float)).names else one for one in arguments]
        return (cast("Any", kernel(function))(*own), *own), (function(*plain), *arguments)

    return run


def same(ours: Any, theirs: Any) -> bool:
    return all(np.array_equal(one, other) for one, other in zip(ours, theirs, strict=True))


@pytest.mark.parametrize(
    "array",
    [
        np.arange(24.0).reshape(4, 6),
        np.asfortranarray(np.arange(24.0).reshape(4, 6)),
        np.arange(96.0).reshape(8, 12)[::2, ::-2],
        np.arange(24).reshape(4, 6).astype(np.int64),
        np.arange(24).reshape(4, 6) % 3 == 0,
    ],
    ids=["C", "F", "A", "int", "bool"],
)
def test_elements_are_read_and_written_in_any_layout_and_from_the_end(both: Both, array: NDArray[Any]) -> None:
    def swapped(values: NDArray[Any], row: int, unsigned: np.uint32) -> float:
        total = 0.0
        for i in range(values.shape[0]):
            for j in range(values.shape[1]):
                total = 3.0 * total + values[i, j]
        kept = values[row, -2]
        values[row, -2] = values[0, unsigned]
        values[-1, unsigned] = kept
        values[1, 1] = 2
        return total

    ours, theirs = both(swapped, array, -3, np.uint32(1))
    assert same(ours, theirs)


def test_a_view_is_of_the_same_numbers(both: Both) -> None:
    def doubled(values: NDArray[Any]) -> float:
        row, middle, last = values[1], values[:, 1:3], values[-1, 1:]
        for j in range(row.shape[0]):
            row[j] *= 2.0
        for i in range(middle.shape[0]):
            middle[i, 0] += 0.5
        last[0] = row[-1]
        return float(row[0] + middle[2, 1] + len(last))

    assert same(*both(doubled, np.arange(12.0).reshape(3, 4)))


def test_the_fields_of_a_record_and_the_arrays_in_it_are_read_and_written(both: Both) -> None:
    def filled(rows: Records, at: int) -> float:
        row: Whole = rows[at]
        for k in range(3):
            row.place[k] = k + 1.0
            row.table[1, -1 - k] = row.place[k] * 2.0
        row.is_on = row.table[1, 0] > 5.0
        part: Part = row.parts[1 if row.is_on else 0]
        part.weight, part.count = row.place[2], 7
        row.parts[0] = row.parts[-1]
        return float(row.parts[0].weight + row.parts[0].count + len(row.place) + row.table.shape[1])

    ours, theirs = both(filled, records(Whole, 2), -1)
    assert ours[0] == theirs[0] == 3.0 + 7 + 3 + 3
    assert repr(ours[1]) == repr(theirs[1])
    assert ours[1]["is_on"].tolist() == [False, True]


@pytest.mark.parametrize("bounds", [(0, 5, 1), (5, 0, -1), (5, 0, -2), (0, 5, 2), (3, 3, 1), (4, 3, 1), (3, 4, -1)])
def test_a_range_goes_as_in_python(both: Both, bounds: tuple[int, int, int]) -> None:
    def listed(start: int, stop: int, step: int) -> tuple[int, int]:
        found, last = 0, -1
        for i in range(start, stop, step):
            if i == 4:
                continue
            found, last = 10 * found + i, i
        for i in range(stop):
            found += i
        return found, last

    ours, theirs = both(listed, *bounds)
    assert ours == theirs


def test_a_step_of_zero_is_refused() -> None:
    def listed(step: int) -> int:
        found = 0
        for i in range(0, 3, step):
            found += i
        return found

    with pytest.raises(ValueError, match="must not be zero"):
        cast("Any", kernel(listed))(0)


def test_operators_are_typed_by_their_operands(both: Both) -> None:
    def combined(whole: int, real: float, flag: bool) -> tuple[float, float, float, float, int, bool]:
        whole += 2
        real -= whole
        return whole / 2, real * whole, real**2, whole * 1.5, whole // 2 + flag, whole < real or whole == 5

    for operands in ((3, 2.5, True), (-3, 2.5, False), (2.5, 3, True)):
        ours, theirs = both(combined, *operands)
        assert ours == theirs
        assert [type(one) for one in ours[0]] == [type(one) for one in theirs[0]]


def test_a_function_is_typed_by_the_types_that_it_is_called_with(both: Both) -> None:
    @routine
    def least(one: Any, other: Any) -> Any:
        return min(one, other)

    def all_least(whole: int, real: float) -> tuple[float, int, float]:
        return least(real, 2.0), least(whole, 2), abs(min(real, 1.0))

    ours, theirs = both(all_least, 3, -1.5)
    assert ours == theirs
    assert isinstance(ours[0][1], int)


def test_numbas_own_lowering_gives_the_same(both: Both, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the bit, sums that may be reordered included."""

    def mixed(values: Floats, weights: Floats, rows: Records) -> float:
        row: Whole = rows[0]
        total = 0.0
        for i in range(values.shape[0]):
            for j in range(weights.shape[0]):
                row.table[j % 2, j % 3] += values[i, j] * weights[j] / (1.0 + i)
                total += values[i, j] * weights[-1 - j]
        return total + row.table[1, 2]

    random = np.random.default_rng(3)
    values, weights = random.normal(size=(40, 7)), random.normal(size=7)
    ours, _ = both(mixed, values, weights, records(Whole, 1))
    with monkeypatch.context() as patch:
        patch.setattr(pipeline.KernelLowering, "lowering_class", Lower)
        patch.setattr(numba.config, "CACHE_DIR", f"{numba.config.CACHE_DIR}-numba")
        theirs, _ = both(mixed, values, weights, records(Whole, 1))
    assert ours[0] == theirs[0]
    assert ours[3]["table"].tobytes() == theirs[3]["table"].tobytes()


def test_an_error_names_the_line_that_could_not_be_lowered(monkeypatch: pytest.MonkeyPatch) -> None:
    def first(values: Floats) -> float:
        return float(values[0])

    def refuse(*_arguments: object) -> None:
        raise NotImplementedError

    monkeypatch.setattr(lowering, "load_item", refuse)
    with pytest.raises(NotImplementedError) as caught:
        cast("Any", kernel(first))(np.zeros(2))
    assert any("test_lowering.py" in note for note in caught.value.__notes__)


def test_what_it_does_not_know_is_left_to_numba(both: Both) -> None:
    def shuffled(values: Floats, pair: tuple[float, int]) -> tuple[float, float]:
        real, whole = pair
        inner = (values[0], values[whole])
        return inner[0] + real, inner[-1] ** 3

    assert issubclass(KernelLower, Lower)
    assert same(*both(shuffled, np.array([1.0, 2.0, 3.0]), (0.5, 2)))
