"""Which contacts have formed: a contact places the object only from then on.

While a contact is pressed on, its pattern moves though the object rests, and an anchor would keep that error.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.bins import AHEAD_S
from taxelflow.numerics.forming import find_forming
from taxelflow.runtime.compiling import kernel
from taxelflow.runtime.settled import Settled

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats, Slips
    from taxelflow.sensors.layout import Layout


class Forming:
    """Follows contacts block by block; remembers each."""

    def __init__(self, layout: Layout) -> None:
        count = len(layout.pads)
        self._judged = bool(layout.unseen_error)  # else the skin follows the model
        self._loads, self._begin_s, self._formed = (
            np.zeros((count, 4)),
            np.full(count, np.nan),
            np.zeros(count, np.bool_),
        )
        self._find, self._follow = Settled(find_forming), Settled(follow_forming)

    def step(self, slips: Slips) -> Bools:
        """(scans, pads), whether a contact has formed since it began."""
        if not self._judged:
            return slips.contact
        forming = np.empty(slips.contact.shape, dtype=np.bool_)
        self._find(slips.t_s, slips.contact, slips.load, slips.border, self._loads, forming)
        self._follow(slips.t_s, slips.contact, self._begin_s, self._formed, forming)
        return forming


@kernel
def follow_forming(t_s: Floats, contact: Bools, begin_s: Floats, formed: Bools, marks: Bools) -> None:
    """Replace marks (scans, pads), whether a contact forms, by whether it has formed since it began.

    One that never does is taken as it is after some slips' time. t_s: (scans,). contact: (scans, pads). begin_s,
    formed: (pads,), time of the last scan without contact, NaN before any scan, and whether it has formed; updated.
    """
    for scan in range(len(t_s)):
        for pad in range(len(formed)):
            held = contact[scan, pad]
            if not held or np.isnan(begin_s[pad]):
                begin_s[pad] = t_s[scan]
            long_ago = t_s[scan] - begin_s[pad] > AHEAD_S
            formed[pad] = held and (formed[pad] or not marks[scan, pad] or long_ago)
            marks[scan, pad] = formed[pad]
