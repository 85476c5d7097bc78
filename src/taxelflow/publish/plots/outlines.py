"""Outlines of taxels: rectangles in a grid, discs of a table's taxels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.sensors import triangulation as mesh

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.sensors.layout import Layout

_SHARE = 0.45
_CORNERS = 24


def outlines(layout: Layout, pad: int) -> Floats:
    """(taxels, corners, 2), m, in the frame of the pad. A disc has the taxel's area, if its neighbours leave room."""
    own = layout.of_pad(pad)
    xy = np.stack([layout.x_m[own], layout.y_m[own]], axis=1)
    if not layout.tables[pad]:
        shape = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * _SHARE * layout.pitch_m[pad]
        squares: Floats = xy[:, np.newaxis] + shape
        return squares
    radius = np.minimum(np.sqrt(layout.area_m2[own] / np.pi), 0.49 * mesh.nearest_m(xy))
    turn = np.linspace(0.0, 2 * np.pi, _CORNERS, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    discs: Floats = xy[:, np.newaxis] + radius[:, np.newaxis, np.newaxis] * circle
    return discs


def extent_mm(layout: Layout, pad: int) -> tuple[float, float, float, float]:
    """left, right, low, high of the pad with its taxels, in its own frame."""
    own = layout.of_pad(pad)
    x, y = 1e3 * layout.x_m[own], 1e3 * layout.y_m[own]
    wide, high = 0.55 * 1e3 * layout.pitch_m[pad]
    return float(x.min() - wide), float(x.max() + wide), float(y.min() - high), float(y.max() + high)
