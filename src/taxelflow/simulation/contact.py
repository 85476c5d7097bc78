"""Pressure of a contact, averaged over the sensitive area of each taxel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.simulation.load import State
    from taxelflow.simulation.pattern import Pattern

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)


def taxel_pressure(
    pattern: Pattern, pose: Floats, state: State, x_m: Floats, y_m: Floats, size_m: tuple[float, float]
) -> Floats:
    """Mean pressure (scans, taxels) over rectangles of size_m around (x_m, y_m), each (taxels,).

    pose: (scans, taxels, 3) in the pad's frame, and state (scans, taxels), each taxel's at the time when it is read;
    (scans, 1, 3) and (scans, 1) where all are read at once. Gauss-Legendre quadrature with 6 x 6 points a taxel.
    """
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    total = np.zeros((len(pose), len(x_m)))
    for node_x, weight_x in zip(_NODES, _WEIGHTS, strict=True):
        dx = x_m + node_x * size_m[0] / 2 - pose[..., 0]
        for node_y, weight_y in zip(_NODES, _WEIGHTS, strict=True):
            dy = y_m + node_y * size_m[1] / 2 - pose[..., 1]
            total += weight_x * weight_y / 4 * pattern(cos * dx + sin * dy, cos * dy - sin * dx, state)
    return total
