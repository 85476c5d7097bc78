"""Contacts that move independently on one pad, told apart: each becomes a pad of its own, with its own taxels.

To all that follows a contact is one more pad, which holds all of the pad's taxels. What other contacts load, and the
taxels beside that, reads 0 on it. Where a loaded taxel of a contact lies beside those, some of its load may be
hidden, and readings of 0 are missing ones: the scan is not complete for it. All taxels that no contact has are read by
every one, so that a contact which is alone reads what its pad reads.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.condition.blobs import ABSENT, FREE, Follower

if TYPE_CHECKING:
    from taxelflow.layout import Layout
    from taxelflow.messages import Scans


class Separator:
    """Tells the contacts of pads apart, scan by scan."""

    def __init__(self, layout: Layout, on: float, off: float) -> None:
        """on, off: see `Conditioner.contact_on` and `contact_off`."""
        self._layout = layout
        pads, slots = np.unique(layout.contact_of[layout.contact_of >= 0], return_counts=True)
        self._pads = [(int(pad), np.flatnonzero(layout.contact_of == pad).tolist()) for pad in pads]
        self._follower = Follower(layout, pads, slots, on, off)

    def step(self, scans: Scans) -> None:
        """Leave each contact its own taxels, in place; these scans follow those of the last call."""
        followed = self._follower.step(scans)
        for number, (pad, contacts) in enumerate(self._pads):
            own = self._layout.of_pad(pad)
            label = np.abs(followed.labels[:, own])
            for slot, contact in enumerate(contacts):
                others = (label != 0) & (label != slot + 1)
                pressure = scans.pressure[:, self._layout.of_pad(contact)]
                pressure[:] = np.where(others, 0.0, scans.pressure[:, own])
                scans.contact[:, contact] = followed.room[:, number, slot] > ABSENT
                hidden = scans.contact[:, contact] & (followed.room[:, number, slot] < FREE)
                scans.complete[:, contact] = scans.complete[:, pad] & ~hidden
