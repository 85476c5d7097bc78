"""Connected components of loaded taxels."""

from __future__ import annotations

from taxelflow.contacts.adjacency import Adjacency
from taxelflow.contacts.tracks import SegmentedPad, Taxel
from taxelflow.messages import Floats
from taxelflow.numerics.records import Records
from taxelflow.runtime.compiling import routine

_LOADED, _BRIDGE = -1, -2
"""Marks of taxels that have no component yet: loaded ones, and ones without a reading among them."""
_MIN_LOADED_NEIGHBOURS = 2
"""A taxel without a reading is bridged if at least this many neighbours are loaded."""


@routine
def label_components(
    reading: Floats, noise: Floats, incomplete: bool, pad: SegmentedPad, taxels: Records, adjacency: Adjacency
) -> int:
    """Number the components of loaded taxels from 1 in `Taxel.component`, 0 elsewhere. Returns how many there are.

    reading, noise: (taxels,). A taxel without a reading (masked, or 0 in a scan that is incomplete) counts as loaded
    between loaded ones, so that a dead row does not split a contact.
    """
    for k in range(pad.start, pad.stop):
        taxels[k].component = _LOADED if reading[k] > pad.contact_off * noise[k] > 0.0 else 0
    for k in range(pad.start, pad.stop):
        unread = noise[k] == 0.0 or (incomplete and reading[k] == 0.0)
        if unread and _loaded_neighbours(k, taxels, adjacency) >= _MIN_LOADED_NEIGHBOURS:
            taxels[k].component = _BRIDGE
    components = 0
    for k in range(pad.start, pad.stop):
        if taxels[k].component < 0:
            components += 1
            _fill(k, components, pad.start, taxels, adjacency)
    return components


@routine
def _loaded_neighbours(k: int, taxels: Records, adjacency: Adjacency) -> int:
    loaded = 0
    for i in range(adjacency.first[k], adjacency.first[k + 1]):
        loaded += 1 if taxels[adjacency.taxels[i]].component == _LOADED else 0
    return loaded


@routine
def _fill(seed: int, component: int, start: int, taxels: Records, adjacency: Adjacency) -> None:
    """Flood fill from one taxel over all that are connected to it. start: the pad's first taxel, as of the stack."""
    taxels[seed].component = component
    taxels[start].stacked, waiting = seed, 1
    while waiting > 0:
        waiting -= 1
        k = taxels[start + waiting].stacked
        for i in range(adjacency.first[k], adjacency.first[k + 1]):
            neighbour: Taxel = taxels[adjacency.taxels[i]]
            if neighbour.component < 0:
                neighbour.component = component
                taxels[start + waiting].stacked = adjacency.taxels[i]
                waiting += 1
