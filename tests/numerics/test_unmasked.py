"""Arrays that a user gives."""

from __future__ import annotations

import numpy as np
import pytest

from taxelflow.numerics.unmasked import floats_of


@pytest.mark.parametrize("masked", [False, True])
def test_a_signalling_nan_is_a_missing_reading(masked: bool) -> None:
    numbers = np.array([0x7FA00000, 0x3F800000], np.uint32).view(np.float32)
    found = floats_of(np.ma.masked_array(numbers, mask=False) if masked else numbers)
    np.testing.assert_array_equal(found, [np.nan, 1.0])
