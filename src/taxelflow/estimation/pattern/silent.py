"""Dead taxels that show in the scans themselves, before there is a pattern: they stay silent among loaded ones."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.estimation.pattern.scanned import Scanned
    from taxelflow.messages import Bools, Floats

_BESIDE, _STRONG, _SILENT = 1.25, 10.0, 0.1
"""Neighbours lie within so many pitches, are loaded above so many standard deviations, and a silent taxel reads less
than this share of theirs."""
_FURTHER = 2.0
"""A contact that has gone over two silent taxels went so many pitches further than they reach: it did not just rock."""
_ACROSS = 0.3
"""A neighbour is on a side of a pair if it lies so many pitches further out than the pair's taxels."""


def silent_taxels(scanned: Scanned) -> NDArray[np.int64]:
    """Taxels that read next to nothing though the object is on them: single ones, and pairs of neighbours."""
    beside = _beside(scanned.places)
    strong = (scanned.readings > _STRONG * np.sqrt(scanned.variance)) & (scanned.variance > 0)
    answers = strong & (scanned.readings > _SILENT * scanned.amplitude)
    quiet: Bools = ~np.any(answers, axis=0) & np.any(scanned.variance > 0, axis=0)
    found = set(np.flatnonzero(quiet & _surrounded(scanned.readings, strong, beside)).tolist())
    found.update(*_passed_over(scanned, strong, beside, quiet))
    return np.array(sorted(found), np.int64)


def _beside(places: Floats) -> Bools:
    """(taxels, taxels): which are neighbours. places: (2, taxels)."""
    apart = np.hypot(*(places[:, :, np.newaxis] - places[:, np.newaxis, :]))
    near: Bools = (apart > 0) & (apart < _BESIDE)
    return near


def _surrounded(readings: Floats, strong: Bools, beside: Bools) -> Bools:
    """(taxels,): which read next to nothing in scans in which nearly all of their neighbours are loaded."""
    count = beside.sum(axis=0)
    surrounded = (strong @ beside.astype(np.float64) > np.where(count > 3, count - 1.5, count - 0.5)) & (count > 1)
    around = (readings @ beside.astype(np.float64)) / np.maximum(count, 1)
    own = np.where(surrounded, readings, 0.0).sum(axis=0)
    expected = np.where(surrounded, around, 0.0).sum(axis=0)
    share = np.where(count > 3, _SILENT, 0.5 * _SILENT)  # at a corner pressure may end
    silent: Bools = (expected > 0) & (own < share * expected)
    return silent


def _passed_over(scanned: Scanned, strong: Bools, beside: Bools, quiet: Bools) -> list[tuple[int, int]]:
    """Pairs of neighbours that stay silent while a contact goes right over them. quiet: (taxels,), which never answer.

    Each hides the other from its neighbours, so that few scans surround them, and a hole of two taxels in an object at
    rest looks the same. An object that slides over them cannot keep its hole there.
    """
    quiet = quiet & (beside @ strong.any(axis=0).astype(np.float64) > 1.5)  # else: beside its way, not on it
    centroid = scanned.centroids()[scanned.loaded().any(axis=1)]
    pairs = []
    for one, other in combinations(np.flatnonzero(quiet).tolist(), 2):
        alone = np.count_nonzero(quiet & (beside[one] | beside[other])) == 2  # not part of a gap along the way
        if beside[one, other] and alone and _goes_over(scanned, strong, beside, centroid, (one, other)):
            pairs.append((one, other))
    return pairs


def _goes_over(scanned: Scanned, strong: Bools, beside: Bools, centroid: Floats, pair: tuple[int, int]) -> bool:
    """Whether the contact, centred at `centroid` (scans, 2), goes over a pair that reads nothing."""
    places = scanned.places
    around = np.flatnonzero(beside[list(pair)].any(axis=0))
    around = around[~np.isin(around, pair)]
    touched = strong[:, around].any(axis=1)
    level = np.where(strong[:, around], scanned.readings[:, around], 0.0).sum(axis=1)
    level /= np.maximum(strong[:, around].sum(axis=1), 1)
    if scanned.readings[touched][:, list(pair)].sum(axis=0).max() > _SILENT * level.sum():
        return False
    along = places[:, pair[1]] - places[:, pair[0]]
    middle = places[:, list(pair)].mean(axis=1)
    length = float(np.hypot(*along))
    for axis, reach in ((along / length, 0.5 * length), (np.array([-along[1], along[0]]) / length, 0.0)):
        out = axis @ (places[:, around] - middle[:, np.newaxis])
        ahead = strong[:, around[out > reach + _ACROSS]].any(axis=1)
        behind = strong[:, around[out < -reach - _ACROSS]].any(axis=1)
        between = strong[:, around[np.abs(out) <= reach + _ACROSS]].any()
        passed = (ahead & ~behind).any() and (behind & ~ahead).any() and between
        if passed and np.ptp(centroid @ axis) > 2 * reach + _FURTHER:
            return True
    return False
