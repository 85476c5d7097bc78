"""Mean pressure of a contact over the sensitive area of each taxel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.simulation.load import State
    from taxelflow.simulation.pattern import Pattern

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
"""Nodes and weights of Gauss-Legendre quadrature on [-1, 1], used along each axis of a taxel."""


def taxel_pressure(
    pattern: Pattern, pose: Floats, state: State, x_m: Floats, y_m: Floats, size_m: tuple[float, float]
) -> Floats:
    """Mean pressure (scans, taxels) in Pa over rectangles of size_m centred at x_m, y_m (taxels,), in the pad's frame.

    pose: (scans, taxels, 3) of the object in the pad's frame, and state (scans, taxels), each at the time at which the
    taxel is read; (scans, 1, 3) and (scans, 1) where all taxels are read at once.
    """
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    total = np.zeros((len(pose), len(x_m)))
    for node_x, weight_x in zip(_NODES, _WEIGHTS, strict=True):
        dx = x_m + node_x * size_m[0] / 2 - pose[..., 0]
        for node_y, weight_y in zip(_NODES, _WEIGHTS, strict=True):
            dy = y_m + node_y * size_m[1] / 2 - pose[..., 1]
            total += weight_x * weight_y / 4 * pattern(cos * dx + sin * dy, cos * dy - sin * dx, state)
    return total
