"""Contacts that are pressed in more or less: depth adds pressure wherever they touch, and not in proportion to it.

Under a constant force an object sinks in as lower parts of its relief come under the pad, and rises as higher ones do.
On an elastic skin all of the contact then reads more by the same pressure, and a taxel that is touched in part by a
share of it:

    y = g q(u) + d (1 - exp(-q(u) / p)),

with a depth d of each scan, a pressure, and p up to which a taxel counts as touched in part. A gain alone would make
the pattern answer for d, which moves with the object: the map is then stretched, and motion with it, by some per cent.

The depth takes the place of the size in the states of a fit; outside of it, states have their size.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.bspline import states_of
from taxelflow.runtime.compiling import inlined

if TYPE_CHECKING:
    from taxelflow.messages import Floats

DEPTH_STD = 0.1
"""Standard deviation of the depth before anything is known, as a share of the contact's largest reading."""
_LEAST_STD, _WELL_KNOWN = 0.002, 0.6
"""Least standard deviation that is learned, as a share of it, and quantile of the depths' variances up to which they
teach it."""
_IN_PART = 0.06
"""Pressure p, as a share of the contact's largest reading."""


@inlined
def pressed(q: float, level: float) -> tuple[float, float]:
    """What a depth of 1 adds to a reading whose pattern has pressure q, and its slope by q. level: the contact's
    largest reading, in which the depth is counted; with 0 there is no depth.
    """
    if level == 0.0 or q <= 0.0:
        return 0.0, 0.0
    left = np.exp(-q / (_IN_PART * level))
    return level * (1.0 - left), left / _IN_PART


def spread_of(depth: Floats, variance: Floats) -> float:
    """Standard deviation of the depths (scans,) beyond what their variances (scans,) explain; of those known best.

    Where depths are noise, the next fit holds them near 0, and poses are those of a fit without any.
    """
    well = variance <= np.quantile(variance, _WELL_KNOWN)
    spread = float(np.mean(depth[well] ** 2) - np.mean(variance[well]))
    return float(np.sqrt(max(spread, _LEAST_STD**2)))


def with_depth(states: Floats, depth: Floats) -> Floats:
    """States (scans, 5) with depth (scans,), if there is any, in the place of the size, which is 0 then."""
    own = states.copy()
    if len(depth):
        states_of(own).size[:] = depth
    return own


def take_depth(whole: Floats, states: Floats, depth: Floats) -> None:
    """Fill states (scans, 5) and depth (scans,), if there is any, from what `with_depth` gives."""
    states[:] = whole
    if len(depth):
        depth[:] = states_of(whole).size
        states_of(states).size[:] = 0.0
