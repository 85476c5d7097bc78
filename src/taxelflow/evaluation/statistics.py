"""Numbers that several scores make of errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from taxelflow.messages import Floats


def rms(values: ArrayLike) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def finite(value: float | np.floating) -> float | None:
    """A number as reports have it: None for what is infinite or not known."""
    return float(value) if np.isfinite(value) else None


def resampled(values: Floats, measure: Callable[[Floats], Any], draws: int) -> tuple[float, float]:
    """95 % interval of a measure by the percentile bootstrap: rows of values (n, ...) are drawn with replacement.

    measure: of (draws, n, ...), a number each (draws,).
    """
    picks = np.random.default_rng(0).integers(len(values), size=(draws, len(values)))
    low, high = np.quantile(measure(values[picks]), (0.025, 0.975))
    return float(low), float(high)
