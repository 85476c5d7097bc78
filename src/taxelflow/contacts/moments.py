"""Zeroth, first and second moments of the taxels in contact, and what they say of its size and shape.

With weights p_i, sum s and centroid c over the taxels above the threshold, M = sum p_i (r_i - c)(r_i - c)^T / s, plus
what the extent of a taxel adds, a square of its area evenly loaded: a_i / 12 along each axis. The eigenvalues
l1 >= l2 of M give the full axes of the ellipse that, evenly filled, has the same moments: 4 sqrt(l). The orientation is
that of the first eigenvector; its standard deviation is what noise does to it, to first order (as `estimation.axis`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.messages import Bools, Contacts, Floats, Scans, no_scans

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.contacts.features import ContactFeatures
    from taxelflow.sensors.sensor import Sensor

FORCE, AREA, PEAK, X, Y, MAJOR, MINOR, ECCENTRICITY, ORIENTATION, STD_FORCE, STD_ORIENTATION, COLUMNS = range(12)
_ROUND = 1e-9
"""Rounding makes a round contact no rounder than this."""
_MOST_STD_RAD = 0.5
"""An axis less certain than this is none."""


class ShapeSession:
    """Features scan by scan; nothing is remembered."""

    def __init__(self, parameters: ContactFeatures, sensor: Sensor) -> None:
        layout = sensor.layout
        self._threshold, self._starts = parameters.threshold, layout.starts
        self._places = np.stack([layout.x_m, layout.y_m])
        self._area = layout.area_m2
        self._newton = 1.0 if sensor.si_unit == "Pa" else np.nan  # counts are no force
        self.step(no_scans(layout.entries, len(layout.pads)))  # compiles

    def step(self, scans: Scans) -> Contacts:
        """Features of all pads."""
        rows = np.full((*scans.contact.shape, COLUMNS), np.nan)
        describe(
            scans.pressure,
            scans.noise,
            scans.contact,
            scans.complete,
            self._places,
            self._area,
            self._starts,
            self._threshold,
            rows,
        )
        return Contacts(
            t_s=scans.t_s,
            contact=scans.contact,
            force=self._newton * rows[..., FORCE],
            area=rows[..., AREA],
            peak=rows[..., PEAK],
            centroid=rows[..., X : Y + 1],
            axes=rows[..., MAJOR : MINOR + 1],
            eccentricity=rows[..., ECCENTRICITY],
            orientation=rows[..., ORIENTATION],
            force_std=self._newton * rows[..., STD_FORCE],
            orientation_std=rows[..., STD_ORIENTATION],
        )


@kernel
def describe(
    pressure: Floats,
    noise: Floats,
    contact: Bools,
    complete: Bools,
    places: Floats,
    area: Floats,
    starts: NDArray[np.int64],
    threshold: float,
    rows: Floats,
) -> None:
    """Fill rows (scans, pads, COLUMNS), which come in as NaN, where a pad is in contact and its scan complete.

    pressure: (scans, entries). noise, area: (entries,). contact, complete: (scans, pads). places: (2, entries).
    """
    for scan in range(pressure.shape[0]):
        for pad in range(len(starts) - 1):
            if contact[scan, pad] and complete[scan, pad]:
                own = slice(starts[pad], starts[pad + 1])
                _describe_pad(
                    pressure[scan, own],
                    noise[own],
                    places[0, own],
                    places[1, own],
                    area[own],
                    threshold,
                    rows[scan, pad],
                )


@kernel
def _describe_pad(p: Floats, noise: Floats, x: Floats, y: Floats, area: Floats, threshold: float, row: Floats) -> None:
    s = sx = sy = sxx = syy = sxy = extent = force = force_var = covered = peak = 0.0
    x0, y0 = x[0], y[0]
    for k in range(len(p)):
        force += p[k] * area[k]  # below the threshold too: noise sums to nothing, a light edge does not
        force_var += (noise[k] * area[k]) ** 2 if p[k] != 0.0 else 0.0
        if p[k] > threshold * noise[k]:
            dx, dy = x[k] - x0, y[k] - y0
            s += p[k]
            sx += p[k] * dx
            sy += p[k] * dy
            sxx += p[k] * dx * dx
            syy += p[k] * dy * dy
            sxy += p[k] * dx * dy
            extent += p[k] * area[k] / 12.0
            covered += area[k]
            peak = max(peak, p[k])
    row[FORCE], row[STD_FORCE], row[AREA], row[PEAK] = force, np.sqrt(force_var), covered, peak
    if s <= 0.0:
        return
    cx, cy = sx / s, sy / s
    row[X], row[Y] = x0 + cx, y0 + cy
    xx, yy, xy = max(sxx / s - cx * cx, 0.0), max(syy / s - cy * cy, 0.0), sxy / s - cx * cy
    half, apart = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    large, small = half + apart + extent / s, max(half - apart, 0.0) + extent / s
    row[MAJOR], row[MINOR] = 4.0 * np.sqrt(large), 4.0 * np.sqrt(small)
    row[ECCENTRICITY] = np.sqrt(1.0 - small / large)
    if apart <= _ROUND * large:
        return
    u, v, variance = xx - yy, 2.0 * xy, 0.0
    for k in range(len(p)):
        if p[k] > threshold * noise[k]:
            dx, dy = x[k] - x0 - cx, y[k] - y0 - cy
            slope = 0.5 * (u * (2.0 * dx * dy - v) - v * (dx * dx - dy * dy - u)) / (s * (u * u + v * v))
            variance += (noise[k] * slope) ** 2
    if variance <= _MOST_STD_RAD**2:
        row[ORIENTATION], row[STD_ORIENTATION] = 0.5 * np.arctan2(v, u), np.sqrt(variance)
