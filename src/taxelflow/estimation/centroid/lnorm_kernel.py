"""Method I at work: the largest taxel of each pad, and what noise can do to it."""

from __future__ import annotations

from math import erfc
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
    SPAN,
    VAR_X,
    VAR_Y,
    X,
    Y,
)
from taxelflow.messages import Bools, Floats

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Memory per pad: whether the last scan was usable, then t, x, y and var_x, var_y, cov_xy of a tie in the last scan.
_RUN, _LAST, MEMORY = 0, 1, 7

_OUT_OF_REACH = 6.0
"""A taxel so many standard deviations below the largest is not going to be it."""


@kernel
def peak_flow(
    t: Floats,
    pressure: Floats,
    noise: Floats,
    contact: Bools,
    complete: Bools,
    places: Floats,
    starts: NDArray[np.int64],
    gains: Floats,
    pitch: Floats,
    memory: Floats,
    rows: Floats,
) -> None:
    """Fill rows (scans, pads, COLUMNS), which come in as NaN.

    Arguments as for `flow.convolution_flow`; pitch: (pads, 2). Equal maxima: the first in scan order.
    Pose variance: that of a place unknown within its taxel (pitch^2 / 12), plus that of a tie, where each taxel
    weighs as much as it is likely to be the larger one. The displacement of a still object has the ties' only.
    """
    for pad in range(len(starts) - 1):
        begin, end = starts[pad], starts[pad + 1]
        gain_x, gain_y = gains[pad, 0], gains[pad, 1]
        m = memory[pad]
        for scan in range(len(t)):
            if not (contact[scan, pad] and complete[scan, pad]):
                m[_RUN] = 0.0
                continue
            best = -1
            for taxel in range(begin, end):
                p = pressure[scan, taxel]
                if noise[taxel] > 0.0 and (best < 0 or p > pressure[scan, best]):
                    best = taxel
            weight = var_x = var_y = cov = 0.0
            for taxel in range(begin, end):
                sd2 = noise[taxel] ** 2 + noise[best] ** 2
                behind = pressure[scan, best] - pressure[scan, taxel]
                if noise[taxel] > 0.0 and behind * behind < _OUT_OF_REACH**2 * sd2:
                    w = 0.5 * erfc(behind / np.sqrt(2.0 * sd2))
                    ex, ey = places[0, taxel] - places[0, best], places[1, taxel] - places[1, best]
                    weight += w
                    var_x += w * ex * ex
                    var_y += w * ey * ey
                    cov += w * ex * ey
            g_x, g_y = gain_x * gain_x, gain_y * gain_y
            var_x, var_y, cov = g_x * var_x / weight, g_y * var_y / weight, gain_x * gain_y * cov / weight
            x, y = gain_x * places[0, best], gain_y * places[1, best]
            row = rows[scan, pad]
            row[X], row[Y], row[LAG] = x, y, 0.0
            row[VAR_X] = var_x + g_x * pitch[pad, 0] ** 2 / 12.0
            row[VAR_Y] = var_y + g_y * pitch[pad, 1] ** 2 / 12.0
            row[COV_XY] = cov
            if m[_RUN] > 0.0:
                row[DX], row[DY] = x - m[_LAST + 1], y - m[_LAST + 2]
                row[SPAN] = t[scan] - m[_LAST]
                row[D_VAR_X], row[D_VAR_Y] = var_x + m[_LAST + 3], var_y + m[_LAST + 4]
                row[D_COV_XY] = cov + m[_LAST + 5]
            m[_LAST], m[_LAST + 1], m[_LAST + 2] = t[scan], x, y
            m[_LAST + 3], m[_LAST + 4], m[_LAST + 5] = var_x, var_y, cov
            m[_RUN] = 1.0
