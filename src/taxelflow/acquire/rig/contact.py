"""Pressure of a contact, averaged over the sensitive area of each taxel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from taxelflow.acquire.rig.scenario import Contact
    from taxelflow.messages import Floats

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
_SUPER_GAUSSIAN = 2
"""Order of the airbag: exp(-r^4), flat in the middle, soft at the edge."""


def pressure_at(contact: Contact, along: Floats, across: Floats) -> Floats:
    """Pressure in Pa at points in the object's frame (long axis first), any shape of arrays, in m."""
    length = contact.radius_m * (contact.aspect if contact.shape == "elongated" else 1.0)
    r2 = (along / length) ** 2 + (across / contact.radius_m) ** 2
    if contact.shape == "hertz":
        dome: Floats = contact.peak_pa * np.sqrt(np.clip(1.0 - r2, 0.0, None))
        return dome
    bag: Floats = contact.peak_pa * np.exp(-(r2**_SUPER_GAUSSIAN))
    return bag


def taxel_pressure(contact: Contact, pose: Floats, x_m: Floats, y_m: Floats, size_m: tuple[float, float]) -> Floats:
    """Mean pressure (scans, taxels) over rectangles of size_m around (x_m, y_m), for poses (scans, 3).

    Gauss-Legendre quadrature with 6 x 6 points a taxel.
    """
    cos, sin = np.cos(pose[:, 2, np.newaxis]), np.sin(pose[:, 2, np.newaxis])
    total = np.zeros((len(pose), len(x_m)))
    for node_x, weight_x in zip(_NODES, _WEIGHTS, strict=True):
        dx = x_m + node_x * size_m[0] / 2 - pose[:, 0, np.newaxis]
        for node_y, weight_y in zip(_NODES, _WEIGHTS, strict=True):
            dy = y_m + node_y * size_m[1] / 2 - pose[:, 1, np.newaxis]
            total += weight_x * weight_y / 4 * pressure_at(contact, cos * dx + sin * dy, cos * dy - sin * dx)
    return total
