"""Numbers that several scores make of errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


def rms(values: ArrayLike) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def finite(value: float | np.floating) -> float | None:
    """A number as reports have it: None for what is infinite or not known."""
    return float(value) if np.isfinite(value) else None
