"""Contacts of a pad, tracked from scan to scan: which loaded taxel belongs to which of them.

In each scan: connected components of loaded taxels, association of components with tracked contacts, and a watershed
where several contacts share a component. A contact keeps its number for as long as it lasts; a new one takes the lowest
free number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from taxelflow.contacts.adjacency import Adjacency, Indices, adjacency
from taxelflow.contacts.association import associate
from taxelflow.contacts.connected_components import label_components
from taxelflow.contacts.single_contact import has_first_only, track_single
from taxelflow.contacts.tracks import Component, Memory, SegmentedPad, Taxel, Track
from taxelflow.contacts.watershed import label_taxels, merge_peakless
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.records import Records, records
from taxelflow.runtime.compiling import kernel, routine
from taxelflow.runtime.settled import Settled

if TYPE_CHECKING:
    from taxelflow.messages import Scans
    from taxelflow.sensors.layout import Layout

Labels = NDArray[np.int8]

ABSENT, TOUCHING, NEAR, SEPARATE = range(4)
"""Clearance of a contact: there is no contact; it lies beside a loaded taxel of another; beside an unloaded one that
counts as another's (it lies beside both, and the other's is more loaded there); beside neither."""


class ContactState:
    """A contact in one scan. clearance: from the other contacts. connected: it is one component."""

    clearance: int
    connected: bool


@dataclass(frozen=True, slots=True, eq=False)
class Segmentation:
    """labels: (scans, taxels) of the sensor, n for a loaded taxel of contact n of its pad, from 1; -n for an unloaded
    taxel beside it; 0 for all others. contacts: `ContactState` (scans, pads segmented, slots).
    """

    labels: Labels
    contacts: Records


class ContactTracker:
    """Tracks contacts on some pads; keeps what the next scan needs."""

    def __init__(self, layout: Layout, pads: Indices, slots: Indices, on: float, off: float) -> None:
        """slots: (pads,) contacts on each pad at most. on, off: see `SegmentedPad`."""
        self._taxels = layout.taxels
        self._adjacency = adjacency(layout, pads)
        self._track_single = Settled(track_single)
        starts = layout.starts
        pitch = np.repeat(np.sqrt(layout.pitch_m.prod(axis=1)), np.diff(starts))[: layout.taxels]
        self._memory = Memory(
            pads=records(SegmentedPad, len(pads)),
            tracks=records(Track, len(pads), int(slots.max())),
            taxels=records(Taxel, layout.taxels),
            components=records(Component, int(np.diff(starts)[pads].max()) + 1),
        )
        own = self._memory.pads
        own["pad"], own["start"], own["stop"], own["slots"] = pads, starts[pads], starts[pads + 1], slots
        own["contact_on"], own["contact_off"] = on, off
        self._memory.taxels["x"] = layout.x_m[: layout.taxels] / pitch
        self._memory.taxels["y"] = layout.y_m[: layout.taxels] / pitch

    def step(self, scans: Scans) -> Segmentation:
        """The contacts of these scans, which follow those of the last call."""
        labels = np.zeros((len(scans), self._taxels), dtype=np.int8)
        contacts = records(ContactState, len(scans), *self._memory.tracks.shape)
        segment(
            scans.pressure,
            scans.noise,
            scans.contact,
            scans.complete,
            self._memory,
            self._adjacency,
            labels,
            contacts,
        )
        return Segmentation(labels, contacts)

    def is_single(self) -> bool:
        """Whether each pad has one contact at most, which is in the first slot, so that `step_single` can go on."""
        return has_first_only(self._memory)

    def step_single(self, scans: Scans, places: Records) -> int:
        """Track up to the first scan with several components on a pad, see `track_single`; that scan."""
        memory, pressure = self._memory, scans.pressure
        marks = scans.contact, scans.complete
        return self._track_single(pressure, scans.noise, *marks, memory, self._adjacency, places)


@kernel
def segment(
    pressure: Floats,
    noise: Floats,
    contact: Bools,
    complete: Bools,
    memory: Memory,
    adjacency: Adjacency,
    labels: Labels,
    contacts: Records,
) -> None:
    """Fill labels and contacts, which come in as 0; see `Segmentation`.

    pressure: (scans, entries). noise: (entries,). contact, complete: (scans, pads of the sensor).
    """
    for scan in range(len(pressure)):
        for number in range(len(memory.pads)):
            pad: SegmentedPad = memory.pads[number]
            if contact[scan, pad.pad]:
                _segment_pad(pressure[scan], noise, not complete[scan, pad.pad], number, memory, adjacency)
                _store(pressure[scan], pad, memory.taxels, labels[scan])
                _find_clearance(pressure[scan], number, memory, adjacency, labels[scan], contacts[scan, number])
                _find_connected(number, memory, contacts[scan, number])
            else:
                _reset(number, memory)


@routine
def _reset(number: int, memory: Memory) -> None:
    """The pad is not in contact: no track, no label."""
    pad: SegmentedPad = memory.pads[number]
    for k in range(pad.start, pad.stop):
        memory.taxels[k].label = 0
    for slot in range(memory.tracks.shape[1]):
        track: Track = memory.tracks[number, slot]
        track.age = track.parted_scans = track.peakless_scans = 0


@routine
def _segment_pad(
    reading: Floats, noise: Floats, incomplete: bool, number: int, memory: Memory, adjacency: Adjacency
) -> None:
    """Bring the labels and tracks of one pad up to date. reading, noise: (entries,)."""
    pad: SegmentedPad = memory.pads[number]
    taxels, tracks = memory.taxels, memory.tracks[number]
    components = label_components(reading, noise, incomplete, pad, taxels, adjacency)
    if pad.slots == 1:
        tracks[0].age = 1
        for k in range(pad.start, pad.stop):
            taxels[k].label = 1 if taxels[k].component > 0 else 0
        return
    owner = associate(reading, noise, pad, number, components, memory)
    label_taxels(reading, pad, owner, taxels, adjacency)
    merge_peakless(reading, pad, tracks, taxels, adjacency)


@routine
def _store(reading: Floats, pad: SegmentedPad, taxels: Records, labels: Labels) -> None:
    """Keep the readings for the next scan, and write the labels of this one."""
    for k in range(pad.start, pad.stop):
        taxels[k].last_reading = reading[k]
        labels[k] = taxels[k].label


@routine
def _find_clearance(
    reading: Floats, number: int, memory: Memory, adjacency: Adjacency, labels: Labels, contacts: Records
) -> None:
    """Label the unloaded taxels beside contacts, and set the clearance of contacts (slots,)."""
    pad: SegmentedPad = memory.pads[number]
    for slot in range(memory.tracks.shape[1]):
        contacts[slot].clearance = SEPARATE if memory.tracks[number, slot].age > 0 else ABSENT
    for k in range(pad.start, pad.stop):
        if labels[k] == 0:
            labels[k] = -_strongest_neighbour(k, reading, adjacency, labels)
    for k in range(pad.start, pad.stop):
        if labels[k] > 0:
            own: ContactState = contacts[labels[k] - 1]
            own.clearance = min(own.clearance, _clearance_of(k, adjacency, labels))


@routine
def _strongest_neighbour(k: int, reading: Floats, adjacency: Adjacency, labels: Labels) -> int:
    """The contact of the most loaded taxel beside this one; 0 if there is none."""
    most, label = 0.0, 0
    for i in range(adjacency.first[k], adjacency.first[k + 1]):
        j = adjacency.taxels[i]
        if labels[j] > 0 and reading[j] > most:
            most, label = reading[j], labels[j]
    return label


@routine
def _clearance_of(k: int, adjacency: Adjacency, labels: Labels) -> int:
    """Clearance of a loaded taxel from other contacts."""
    clearance = SEPARATE
    for i in range(adjacency.first[k], adjacency.first[k + 1]):
        j = adjacency.taxels[i]
        if labels[j] != 0 and abs(labels[j]) != labels[k]:
            clearance = min(clearance, TOUCHING if labels[j] > 0 else NEAR)
    return clearance


@routine
def _find_connected(number: int, memory: Memory, contacts: Records) -> None:
    """Set whether each contact (slots,) is one component."""
    pad: SegmentedPad = memory.pads[number]
    component = np.zeros(len(contacts), dtype=np.int64)
    for slot in range(len(contacts)):
        contacts[slot].connected = memory.tracks[number, slot].age > 0
    for k in range(pad.start, pad.stop):
        taxel: Taxel = memory.taxels[k]
        slot = taxel.label - 1
        if slot >= 0:
            own: ContactState = contacts[slot]
            own.connected &= component[slot] in (0, taxel.component)
            component[slot] = taxel.component
