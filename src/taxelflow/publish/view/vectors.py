"""Slip vectors in the scene: where they start, which way they point, and whether they are known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import LOST, NO_POSE
from taxelflow.numerics.rounding import SIGNIFICANT

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats
    from taxelflow.publish.view.history import Results
    from taxelflow.publish.view.placement import Placement
    from taxelflow.sensors.layout import Layout


@dataclass(frozen=True, slots=True, eq=False)
class Vectors:
    """Of pads, groups and contacts, in the scene. start, velocity: (pads, 3), m and m/s; NaN where none is drawn.

    normal: (pads, 3), out of the skin at the start. touched: (pads,).
    """

    start: Floats
    velocity: Floats
    normal: Floats
    touched: Bools


class Field:
    """Finds the slip vectors of each scan. placement: may be replaced when the pads move."""

    def __init__(self, layout: Layout, placement: Placement) -> None:
        self._layout, self.placement = layout, placement
        split = np.isin(np.arange(len(layout.pads)), layout.contact_of)
        self._own = (layout.independent & ~split) | (layout.contact_of >= 0)
        homes = np.searchsorted(layout.starts[: layout.pad_count + 1], layout.source, side="right") - 1
        self._across = np.array(
            [len(np.unique(homes[layout.of_pad(pad)])) > 1 for pad in range(len(layout.pads))], dtype=np.bool_
        )
        self._own &= placement.flat | ~self._across

    def vectors(self, pressure: Floats, results: Results | None) -> Vectors:
        """Of one scan. pressure: (taxels,)."""
        layout, place = self._layout, self.placement
        count = len(layout.pads)
        start, velocity = np.full((2, count, 3), np.nan)
        normal, touched = np.tile((0.0, 0.0, 1.0), (count, 1)), np.zeros(count, dtype=np.bool_)
        if results is None:
            return Vectors(start, velocity, normal, touched)
        slips, speeds = results.slips, results.slips.velocity[0]
        variance = slips.displacement_covariance[0, :, 0, 0] + slips.displacement_covariance[0, :, 1, 1]
        for pad in np.flatnonzero(self._own & slips.contact[0]):
            own = layout.of_pad(int(pad))
            source = layout.source[own]
            weight = np.maximum(pressure[source], 0.0)
            if not weight.sum() > 0:
                continue
            touched[pad] = True
            here = weight @ np.stack([layout.x_m[own], layout.y_m[own]], axis=1) / weight.sum()
            nearest = int(np.argmin(np.hypot(layout.x_m[own] - here[0], layout.y_m[own] - here[1])))
            tangent = np.eye(3, 2) if self._across[pad] else place.tangent[source[nearest]]
            off = here - (layout.x_m[own][nearest], layout.y_m[own][nearest])
            start[pad] = place.place[source[nearest]] + tangent @ off
            normal[pad] = place.normal[source[nearest]]
            flat = _at(here, slips.pose[0, pad], speeds[pad])
            known = slips.quality[0, pad] not in (NO_POSE, LOST) and np.isfinite(flat).all()
            with np.errstate(invalid="ignore"):
                spread = np.sqrt(variance[pad]) / slips.span_s[0, pad]
            clear = results.slipping[0, pad] or np.hypot(*flat) > SIGNIFICANT * spread
            if known and clear:
                velocity[pad] = tangent @ flat
        return Vectors(start, velocity, normal, touched)


def _at(here: Floats, pose: Floats, velocity: Floats) -> Floats:
    """Velocity (2,) of the object's point at a place of the pad, from that at its pose and the rate of turn."""
    turn = velocity[2] if np.isfinite(velocity[2]) and np.isfinite(pose[:2]).all() else 0.0
    arm = np.nan_to_num(here - pose[:2])
    point: Floats = velocity[:2] + turn * np.array([-arm[1], arm[0]])
    return point
