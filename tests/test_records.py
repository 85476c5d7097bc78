from __future__ import annotations

from typing import Annotated

import numpy as np
from taxelflow.records import Records, record, record_dtype, records

from taxelflow.compiling import kernel
from taxelflow.messages import Floats


class Inner:
    count: int


class Outer:
    level: float
    seen: bool
    inner: Inner
    ring: Annotated[Floats, 3]
    parts: Annotated[Records, Inner, 2]


@kernel
def fill(held: Records) -> None:
    for k in range(len(held)):
        own: Outer = held[k]
        own.level, own.seen, own.inner.count = 0.5, True, k
        own.ring[k] = 2.0
        own.parts[1].count = 7


def test_a_class_describes_a_record() -> None:
    dtype = record_dtype(Outer)
    assert dtype.names == ("level", "seen", "inner", "ring", "parts")
    assert dtype["ring"].shape == (3,)
    assert dtype["parts"].shape == (2,)
    assert records(Outer, 2, 4).shape == (2, 4)


def test_a_kernel_writes_fields_by_name() -> None:
    held = records(Outer, 2)
    fill(held)
    assert held["level"].tolist() == [0.5, 0.5]
    assert held["seen"].all()
    assert held["inner"]["count"].tolist() == [0, 1]
    assert held["ring"].tolist() == [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0]]
    assert held["parts"]["count"].tolist() == [[0, 7], [0, 7]]


def test_outside_kernels_a_record_is_read_and_written_by_attribute() -> None:
    held = records(Outer, 2)
    own = record(Outer, held, 1)
    own.level = 3.0
    assert held["level"].tolist() == [0.0, 3.0]
    held[:] = np.zeros(1, held.dtype)
    assert own.level == 0.0
