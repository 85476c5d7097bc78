"""Motion of an object that a pad's border hides from its centre of pressure.

Pressure p leaves a pad through its border, or comes onto it, as the object moves by dx. By the transport theorem, the
centre c of what is left moves by

    dc = (1 - H) dx,    H = 1 / F sum_i p_i sum_n (r_i + n / 2 - c) n^T,

with the load F, taxels at r_i (pitches), and the outward normals n of those of their sides that have no neighbour. H is
0 for an object that lies on the pad; 1 along a rod that reaches across it, and for a plate that covers it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.near_pairs import near_pairs
from taxelflow.numerics.rounding import REACH
from taxelflow.runtime.compiling import kernel

if TYPE_CHECKING:
    from taxelflow.messages import Floats

HIDDEN = 0.5
"""Least share of a motion that a centre of pressure must follow to be evidence of it."""
IN_LINE = 0.3
"""Offset along an axis, in pitches, up to which taxels lie in one line across it; those that jut out show little."""


def open_sides(places: Floats) -> Floats:
    """(4, taxels), 1 where a taxel has no neighbour to the left, to the right, below and above, else 0.

    places: (2, taxels), in pitches.
    """
    first, _, apart = near_pairs(places, REACH.second_ring)
    slope, sides = np.where(np.hypot(*apart) < REACH.neighbour, 1.0, REACH.second_slope), np.ones((4, places.shape[1]))
    for side, (axis, sign) in enumerate([(0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)]):
        on, beside = sign * apart[axis], np.abs(apart[1 - axis])
        sides[side, first[(on > IN_LINE) & (slope * on > beside - 1e-9)]] = 0.0
    return sides


@kernel
def find_hidden(reading: Floats, variance: Floats, places: Floats, sides: Floats, middle: Floats, out: Floats) -> None:
    """Fill out (4,) with H of a scan, row by row: 0 without load, scaled to no more than 1.

    reading, variance: (taxels,), variance 0 where masked. places: (2, taxels) in pitches. sides: (4, taxels), see
    `open_sides`. middle: (5,), from `pressure_centre`.
    """
    xx = xy = yx = yy = 0.0
    for i in range(len(reading)):
        x, y = places[0, i] - middle[0], places[1, i] - middle[1]
        if variance[i] > 0.0 and x * x + y * y <= middle[4]:
            p = max(reading[i], 0.0)
            left, right, below, above = sides[0, i], sides[1, i], sides[2, i], sides[3, i]
            xx += p * (right * (x + 0.5) - left * (x - 0.5))
            yx += p * (right - left) * y
            xy += p * (above - below) * x
            yy += p * (above * (y + 0.5) - below * (y - 0.5))
    scale = max(middle[3], xx, yy)
    out[:] = 0.0
    if middle[3] > 0.0:
        out[0], out[1], out[2], out[3] = xx / scale, xy / scale, yx / scale, yy / scale
