from __future__ import annotations

from typing import Annotated

import numpy as np

from taxelflow.messages import Floats
from taxelflow.numerics.records import Records, Vector, record_dtype, records, unknown


class Inner:
    """A record in a record."""

    x: float
    y: float


class Outer:
    """Fields of every kind."""

    count: int
    known: bool
    place: Inner
    pose: Vector
    covariance: Annotated[Floats, 3, 3]
    history: Annotated[Records, Inner, 2]


def test_fields_have_the_types_and_shapes_of_the_annotations() -> None:
    dtype = record_dtype(Outer)
    assert dtype.names == ("count", "known", "place", "pose", "covariance", "history")
    assert dtype["count"] == np.int64
    assert dtype["known"] == np.bool_
    assert dtype["place"] == record_dtype(Inner)
    assert dtype["pose"].shape == (3,)
    assert dtype["covariance"].shape == (3, 3)
    assert dtype["history"].shape == (2,)
    assert record_dtype(Outer) is dtype


def test_records_start_as_0_and_unknown_ones_as_nan() -> None:
    assert not any(np.any(records(Outer, 4)[name].view(np.uint8)) for name in ("count", "known", "pose"))
    held = unknown(Inner, 2, 3)
    assert held.shape == (2, 3)
    assert np.isnan(held["y"]).all()
    assert unknown(Inner, 0, 3).shape == (0, 3)
