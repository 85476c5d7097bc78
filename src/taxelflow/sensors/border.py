"""Border contact and load of each pad, which depend on scan and layout only."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import Bools, Floats
from taxelflow.numerics.rounding import CERTAIN
from taxelflow.runtime.blocks import is_block
from taxelflow.runtime.compiling import kernel, routine

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Scans
    from taxelflow.sensors.layout import Layout


class Boundary:
    """The borders of a layout's pads. It has no memory: each scan is judged by itself."""

    def __init__(self, layout: Layout) -> None:
        self._starts = layout.starts
        self._edge = border_of(layout)

    def step(self, scans: Scans) -> tuple[Bools, Floats]:
        """Border flags (scans, pads, 2), which the contact reaches along x and y, and loads (scans, pads), Pa."""
        border = np.zeros((*scans.contact.shape, 2), dtype=np.bool_)
        load = np.empty(scans.contact.shape)
        mark = mark_border_block if is_block(len(scans), mark_border) else mark_border
        mark(scans.pressure, scans.noise, scans.contact, *self._edge, border)
        pad_load(scans.pressure, self._starts, load)
        return border, load


def border_of(layout: Layout) -> tuple[NDArray[np.int64], NDArray[np.int64], Bools]:
    """What `mark_border` needs of a layout: edge, edge_starts and faces."""
    edge = np.flatnonzero(layout.border.any(axis=1))
    return edge, np.searchsorted(edge, layout.starts), layout.border


def mark_border_block(
    pressure: Floats,
    noise: Floats,
    contact: Bools,
    edge: NDArray[np.int64],
    edge_starts: NDArray[np.int64],
    faces: Bools,
    at_border: Bools,
) -> None:
    """`mark_border` in NumPy."""
    limit = CERTAIN * noise[edge]
    loaded = (limit > 0.0) & (pressure[:, edge] > limit)
    for pad in range(len(edge_starts) - 1):
        own = slice(edge_starts[pad], edge_starts[pad + 1])
        for axis in range(2):
            at_border[:, pad, axis] = contact[:, pad] & loaded[:, own][:, faces[edge[own], axis]].any(axis=1)


@kernel
def mark_border(
    pressure: Floats,
    noise: Floats,
    contact: Bools,
    edge: NDArray[np.int64],
    edge_starts: NDArray[np.int64],
    faces: Bools,
    at_border: Bools,
) -> None:
    """Set at_border (scans, pads, 2) where a loaded taxel of a pad in contact lies at a border that faces x, y.

    pressure: (scans, taxels). noise: (taxels,). contact: (scans, pads). edge: taxels at a border, pad by pad;
    edge_starts: (pads + 1,) into edge. faces: (taxels, 2), `Layout.border`.
    """
    for scan in range(pressure.shape[0]):
        for pad in range(len(edge_starts) - 1):
            if contact[scan, pad]:
                own = edge[edge_starts[pad] : edge_starts[pad + 1]]
                _mark_pad(pressure[scan], noise, own, faces, at_border[scan, pad])


@routine
def _mark_pad(reading: Floats, noise: Floats, edge: NDArray[np.int64], faces: Bools, at_border: Bools) -> None:
    """Set at_border (2,) of a pad whose taxels at a border are `edge`."""
    for taxel in edge:
        if 0.0 < CERTAIN * noise[taxel] < reading[taxel]:
            at_border[0] |= faces[taxel, 0]
            at_border[1] |= faces[taxel, 1]
            if at_border[0] and at_border[1]:
                return


@kernel
def pad_load(pressure: Floats, starts: NDArray[np.int64], load: Floats) -> None:
    """Fill load (scans, pads) with the sum of the pad's readings. starts: (pads + 1,), `Layout.starts`."""
    for scan in range(pressure.shape[0]):
        for pad in range(len(starts) - 1):
            total = 0.0
            for k in range(starts[pad], starts[pad + 1]):
                total += pressure[scan, k]
            load[scan, pad] = total
