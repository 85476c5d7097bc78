"""Rate of change of a pad's load, in standard deviations of that of a steady load by the taxels' noise.

First-order high-pass, discrete, with the time step as it is:  y[k] = a (y[k-1] + L[k] - L[k-1]),
a = tau / (tau + dt), tau = 1 / (2 pi cutoff). With independent noise of variance s2[k] on L[k], y[k-1] and L[k-1] share
the covariance a[k-1] s2[k-1], so that  var y[k] = a^2 (var y[k-1] + s2[k] + s2[k-1] - 2 a[k-1] s2[k-1]).
"""

from __future__ import annotations

import numpy as np

from taxelflow.estimation.centroid.records import Pad, Row, ScanBlock
from taxelflow.messages import Floats
from taxelflow.numerics.records import Records
from taxelflow.runtime.compiling import kernel, routine


class Memory:
    """The last scan, if it was usable: its load L, the variance of L, and y, var y and a of the filter."""

    usable: bool
    t_s: float
    load: float
    variance: float
    y: float
    var_y: float
    a: float


@kernel
def load_change(
    block: ScanBlock,
    _places: Floats,
    pads: Records,
    cutoff_hz: float,
    memory: Records,
    rows: Records,
) -> None:
    """Fill `disturbance` of rows (scans, pads); other arguments as for `convolution_flow`.

    It needs two usable scans in a row, and begins again at lift-off; memory is kept from block to block.
    """
    t, pressure, noise, contact, complete = block
    tau = 1.0 / (2.0 * np.pi * cutoff_hz)
    for number in range(len(pads)):
        pad: Pad = pads[number]
        m: Memory = memory[number]
        for scan in range(len(t)):
            if not (contact[scan, number] and complete[scan, number]):
                m.usable = False
                continue
            load, variance = _load(pressure[scan, pad.begin : pad.end], noise[pad.begin : pad.end])
            y = var_y = a = 0.0
            if m.usable:
                a = tau / (tau + t[scan] - m.t_s)
                y = a * (m.y + load - m.load)
                var_y = a * a * (m.var_y + variance + m.variance - 2.0 * m.a * m.variance)
                row: Row = rows[scan, number]
                row.disturbance = abs(y) / np.sqrt(var_y) if var_y > 0.0 else 0.0
            m.usable, m.t_s, m.load, m.variance = True, t[scan], load, variance
            m.y, m.var_y, m.a = y, var_y, a


@routine
def _load(p: Floats, noise: Floats) -> tuple[float, float]:
    """Sum of the readings, and its variance; a reading of 0 has none."""
    load = variance = 0.0
    for k in range(len(p)):
        load += p[k]
        variance += noise[k] ** 2 if p[k] != 0.0 else 0.0
    return load, variance
