"""Shear of three-axis taxels, filtered like pressure, less the mean of the idle scans so far, by entry of the layout.

Its zero is arbitrary and drifts with temperature and posture, so a pad's offset follows its idle scans, and is kept
while it is in contact. A pad that has not been idle keeps its numbers as they are: only changes have a meaning then.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.geometry import rotation

if TYPE_CHECKING:
    from taxelflow.condition.filters import Filters
    from taxelflow.messages import Bools, Floats
    from taxelflow.sensors.layout import Indices, Layout
    from taxelflow.sensors.sensor import Sensor


class ShearTare:
    """Tares shear scan by scan; the result does not depend on how the scans are cut into blocks.

    filters: of twice as many channels as taxels, or None.
    """

    def __init__(self, sensor: Sensor, *, tared: bool) -> None:
        """tared: False leaves the offset in."""
        layout = sensor.layout
        self.filters: Filters | None = None
        self._tared, self._source = tared, layout.source
        self._pad = np.repeat(np.arange(layout.pad_count), np.diff(layout.starts[: layout.pad_count + 1]))
        self._axes = _axes(layout, self._pad)
        self._sum, self._scans = np.zeros((1, layout.taxels, 2)), np.zeros((1, layout.taxels))

    def step(self, shear: Floats, gap: Bools, contact: Bools, noise: Floats) -> Floats:
        """(scans, entries, 2), in the frame of each entry's pad or group.

        shear: (scans, taxels, 2), in the pads' frames, NaN where missing. gap: (scans,). contact: (scans, pads). noise:
        (entries,), 0 where a taxel is masked.
        """
        if self.filters is not None:
            flat = np.ascontiguousarray(shear.reshape(len(shear), 2 * shear.shape[1]))
            shear = self.filters.step(flat, gap, np.zeros(flat.shape[1])).reshape(shear.shape)
        known: Bools = np.isfinite(shear)
        tared: Floats = np.where(known, shear, 0.0)
        if self._tared:
            tared = known * (tared - self._offset(tared, known[..., 0] & known[..., 1], contact))
        found = np.take(tared, self._source, axis=1)
        if self._axes is not None:
            found = np.einsum("eij,nej->nei", self._axes, found)
        found[:, noise == 0.0] = 0.0
        return found

    def _offset(self, shear: Floats, known: Bools, contact: Bools) -> Floats:
        """(scans, taxels, 2), mean of the idle scans up to each one; 0 before the first."""
        idle = ~contact[:, self._pad] & known
        total = np.cumsum(np.concatenate([self._sum, shear * idle[..., np.newaxis]]), axis=0)
        scans = np.cumsum(np.concatenate([self._scans, idle]), axis=0)
        self._sum, self._scans = total[-1:], scans[-1:]
        mean: Floats = total[1:] / np.maximum(scans[1:], 1.0)[..., np.newaxis]
        return mean


def _axes(layout: Layout, pad: Indices) -> Floats | None:
    """(entries, 2, 2), from the frame of an entry's taxel to that of its group; None where they are the same."""
    owner = np.repeat(np.arange(len(layout.pads)), np.diff(layout.starts))
    turn = layout.T_hand[pad[layout.source], 2] - layout.T_hand[owner, 2]
    if not turn.any():
        return None
    return rotation(turn)
