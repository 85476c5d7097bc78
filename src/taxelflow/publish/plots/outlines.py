"""Outlines of taxels: rectangles in a grid; of a table's taxels hexagons where they fill a hexagonal grid, or discs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.geometry import transform
from taxelflow.publish.plots.sizes import TAXELS
from taxelflow.sensors import triangulation as mesh

if TYPE_CHECKING:
    from collections.abc import Iterable

    from taxelflow.messages import Floats
    from taxelflow.publish.plots.marks import Box
    from taxelflow.sensors.layout import Layout


def outlines(layout: Layout, pad: int) -> Floats:
    """(taxels, corners, 2), m, in the frame of the pad. A disc has the taxel's area, if its neighbours leave room."""
    own = layout.of_pad(pad)
    xy = np.stack([layout.x_m[own], layout.y_m[own]], axis=1)
    if not layout.tables[pad]:
        square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * TAXELS.half_side * layout.pitch_m[pad]
        squares: Floats = xy[:, np.newaxis] + square
        return squares
    nearest = mesh.nearest_m(xy)
    turn = _hexagon_turn(layout, pad, xy, nearest)
    if turn is None:
        radius = np.minimum(np.sqrt(layout.area_m2[own] / np.pi), 0.49 * nearest)
        angles = np.linspace(0.0, 2 * np.pi, TAXELS.corners, endpoint=False)
    else:
        radius = 2 * TAXELS.half_side * nearest / np.sqrt(3.0)
        angles = turn + np.pi * (np.arange(6) / 3 + 1 / 6)
    shape = radius[:, np.newaxis, np.newaxis] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    found: Floats = xy[:, np.newaxis] + shape
    return found


def _hexagon_turn(layout: Layout, pad: int, xy: Floats, nearest: Floats) -> float | None:
    """Direction of neighbours, rad, where a table's taxels (taxels, 2) are the cells of a hexagonal grid: each has the
    cell's area, and neighbours lie in directions 60 deg apart.
    """
    own = layout.of_pad(pad)
    cell = np.sqrt(0.75) * nearest**2
    if len(xy) < 3 or not (np.abs(layout.area_m2[own] - cell) < TAXELS.alike * cell).all():
        return None
    pairs = layout.neighbours(pad)
    vectors = (xy[pairs[:, 1]] - xy[pairs[:, 0]]) @ np.array([1.0, 1.0j])
    if not len(vectors):
        return None
    mean = complex(np.mean((vectors / np.abs(vectors)) ** 6))
    return float(np.angle(mean)) / 6 if abs(mean) > 1 - TAXELS.alike else None


def on_hand_mm(layout: Layout, pad: int) -> Floats:
    """(taxels, corners, 2), outlines of a pad's taxels on the hand laid flat, mm."""
    return 1e3 * transform(layout.T_hand[pad], outlines(layout, pad))


def box_mm(layout: Layout, pads: Iterable[int] | None = None) -> Box:
    """Of these pads on the hand laid flat, or of all that have a place there, with a margin."""
    placed = np.flatnonzero(np.isfinite(layout.T_hand[: layout.pad_count]).all(axis=1)).tolist()
    corners = np.concatenate([on_hand_mm(layout, pad).reshape(-1, 2) for pad in (placed if pads is None else pads)])
    (left, low), (right, high) = corners.min(axis=0), corners.max(axis=0)
    margin = 0.1 * max(right - left, high - low)
    return float(left - margin), float(right + margin), float(low - margin), float(high + margin)


def extent_mm(layout: Layout, pad: int) -> Box:
    """Of the pad with its taxels, in its own frame."""
    own = layout.of_pad(pad)
    x, y = 1e3 * layout.x_m[own], 1e3 * layout.y_m[own]
    wide, high = 0.55 * 1e3 * layout.pitch_m[pad]
    return float(x.min() - wide), float(x.max() + wide), float(y.min() - high), float(y.max() + high)
