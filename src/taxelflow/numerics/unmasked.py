"""Numbers that a user gives, as an array of float64 of our own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from taxelflow.messages import Floats


def floats_of(values: ArrayLike) -> Floats:
    """A copy; NaN where an element of a masked array is masked. Raises TypeError, ValueError for what is no numbers."""
    if isinstance(values, np.ndarray) and values.dtype.kind in "cmM":  # NumPy would drop a part, or the unit
        raise TypeError(f"values are {values.dtype}")
    with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN like any other
        if isinstance(values, np.ma.MaskedArray):
            return np.ma.filled(values.astype(np.float64), np.nan)
        return np.array(values, dtype=np.float64)
