"""Moments of the taxels in contact: force, centroid, size and orientation of a contact.

With weights p_i, sum s and centroid c over the taxels above the threshold, M = sum p_i (r_i - c)(r_i - c)^T / s, plus
the second moment of an evenly loaded square taxel, area / 12 along each axis. The eigenvalues l1 >= l2 of M give the
full axes 4 sqrt(l) of the evenly filled ellipse with the same moments. The orientation is that of the first
eigenvector; its standard deviation is that of noise, to first order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np

from taxelflow.messages import Bools, Contacts, Floats, Scans, no_scans
from taxelflow.numerics.records import Records, unknown
from taxelflow.numerics.rounding import LINEAR_RAD, ROUNDING
from taxelflow.runtime.compiling import kernel, routine
from taxelflow.runtime.settled import Settled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.sensors.sensor import Sensor


class Features:
    """Features of one contact, see `Contacts`; force per Pa, so in N or in counts m^2. axis 1 is the longer one."""

    force: float
    force_std: float
    area: float
    peak: float
    centroid: Annotated[Floats, 2]
    axes: Annotated[Floats, 2]
    eccentricity: float
    orientation: float
    orientation_std: float


class FeatureExtractor:
    """Features scan by scan; nothing is remembered."""

    def __init__(self, sensor: Sensor, threshold: float) -> None:
        layout = sensor.layout
        self._threshold, self._starts = threshold, layout.starts
        self._xy = np.stack([layout.x_m, layout.y_m])
        self._area = layout.area_m2
        self._newton = 1.0 if sensor.si_unit == "Pa" else np.nan  # counts are no force
        self._extract = Settled(extract_features)
        self.step(no_scans(layout.entries, len(layout.pads)))  # compiles

    def step(self, scans: Scans) -> Contacts:
        """Features of all pads."""
        found = unknown(Features, *scans.contact.shape)
        block = scans.pressure, scans.noise, scans.contact & scans.complete
        self._extract(block, self._xy, self._area, self._starts, self._threshold, self._newton, found)
        return Contacts(
            t_s=scans.t_s,
            contact=scans.contact,
            force=found["force"],
            area=found["area"],
            peak=found["peak"],
            centroid=found["centroid"],
            axes=found["axes"],
            eccentricity=found["eccentricity"],
            orientation=found["orientation"],
            force_std=found["force_std"],
            orientation_std=found["orientation_std"],
        )


@kernel
def extract_features(
    block: tuple[Floats, Floats, Bools],
    xy: Floats,
    area: Floats,
    starts: NDArray[np.int64],
    threshold: float,
    newton: float,
    features: Records,
) -> None:
    """Fill features (scans, pads), which come in as NaN, where a pad is in contact and its scan complete.

    block: pressure (scans, entries), noise (entries,), and (scans, pads) where to fill. xy: (2, entries), m. area:
    (entries,). newton: factor on forces.
    """
    pressure, noise, filled = block
    for scan in range(pressure.shape[0]):
        for pad in range(len(starts) - 1):
            if filled[scan, pad]:
                own, found = slice(starts[pad], starts[pad + 1]), features[scan, pad]
                _extract(pressure[scan, own], noise[own], xy[0, own], xy[1, own], area[own], threshold, found)
                found.force *= newton
                found.force_std *= newton


@routine
def _extract(
    p: Floats, noise: Floats, x: Floats, y: Floats, area: Floats, threshold: float, features: Features
) -> None:
    """Features of one contact from the readings p of its pad."""
    s = sx = sy = sxx = syy = sxy = extent = force = force_var = covered = peak = 0.0
    x0, y0 = x[0], y[0]
    for k in range(len(p)):
        force += p[k] * area[k]  # below the threshold too: noise averages out, a light edge does not
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
    features.force, features.force_std = force, np.sqrt(force_var)
    features.area, features.peak = covered, peak
    if s <= 0.0:
        return
    cx, cy = sx / s, sy / s
    features.centroid[0], features.centroid[1] = x0 + cx, y0 + cy
    xx, yy, xy = max(sxx / s - cx * cx, 0.0), max(syy / s - cy * cy, 0.0), sxy / s - cx * cy
    half, apart = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    large, small = half + apart + extent / s, max(half - apart, 0.0) + extent / s
    features.axes[0], features.axes[1] = 4.0 * np.sqrt(large), 4.0 * np.sqrt(small)
    rounding = ROUNDING * large
    if apart <= rounding:
        features.eccentricity = 0.0
        return
    features.eccentricity = np.sqrt(1.0 - small / large)
    if half - apart <= rounding:  # taxels in a line show its orientation, not that of the object
        return
    xy = xy if abs(xy) > rounding else 0.0
    u, v, variance = xx - yy, 2.0 * xy, 0.0
    for k in range(len(p)):
        if p[k] > threshold * noise[k]:
            dx, dy = x[k] - x0 - cx, y[k] - y0 - cy
            slope = 0.5 * (u * (2.0 * dx * dy - v) - v * (dx * dx - dy * dy - u)) / (s * (u * u + v * v))
            variance += (noise[k] * slope) ** 2
    if variance <= LINEAR_RAD**2:
        features.orientation, features.orientation_std = 0.5 * np.arctan2(v, u), np.sqrt(variance)
