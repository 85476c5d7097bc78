"""Covariance of a position by errors of the skin that noise does not show: gains, cells between taxels, tilt.

A method without a model of the skin reports the covariance by noise only. On a sensor with an `unseen_error` the error
is several times as large. The position of every method follows the load. So the covariance of the centre of pressure by
these errors is added, see `numerics.centroid`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import no_scans
from taxelflow.numerics.centroid import CELL_ERROR, centroid_covariance, pressure_centre
from taxelflow.runtime.compiling import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats, Scans
    from taxelflow.sensors.layout import Layout


class UnseenError:
    """Unseen error of positions on a layout's pads, scan by scan, without memory."""

    def __init__(self, layout: Layout, gains: Floats | None = None) -> None:
        """gains: (pads, 2), factors on positions along x and y; 1 if left out."""
        count = len(layout.pads)
        factors = np.concatenate([np.ones((count, 2)) if gains is None else gains, np.ones((count, 1))], axis=1)
        self._scale = factors[:, :, np.newaxis] * factors[:, np.newaxis, :]
        self._starts, self._tilt = layout.starts, layout.unseen_error
        self._pitch_m = layout.pitch_m.min(axis=1)
        self._places = np.stack([layout.x_m, layout.y_m]) / np.repeat(self._pitch_m, np.diff(layout.starts))
        self.of(no_scans(layout.entries, len(layout.pads)))  # compiles the kernel

    def of(self, scans: Scans) -> Floats:
        """(scans, pads, 3, 3), covariance of the position, m^2; 0 without contact, and for the rotation."""
        found = np.zeros((*scans.contact.shape, 3, 3))
        arrays = scans.pressure, scans.noise, scans.ceiling, scans.contact
        find_unseen(arrays, self._starts, self._places, self._pitch_m, self._tilt, found)
        found *= self._scale
        return found


@kernel
def find_unseen(
    scans: tuple[Floats, Floats, Floats, Bools],
    starts: NDArray[np.int64],
    places: Floats,
    pitch_m: Floats,
    tilt: float,
    out: Floats,
) -> None:
    """Fill out (scans, pads, 3, 3), which comes in as 0, with the covariance of the centre of pressure, m^2.

    scans: pressure (scans, taxels), noise and ceiling (taxels,), contact (scans, pads). starts: (pads + 1,),
    `Layout.starts`. places: (2, taxels), in pitches. pitch_m: (pads,). tilt: `Layout.unseen_error`.
    """
    pressure, noise, ceiling, contact = scans
    most_taxels = 0
    for pad in range(len(pitch_m)):
        most_taxels = max(most_taxels, starts[pad + 1] - starts[pad])
    edges = np.zeros(most_taxels, np.bool_)
    middle, found = np.empty(5), np.empty(9)
    for pad in range(len(pitch_m)):
        first, count = starts[pad], starts[pad + 1] - starts[pad]
        own, variance, edge = np.empty((2, count)), np.empty(count), edges[:count]
        for i in range(count):
            own[0, i], own[1, i] = places[0, first + i], places[1, first + i]
            variance[i] = noise[first + i] * noise[first + i]
        most = ceiling[first : first + count]
        square = pitch_m[pad] * pitch_m[pad]
        for k in range(len(pressure)):
            if contact[k, pad]:
                reading = pressure[k, first : first + count]
                pressure_centre(reading, variance, own, edge, middle)
                centroid_covariance(reading, variance, most, own, middle, CELL_ERROR, tilt, found)
                out[k, pad, 0, 0], out[k, pad, 1, 1] = square * found[0], square * found[2]
                out[k, pad, 0, 1] = out[k, pad, 1, 0] = square * found[1]
