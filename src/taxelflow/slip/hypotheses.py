"""A short list of change-point hypotheses: when it is full, the two that are closest for their age are merged."""

from __future__ import annotations

import numpy as np

from taxelflow.numerics.records import Records
from taxelflow.runtime.compiling import routine


@routine
def merge_closest(t_s: float, count: int, recent: int, hypotheses: Records) -> None:
    """Merge one hypothesis into the next: the one that leaves the smallest gap relative to its age.

    hypotheses: records with `start_s` and `weight`, the first `count` in use, ordered by time. The first and the last
    `recent` stay. Repeated merging leaves gaps that are proportional to the age. The merged one has both weights.
    """
    drop, closest = 1, np.inf
    for j in range(1, count - recent - 1):
        gap_s = hypotheses[j + 1].start_s - hypotheses[j - 1].start_s
        relative = gap_s / (t_s - hypotheses[j + 1].start_s)
        if relative < closest:
            drop, closest = j, relative
    hypotheses[drop + 1].weight += hypotheses[drop].weight
    remove(drop, count, hypotheses)


@routine
def remove(place: int, count: int, hypotheses: Records) -> None:
    """Move the hypotheses after this place one place down."""
    for j in range(place, count - 1):
        hypotheses[j] = hypotheses[j + 1]
