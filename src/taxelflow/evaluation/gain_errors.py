"""What the residuals of a fit of gains have in common in consecutive scans."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Floats


class _Alike(NamedTuple):
    """Which residuals may be alike."""

    lags: int = 6
    """Scans apart at most."""


_ALIKE = _Alike()


def inflation(whitened: Floats) -> float:
    """How much larger variances are because consecutive residuals (scans, 2) are alike: 1 + 2 sum of correlations."""
    power = float(np.sum(whitened**2))
    lags = min(_ALIKE.lags, len(whitened) // 4)
    if power <= 0 or lags < 1:
        return 1.0
    alike = [float(np.sum(whitened[lag:] * whitened[:-lag])) / power for lag in range(1, lags + 1)]
    fading = 1 - np.arange(1, lags + 1) / (lags + 1)  # Bartlett's weights keep the sum above 0
    return max(1.0, 1 + 2 * float(fading @ alike))
