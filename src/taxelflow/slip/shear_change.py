"""Spread of the change of shear over a contact, of three-axis taxels: a second witness of slip beside the pattern.

An object that is pulled while it sticks changes the shear of all taxels in proportion to their pressure p. Where it
slides, the skin under it lets go taxel by taxel, and a twist of the object adds a torsion. With ds the change of shear,

    e = ds - p sum(ds) / sum(p),

the spread is the norm of e over that of the pressure. It is the same in any frame of the pad. Total shear is left out:
it shows how the object is pulled, not whether it slides.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats, Scans
    from taxelflow.sensors.layout import Indices, Layout


class ShearNoise:
    """Variance of a number of shear on each pad, learned from steps between consecutive idle scans."""

    def __init__(self, layout: Layout) -> None:
        pads = np.arange(len(layout.pads))
        self._home = np.where(layout.contact_of >= 0, layout.contact_of, pads)  # a contact reads its pad's taxels
        self._starts, self._numbers = layout.starts[:-1], 2 * np.diff(layout.starts)
        self._last: tuple[Floats, Bools] | None = None
        self._sums = np.zeros((1, 2, len(pads)))

    def step(self, scans: Scans, shear: Floats) -> Floats:
        """(scans, pads), from the scans up to each; 0 before there are two idle ones. shear: (scans, entries, 2)."""
        idle = (~scans.contact & scans.complete)[:, self._home]
        before = (shear[:1], np.zeros_like(idle[:1])) if self._last is None else self._last
        self._last = shear[-1:], idle[-1:]
        still = idle & np.concatenate([before[1], idle[:-1]])
        squared = (np.diff(shear, axis=0, prepend=before[0]) ** 2).sum(axis=2)
        power = np.add.reduceat(squared, self._starts, axis=1)[:, self._home]
        counted = np.stack([power * still, 2.0 * still * np.maximum(self._numbers, 1)], axis=1)
        sums = np.cumsum(np.concatenate([self._sums, counted]), axis=0)
        self._sums = sums[-1:]
        variance: Floats = sums[1:, 0] / np.maximum(sums[1:, 1], 1.0)
        return variance


def spread(pressure: tuple[Floats, Floats], shear: tuple[Floats, Floats], starts: Indices) -> tuple[Floats, Floats]:
    """(pads,), power of the change of shear that is not in proportion to the pressure, over that of the pressure; and
    what one unit of variance of a change adds to it. NaN where the shear does not change at all, and of a single loaded
    taxel, whose shear is always in proportion.

    pressure: (entries,), old and new. shear: (entries, 2), old and new. starts: (pads,), first entry of each.
    """
    new, live = pressure[1], (pressure[0] != 0) | (pressure[1] != 0)
    change = (shear[1] - shear[0]) * live[:, np.newaxis]
    load = np.maximum(new, 0.0)
    columns = [change[:, 0], change[:, 1], (change**2).sum(axis=1), load * change[:, 0], load * change[:, 1]]
    sums = np.add.reduceat(np.stack([*columns, load, load**2, new**2, live]), starts, axis=1)
    total, power, along, loads, squares = sums[:2], sums[2], sums[3:5], sums[5], sums[6]
    rest = power - 2 * (total * along).sum(axis=0) / loads + (total**2).sum(axis=0) * squares / loads**2
    spreads = (power > 0) & (sums[8] > 1)
    return np.where(spreads, np.maximum(rest, 0.0), np.nan) / sums[7], 2 * sums[8] / sums[7]
