"""Contacts that move independently on one pad, told apart: each becomes a pad of its own, with its own taxels.

To all that follows a contact is one more pad, which holds all of the pad's taxels. What other contacts load, and the
taxels beside that, reads 0 on it. Where a loaded taxel of a contact lies beside those, some of its load may be
hidden, and readings of 0 are missing ones: the scan is not complete for it. All taxels that no contact has are read by
every one, so that a contact which is alone reads what its pad reads.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.contacts.segmentation import ABSENT, FREE, Follower
from taxelflow.messages import Bools, Floats, no_scans

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Scans
    from taxelflow.sensors.layout import Layout

    Indices = NDArray[np.int64]


class Separator:
    """Tells the contacts of pads apart, scan by scan."""

    def __init__(self, layout: Layout, on: float, off: float) -> None:
        """on, off: see `Conditioner.contact_on` and `contact_off`."""
        told = np.flatnonzero(layout.contact_of >= 0)
        self._pads, first, self._slots = np.unique(layout.contact_of[told], return_index=True, return_counts=True)
        self._contacts, self._starts = told[first], layout.starts
        self._follower = Follower(layout, self._pads, self._slots, on, off)
        self.step(no_scans(layout.entries, len(layout.pads)))  # compiles

    def step(self, scans: Scans) -> None:
        """Leave each contact its own taxels, in place; these scans follow those of the last call."""
        followed = self._follower.step(scans)
        share_out(
            followed.labels,
            followed.room,
            self._pads,
            self._slots,
            self._contacts,
            self._starts,
            scans.pressure,
            scans.contact,
            scans.complete,
        )


@kernel
def share_out(
    labels: NDArray[np.int8],
    room: NDArray[np.int8],
    pads: Indices,
    slots: Indices,
    contacts: Indices,
    starts: Indices,
    pressure: Floats,
    contact: Bools,
    complete: Bools,
) -> None:
    """Fill pressure (scans, entries), contact and complete (scans, pads) of the contacts from those of their pads.

    labels, room: see `Followed`. contacts: (pads followed,), the first contact of each; its others come next.
    """
    for scan in range(len(pressure)):
        for number in range(len(pads)):
            low, high = starts[pads[number]], starts[pads[number] + 1]
            for slot in range(slots[number]):
                to = contacts[number] + slot
                for k in range(high - low):
                    label = abs(labels[scan, low + k])
                    own = label == 0 or label == slot + 1
                    pressure[scan, starts[to] + k] = pressure[scan, low + k] if own else 0.0
                contact[scan, to] = room[scan, number, slot] > ABSENT
                hidden = contact[scan, to] and room[scan, number, slot] < FREE
                complete[scan, to] = complete[scan, pads[number]] and not hidden
