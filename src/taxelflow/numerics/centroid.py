"""Centroid of a contact, by the readings that surely belong to it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taxelflow.runtime.compiling import kernel

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats

_LOADED_VARIANCES = 16.0
"""A reading belongs to the contact if its square exceeds this many times its variance: 4 standard deviations ..."""
_LOADED_SHARE = 0.05
"""... and if it exceeds this share of the largest."""


@kernel
def loaded_centroid(reading: Floats, variance: Floats, places: Floats, edge: Bools, out: Floats) -> None:
    """Fill out (4,): x and y of the centroid, the share of the load at the border, and the load; all 0 without load.

    reading, variance: (taxels,), variance 0 where masked. places: (2, taxels). edge: (taxels,), at the pad's border.
    """
    peak = 0.0
    for i in range(len(reading)):
        peak = max(peak, reading[i])
    total = x = y = border = 0.0
    for i in range(len(reading)):
        p = reading[i]
        if p > _LOADED_SHARE * peak and p * p > _LOADED_VARIANCES * variance[i] > 0.0:
            total += p
            x += p * places[0, i]
            y += p * places[1, i]
            border += p if edge[i] else 0.0
    out[:] = 0.0
    if total > 0.0:
        out[0], out[1], out[2], out[3] = x / total, y / total, border / total, total
