"""Times in nanoseconds."""

from __future__ import annotations

import math
import struct

import pytest

from taxelflow.numerics.clock import FARTHEST_S, nanoseconds


@pytest.mark.parametrize(("t_s", "ns"), [(1.5, 1_500_000_000), (-3.0, 0), (math.nan, 0), (-math.inf, 0)])
def test_a_time_in_nanoseconds(t_s: float, ns: int) -> None:
    assert nanoseconds(t_s) == ns


@pytest.mark.parametrize("t_s", [1e12, 1e300, math.inf])
def test_a_time_that_is_too_late_still_has_64_bits(t_s: float) -> None:
    assert nanoseconds(t_s) == nanoseconds(FARTHEST_S)
    assert len(struct.pack("<Q", nanoseconds(t_s))) == 8
