"""The fast form of Method II: centroids in one pass, and their covariance from the noise of the taxels.

The centroid of a full convolution is the sum of the two centroids. With c[T] the 1-based pressure-weighted
centroid, equation (2) gives i[T] = c[T-1] + c[T] - 1, so that S[T] = c[T] - c[T-2]: the motion over two scans,
half a scan late. `literal.py` holds the equations to the letter; a test holds both equal.

In the pad's frame (y up, against the row index) and with one scan's motion as half of S:
    x[T] = gain pitch_x (i[T] - N) / 2 = gain (cx[T-1] + cx[T]) / 2,   dx[T] = x[T] - x[T-1].
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.estimation.centroid.session import (
    COV_XY,
    D_COV_XY,
    D_VAR_X,
    D_VAR_Y,
    DX,
    DY,
    LAG,
    LOAD,
    SPAN,
    VAR_X,
    VAR_Y,
    X,
    Y,
)
from taxelflow.messages import Bools, Floats

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.sensors.layout import Layout

# Memory per pad: how many usable scans in a row (0, 1, 2), then t, x, y, var_x, var_y, cov_xy of the last of them
# and of the one before.
_RUN, _LAST, _BEFORE, MEMORY = 0, 1, 7, 13
_LONG = 16


def long_rows(layout: Layout) -> NDArray[np.int64]:
    """(pads,): columns of a pad that is a full grid with rows long enough to be worth a loop of their own, else 0."""
    full = [
        cols if rows * cols == layout.starts[pad + 1] - layout.starts[pad] and cols >= _LONG else 0
        for pad, (rows, cols) in enumerate(layout.shapes)
    ]
    return np.array(full, dtype=np.int64)


@kernel
def weighted_sums(p: Floats, x: Floats, y: Floats, cols: int) -> tuple[float, float, float, bool]:
    """Sums of p, p x, p y, and whether some p is 0; cols: length of a full grid's rows if they are long, else 0.

    Slices that start at 0 are what the compiler can vectorise; on long rows y is applied once a row, and one load and
    one product a taxel are saved.
    """
    s = sx = sy = 0.0
    silent = np.int64(0)
    if cols == 0:
        for k in range(len(p)):
            s += p[k]
            sx += p[k] * x[k]
            sy += p[k] * y[k]
            silent |= np.int64(p[k] == 0.0)
        return s, sx, sy, bool(silent > 0)
    for start in range(0, len(p), cols):
        row_s, row_sx, row_silent = _row_sums(p[start : start + cols], x[:cols])
        s += row_s
        sx += row_sx
        sy += row_s * y[start]
        silent |= row_silent
    return s, sx, sy, bool(silent > 0)


@kernel
def _row_sums(p: Floats, x: Floats) -> tuple[float, float, np.int64]:
    s = sx = 0.0
    silent = np.int64(0)
    for k in range(len(x)):
        s += p[k]
        sx += p[k] * x[k]
        silent |= np.int64(p[k] == 0.0)
    return s, sx, silent


@kernel
def noise_moments(noise: Floats, places: Floats, begin: int, end: int, reading: Floats) -> Floats:
    """Sums of noise^2 times 1, x, y, x^2, y^2, xy over the taxels begin..end whose reading is not 0: (6,)."""
    moments = np.zeros(6)
    for taxel in range(begin, end):
        variance = noise[taxel] * noise[taxel] if reading[taxel] != 0.0 else 0.0
        x, y = places[0, taxel], places[1, taxel]
        moments[0] += variance
        moments[1] += variance * x
        moments[2] += variance * y
        moments[3] += variance * x * x
        moments[4] += variance * y * y
        moments[5] += variance * x * y
    return moments


@kernel
def pad_moments(noise: Floats, places: Floats, starts: NDArray[np.int64], pitch: Floats) -> Floats:
    """(pads, 8): `noise_moments` for scans in which no taxel reads 0, then the mean noise^2 times (pitch / 2)^2."""
    moments = np.empty((len(starts) - 1, 8))
    for pad in range(len(starts) - 1):
        moments[pad, :6] = noise_moments(noise, places, starts[pad], starts[pad + 1], noise)
        mean = moments[pad, 0] / (starts[pad + 1] - starts[pad])
        moments[pad, 6] = mean * (0.5 * pitch[pad, 0]) ** 2
        moments[pad, 7] = mean * (0.5 * pitch[pad, 1]) ** 2
    return moments


@kernel
def convolution_flow(
    t: Floats,
    pressure: Floats,
    noise: Floats,
    contact: Bools,
    complete: Bools,
    places: Floats,
    starts: NDArray[np.int64],
    gains: Floats,
    long_rows: NDArray[np.int64],
    moments: Floats,
    memory: Floats,
    rows: Floats,
) -> None:
    """Fill rows (scans, pads, COLUMNS), which come in as NaN.

    t: (scans,). pressure: (scans, taxels). noise: (taxels,). contact, complete: (scans, pads).
    places: (2, taxels). starts: (pads + 1,). gains: (pads, 2) along x, y. long_rows: (pads,), see `weighted_sums`.
    moments: (pads, 8).
    memory: (pads, 13), kept from block to block.
    The index needs two usable scans in a row, the slip vector three; a scan without contact, or with a missing
    loaded taxel, begins anew, so that nothing jumps at lift-off and re-contact.
    """
    for pad in range(len(starts) - 1):
        begin, end = starts[pad], starts[pad + 1]
        x, y = places[0, begin:end], places[1, begin:end]
        gain_x, gain_y = gains[pad, 0], gains[pad, 1]
        m = memory[pad]
        for scan in range(len(t)):
            if not (contact[scan, pad] and complete[scan, pad]):
                m[_RUN] = 0.0
                continue
            s, sx, sy, silent = weighted_sums(pressure[scan, begin:end], x, y, long_rows[pad])
            cx, cy = sx / s, sy / s  # contact means that s stands well above its noise
            # c = sum(p r) / sum(p), so dc/dp_i = (r_i - c) / s: first-order propagation of the taxels' noise.
            g = 1.0 / (s * s)
            g_x, g_y = gain_x * gain_x * g, gain_y * gain_y * g
            n = moments[pad]
            if silent:
                n = noise_moments(noise, places, begin, end, pressure[scan])
            # At least what one taxel half a pitch aside would do: clipped neighbours are quiet, not without noise.
            var_x = max(g_x * (n[3] - 2.0 * cx * n[1] + cx * cx * n[0]), g_x * moments[pad, 6])
            var_y = max(g_y * (n[4] - 2.0 * cy * n[2] + cy * cy * n[0]), g_y * moments[pad, 7])
            cov = gain_x * gain_y * g * (n[5] - cx * n[2] - cy * n[1] + cx * cy * n[0])
            cx, cy = gain_x * cx, gain_y * cy
            row = rows[scan, pad]
            row[LOAD] = s
            if m[_RUN] >= 1.0:
                row[X], row[Y] = 0.5 * (m[_LAST + 1] + cx), 0.5 * (m[_LAST + 2] + cy)
                row[VAR_X] = 0.25 * (m[_LAST + 3] + var_x)
                row[VAR_Y] = 0.25 * (m[_LAST + 4] + var_y)
                row[COV_XY] = 0.25 * (m[_LAST + 5] + cov)
                row[LAG] = 0.5 * (t[scan] - m[_LAST])
            if m[_RUN] >= 2.0:
                row[DX], row[DY] = 0.5 * (cx - m[_BEFORE + 1]), 0.5 * (cy - m[_BEFORE + 2])
                row[SPAN] = 0.5 * (t[scan] - m[_BEFORE])
                row[D_VAR_X] = 0.25 * (m[_BEFORE + 3] + var_x)
                row[D_VAR_Y] = 0.25 * (m[_BEFORE + 4] + var_y)
                row[D_COV_XY] = 0.25 * (m[_BEFORE + 5] + cov)
            for k in range(6):
                m[_BEFORE + k] = m[_LAST + k]
            m[_LAST], m[_LAST + 1], m[_LAST + 2] = t[scan], cx, cy
            m[_LAST + 3], m[_LAST + 4], m[_LAST + 5] = var_x, var_y, cov
            m[_RUN] = min(m[_RUN] + 1.0, 2.0)
