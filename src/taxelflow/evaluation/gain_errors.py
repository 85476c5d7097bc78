"""What the residuals of a fit of gains have in common: in consecutive scans, and at one place between the taxels."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats


class _Alike(NamedTuple):
    """Which residuals may be alike."""

    lags: int = 6
    """Scans apart at most."""
    cells: int = 4
    """Per pitch: places at which errors of sampling are taken as one."""


_ALIKE = _Alike()


def by_place(left: Floats, place: Floats, clean: Bools) -> float:
    """Standard deviation of what residuals have in common at one place. place: in pitches."""
    _, bins = np.unique(np.floor(_ALIKE.cells * place[clean]), return_inverse=True)
    count = np.bincount(bins)
    mean = np.bincount(bins, left[clean]) / count
    within = float(np.sum((left[clean] - mean[bins]) ** 2)) / max(1, len(bins) - len(count))
    return float(np.sqrt(max(0.0, float(count @ mean**2) - len(count) * within) / len(bins)))


def inflation(whitened: Floats) -> float:
    """How much larger variances are because consecutive residuals (scans, 2) are alike: 1 + 2 sum of correlations."""
    power = float(np.sum(whitened**2))
    lags = min(_ALIKE.lags, len(whitened) // 4)
    if power <= 0 or lags < 1:
        return 1.0
    alike = [float(np.sum(whitened[lag:] * whitened[:-lag])) / power for lag in range(1, lags + 1)]
    fading = 1 - np.arange(1, lags + 1) / (lags + 1)  # Bartlett's weights keep the sum above 0
    return max(1.0, 1 + 2 * float(fading @ alike))
