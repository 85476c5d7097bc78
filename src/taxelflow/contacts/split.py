"""Contacts that move independently on one pad, split: each becomes a pad of its own, with its own taxels.

To all later stages a contact is one more pad, which holds all of the pad's taxels. What other contacts load, and the
taxels beside that, reads 0 on it. Where a loaded taxel of a contact lies beside those, some of its load may be
hidden, and readings of 0 are missing ones: the scan is not complete for it. Taxels that belong to no contact are read
by every one, so that a contact which is alone reads what its pad reads.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.contacts.segmentation import ABSENT, SEPARATE, ContactState, ContactTracker, Labels
from taxelflow.messages import Bools, Floats, no_scans
from taxelflow.numerics.records import Records, records
from taxelflow.runtime.compiling import kernel

if TYPE_CHECKING:
    from taxelflow.messages import Scans
    from taxelflow.sensors.layout import Layout


class SplitContact:
    """A contact of a pad. home: its pad; number: of that pad among those segmented; slot: its place there.

    pad: its own number in the layout. start, stop: its entries; home_start: the first taxel of its pad.
    """

    home: int
    number: int
    slot: int
    pad: int
    start: int
    stop: int
    home_start: int


class ContactSplitter:
    """Splits the contacts of the pads for which the layout has contacts, scan by scan."""

    def __init__(self, layout: Layout, on: float, off: float) -> None:
        """on, off: see `Conditioner.contact_on` and `contact_off`."""
        pads = np.flatnonzero(layout.contact_of >= 0)
        home = layout.contact_of[pads]
        homes, first, number, slots = np.unique(home, return_index=True, return_inverse=True, return_counts=True)
        self._tracker = ContactTracker(layout, homes, slots, on, off)
        self._contacts = records(SplitContact, len(pads))
        own = self._contacts
        own["home"], own["number"], own["slot"], own["pad"] = home, number, np.arange(len(pads)) - first[number], pads
        own["start"], own["stop"], own["home_start"] = layout.starts[pads], layout.starts[pads + 1], layout.starts[home]
        self.step(no_scans(layout.entries, len(layout.pads)))  # compiles

    def step(self, scans: Scans) -> Scans:
        """The scans, which follow those of the last call, with each contact's own taxels; the input is unchanged."""
        found = self._tracker.step(scans)
        pressure, contact, complete = scans.pressure.copy(), scans.contact.copy(), scans.complete.copy()
        split(found.labels, found.contacts, self._contacts, pressure, contact, complete)
        shear = scans.shear
        if shear is not None:  # that of the taxels which a contact holds
            own = np.arange(shear.shape[1]) < self._contacts["start"].min()
            shear = np.where((own | (pressure != 0.0))[..., np.newaxis], shear, 0.0)
        return replace(scans, pressure=pressure, contact=contact, complete=complete, shear=shear)


@kernel
def split(
    labels: Labels, states: Records, contacts: Records, pressure: Floats, contact: Bools, complete: Bools
) -> None:
    """Fill pressure (scans, entries), contact and complete (scans, pads) of the contacts from those of their pads.

    labels, states: see `Segmentation`. contacts: `SplitContact`. A scan is incomplete for a contact whose
    taxels, unloaded ones included, read 0 or less in all: its load has no centre.
    """
    for scan in range(len(pressure)):
        for k in range(len(contacts)):
            own: SplitContact = contacts[k]
            state: ContactState = states[scan, own.number, own.slot]
            load = 0.0
            for entry in range(own.start, own.stop):
                taxel = own.home_start + entry - own.start
                label = abs(labels[scan, taxel])
                pressure[scan, entry] = pressure[scan, taxel] if label in (0, own.slot + 1) else 0.0
                load += pressure[scan, entry]
            contact[scan, own.pad] = state.clearance > ABSENT
            hidden = contact[scan, own.pad] and (state.clearance < SEPARATE or load <= 0.0)
            complete[scan, own.pad] = complete[scan, own.home] and not hidden
