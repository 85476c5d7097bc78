"""Watershed: a component that several contacts share is cut between them.

Markers are the taxels that a contact held in the previous scan, above half of its peak in the component. From there the
contacts grow downhill: of all taxels beside a contact the highest is assigned next, to its highest neighbour's contact
(F. Meyer, Topographic distance and watershed lines, Signal Processing 38, 1994).
"""

from __future__ import annotations

import numpy as np

from taxelflow.contacts.adjacency import Adjacency
from taxelflow.contacts.association import TRACKS, first_owner, owners_of
from taxelflow.contacts.tracks import SegmentedPad, Taxel, Track
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.records import Records
from taxelflow.runtime.compiling import routine

MARKER_LEVEL = 0.5
"""Share of a contact's previous peak above which its taxels are markers: noise does not move them, and a contact's
flank may have become another's."""


@routine
def label_taxels(reading: Floats, pad: SegmentedPad, owner: Bools, taxels: Records, adjacency: Adjacency) -> None:
    """Bring `Taxel.label` up to date.

    reading: (taxels,). owner: (components + 1, slots + 1), see `associate`.
    """
    peak = np.zeros(owner.shape)
    for k in range(pad.start, pad.stop):
        former: Taxel = taxels[k]
        if former.label > 0:
            peak[former.component, former.label] = max(peak[former.component, former.label], former.last_reading)
    shared = False
    for k in range(pad.start, pad.stop):
        taxel: Taxel = taxels[k]
        b, s = taxel.component, taxel.label
        several = owners_of(b, owner) > 1
        marker = s > 0 and owner[b, s] and taxel.last_reading >= MARKER_LEVEL * peak[b, s]
        shared |= several
        taxel.label = (s if marker else 0) if several else first_owner(b, owner)
    while shared:
        taxel_number, label = _next_taxel(reading, pad, owner, taxels, adjacency)
        if taxel_number < 0:
            break
        taxels[taxel_number].label = label


@routine
def _next_taxel(
    reading: Floats, pad: SegmentedPad, owner: Bools, taxels: Records, adjacency: Adjacency
) -> tuple[int, int]:
    """The highest unlabelled taxel beside a labelled one of its component, and its new label; -1 if none is left."""
    best, highest, label = -1, -np.inf, 0
    for k in range(pad.start, pad.stop):
        if taxels[k].label == 0 and reading[k] > highest and first_owner(taxels[k].component, owner) > 0:
            found = _label_of_highest_neighbour(k, reading, taxels, adjacency)
            if found > 0:
                best, highest, label = k, reading[k], found
    return best, label


@routine
def _label_of_highest_neighbour(k: int, reading: Floats, taxels: Records, adjacency: Adjacency) -> int:
    highest, label = -np.inf, 0
    for i in range(adjacency.first[k], adjacency.first[k + 1]):
        j = adjacency.taxels[i]
        if taxels[j].label > 0 and taxels[j].component == taxels[k].component and reading[j] > highest:
            highest, label = reading[j], taxels[j].label
    return label


@routine
def merge_peakless(reading: Floats, pad: SegmentedPad, tracks: Records, taxels: Records, adjacency: Adjacency) -> None:
    """End contacts that have long had no peak of their own: they have lifted, and their taxels are another's flank."""
    for s in range(1, pad.slots + 1):
        track: Track = tracks[s - 1]
        other = _label_above(s, reading, pad, taxels, adjacency)
        track.peakless_scans = track.peakless_scans + 1 if other > 0 else 0
        if track.peakless_scans >= TRACKS.parted_scans:
            track.age = track.peakless_scans = 0
            for k in range(pad.start, pad.stop):
                taxels[k].label = other if taxels[k].label == s else taxels[k].label


@routine
def _label_above(label: int, reading: Floats, pad: SegmentedPad, taxels: Records, adjacency: Adjacency) -> int:
    """The contact of a higher taxel beside this contact's highest one; 0 if there is none."""
    top, highest, other = -1, 0.0, 0
    for k in range(pad.start, pad.stop):
        if taxels[k].label == label and reading[k] > highest:
            top, highest = k, reading[k]
    if top >= 0:
        for i in range(adjacency.first[top], adjacency.first[top + 1]):
            j = adjacency.taxels[i]
            if taxels[j].label > 0 and taxels[j].label != label and reading[j] > highest:
                other = taxels[j].label
    return other
