"""Doubt of motions that are too short for a map to show how long they are.

While an object moves by less than a pitch, no two taxels read the same place of it. A motion twice as long, with a map
half as steep, leaves as little of the readings, and smoothing prefers it. The centre of pressure has no map. How much
shorter it finds such a motion is a part of the covariance, like the distance of a rival that explains as much.

Load at the pad's border shows no motion, so the rest of the load is taken to have moved all the way of the centre.
"""

from __future__ import annotations

import numpy as np

from taxelflow.messages import Floats


def stretched(places: Floats, centres: Floats, weights: Floats, border: Floats) -> Floats:
    """(scans, 2), in pitches: how far from here places (scans, 2) are if their motion is as long as that of the centre
    of pressure; 0 where it is no longer than that, or not short.

    centres: (scans, 2), where the centre of pressure has the places. weights: (scans,), 0 of scans without one. border:
    (scans,), share of the load at the pad's border.
    """
    apart, known = np.zeros_like(places), weights > 0.0
    trust = weights[known] / weights[known].sum()
    own, other = (one[known] - trust @ one[known] for one in (places, centres))
    inside = 1.0 - float(trust @ border[known])
    spread = (trust[:, np.newaxis] * other).T @ other
    length = inside * float(trust @ (own**2).sum(axis=1))
    even = inside**2 / 12.0  # variance of places that are spread evenly over a pitch
    if length <= 0.0 or np.linalg.eigvalsh(spread)[-1] >= even:
        return apart
    share = float(trust @ (own * other).sum(axis=1)) / length
    apart[known] = (np.clip(share, 0.0, 1.0) - 1.0) * own
    return apart
