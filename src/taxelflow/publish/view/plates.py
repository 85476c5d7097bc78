"""The plate under each plane pad: where it stands and how large it is."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.publish.view import shapes

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.publish.view.placement import Placement
    from taxelflow.sensors.layout import Layout

_PLANE = 1e-3
"""Largest difference of the unit normals of a plane pad."""
_RIM, _THICK = 1.35, 0.18
"""Of a plate beyond the middles of the outer taxels, and its thickness, in pitches."""


class Plates(NamedTuple):
    """One per pad, of size 0 for a curved or irregular one. positions, scales: (pads, 3), m. wxyzs: (pads, 4)."""

    positions: Floats
    scales: Floats
    wxyzs: Floats


def plates_of(layout: Layout, placement: Placement) -> Plates:
    """The plates under the pads as they are placed."""
    count = layout.pad_count
    positions, scales = np.zeros((count, 3)), np.full((count, 3), shapes.NONE)
    normals, axes = np.tile((0.0, 0.0, 1.0), (count, 1)), np.tile((1.0, 0.0, 0.0), (count, 1))
    for pad in range(count):
        own = layout.of_pad(pad)
        normal, place = placement.normal[own], placement.place[own]
        irregular = placement.spatial and bool(layout.tables[pad])  # a rectangle would lie under its neighbours
        if irregular or np.abs(normal - normal[0]).max() > _PLANE:
            continue
        pitch = float(np.median(layout.pitch_m[pad]))
        across = placement.tangent[own.start][:, 0]
        across = across - (across @ normal[0]) * normal[0]
        across /= np.linalg.norm(across)
        frame = np.stack([across, np.cross(normal[0], across), normal[0]], axis=1)
        inside = place @ frame
        low, high = inside.min(axis=0), inside.max(axis=0)
        middle = (low + high) / 2 - (0.0, 0.0, (_THICK + 0.02) * pitch)
        positions[pad] = frame @ middle
        scales[pad, :2], scales[pad, 2] = (high - low)[:2] + _RIM * layout.pitch_m[pad], _THICK * pitch
        normals[pad], axes[pad] = normal[0], across
    return Plates(positions, scales, shapes.along(normals, axes))
