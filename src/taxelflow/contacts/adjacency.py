"""Neighbours of each taxel, for kernels that walk over a pad."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from taxelflow.sensors.layout import Layout

Indices = NDArray[np.int64]


class Adjacency(NamedTuple):
    """The neighbours of taxel k are taxels[first[k] : first[k + 1]] (compressed sparse rows)."""

    first: Indices
    taxels: Indices


def adjacency(layout: Layout, pads: Indices) -> Adjacency:
    """Neighbours of the taxels of these pads; none for other taxels.

    In a grid the 8 taxels that share a side or a corner, elsewhere the edges of `Layout.neighbours`.
    """
    pairs = [np.zeros((0, 2), dtype=np.int64)]
    for pad in pads.tolist():
        own = layout.of_pad(pad)
        if layout.tables[pad]:
            pairs.append(layout.neighbours(pad) + own.start)
        else:
            row, col = layout.row[own], layout.col[own]
            chebyshev = np.maximum(np.abs(row[:, np.newaxis] - row), np.abs(col[:, np.newaxis] - col))
            pairs.append(np.argwhere(np.triu(chebyshev == 1)) + own.start)
    one_way = np.concatenate(pairs)
    both = np.concatenate([one_way, one_way[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    first = np.searchsorted(both[:, 0], np.arange(layout.taxels + 1))
    return Adjacency(first.astype(np.int64), np.ascontiguousarray(both[:, 1]))
