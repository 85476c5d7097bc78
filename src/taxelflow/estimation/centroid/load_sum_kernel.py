"""How fast the load of a pad changes, in standard deviations of what the noise of its taxels makes of a steady one.

First-order high-pass, discrete, with the time step as it is:  y[k] = a (y[k-1] + L[k] - L[k-1]),
a = tau / (tau + dt), tau = 1 / (2 pi cutoff). With independent noise of variance s2[k] on L[k], y[k-1] and L[k-1] share
the covariance a[k-1] s2[k-1], so that  var y[k] = a^2 (var y[k-1] + s2[k] + s2[k-1] - 2 a[k-1] s2[k-1]).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.estimation.centroid.session import DISTURBANCE
from taxelflow.messages import Bools, Floats

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Memory per pad: whether the last scan was usable, then its t, L, variance of L, y, variance of y, a.
_RUN, _T, _LOAD, _VARIANCE, _Y, _VAR_Y, _A, MEMORY = range(8)


@kernel
def load_change(
    t: Floats,
    pressure: Floats,
    noise: Floats,
    contact: Bools,
    complete: Bools,
    _places: Floats,
    starts: NDArray[np.int64],
    cutoff_hz: float,
    memory: Floats,
    rows: Floats,
) -> None:
    """Fill column DISTURBANCE of rows (scans, pads, COLUMNS); arguments as for `flow.convolution_flow`.

    It needs two usable scans in a row, and begins anew at lift-off: memory (pads, 7) is kept from block to block.
    """
    tau = 1.0 / (2.0 * np.pi * cutoff_hz)
    for pad in range(len(starts) - 1):
        m = memory[pad]
        for scan in range(len(t)):
            if not (contact[scan, pad] and complete[scan, pad]):
                m[_RUN] = 0.0
                continue
            load = variance = 0.0
            for taxel in range(starts[pad], starts[pad + 1]):
                load += pressure[scan, taxel]
                variance += noise[taxel] ** 2 if pressure[scan, taxel] != 0.0 else 0.0
            y = var_y = a = 0.0
            if m[_RUN] > 0.0:
                a = tau / (tau + t[scan] - m[_T])
                y = a * (m[_Y] + load - m[_LOAD])
                var_y = a * a * (m[_VAR_Y] + variance + m[_VARIANCE] - 2.0 * m[_A] * m[_VARIANCE])
                rows[scan, pad, DISTURBANCE] = abs(y) / np.sqrt(var_y) if var_y > 0.0 else 0.0
            m[_RUN], m[_T], m[_LOAD], m[_VARIANCE] = 1.0, t[scan], load, variance
            m[_Y], m[_VAR_Y], m[_A] = y, var_y, a
