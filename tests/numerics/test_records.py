from __future__ import annotations

from typing import Annotated

import numpy as np

from taxelflow.messages import Floats
from taxelflow.numerics.records import Records, Vector, record, record_dtype, records, unknown
from taxelflow.runtime.compiling import kernel


class Inner:
    weight: float
    place: Vector


class Outer:
    count: int
    known: bool
    matrix: Annotated[Floats, 2, 3]
    inner: Inner
    rows: Annotated[Records, Inner, 4]


@kernel
def fill(outer: Outer) -> None:
    outer.count, outer.known = 3, True
    outer.matrix[1, 2] = 5.0
    outer.inner.place[1] = 7.0
    row: Inner = outer.rows[2]
    row.weight = 9.0
    outer.rows[3] = outer.rows[2]


def test_a_class_describes_a_record_with_nested_records_and_arrays() -> None:
    dtype = record_dtype(Outer)
    assert dtype.names == ("count", "known", "matrix", "inner", "rows")
    assert dtype["matrix"].shape == (2, 3)
    assert dtype["rows"].shape == (4,)
    assert dtype["inner"] == dtype["rows"].base == record_dtype(Inner)
    assert dtype.isalignedstruct


def test_a_kernel_writes_fields_by_name() -> None:
    outer = records(Outer, 2)[1]
    assert not outer["known"]
    fill(outer)
    assert (outer["count"], outer["known"], outer["matrix"][1, 2]) == (3, True, 5.0)
    np.testing.assert_array_equal(outer["inner"]["place"], [0.0, 7.0, 0.0])
    assert outer["rows"]["weight"].tolist() == [0.0, 0.0, 9.0, 9.0]


class Point:
    x: float
    y: float


def test_unknown_records_are_nan() -> None:
    held = unknown(Point, 2, 3)
    assert held.shape == (2, 3)
    assert np.isnan(held["x"]).all()
    assert np.isnan(held["y"]).all()
    assert unknown(Point, 0, 3).shape == (0, 3)


def test_writing_to_a_records_field_writes_to_the_array() -> None:
    held = records(Point, 3)
    record(Point, held, 1).y = 2.0
    assert held["y"].tolist() == [0.0, 2.0, 0.0]


def test_fields_are_read_as_numbers_and_views_of_arrays() -> None:
    held = records(Outer, 2)
    one = record(Outer, held, 1)
    one.count, one.known, one.matrix[0, 1] = 3, True, 5.0
    one.inner.place = np.array([1.0, 2.0, 3.0])
    assert (int(held["count"][1]), bool(held["known"][1]), held["matrix"][1, 0, 1]) == (3, True, 5.0)
    assert held["inner"]["place"].tolist() == [[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]
    held[1] = np.zeros((), held.dtype)
    assert not (one.count or one.known or one.matrix.any() or one.inner.place.any())
    assert isinstance(one.count, np.integer)
