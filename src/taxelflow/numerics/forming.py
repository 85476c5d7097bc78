"""Whether a contact still forms: what touches first lies beside the middle of the whole.

While a contact is pressed on, its pattern changes without any motion, and every pose follows it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from taxelflow.numerics.bins import BIN_S
from taxelflow.numerics.clock import SAME_S
from taxelflow.runtime.compiling import kernel

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats


class _Forming(NamedTuple):
    """When a contact forms."""

    level: float = 2.0 / 3.0
    """It has formed when its mean load before a scan has been this share of that scan's for a bin's time. A load that
    rises steadily from 0 stays below a half, and reaches this once half the time of its rise has passed again."""
    again: float = 3.0
    """It forms again above this many times its mean load: what touched then is a small part of what touches now."""


_FORMING = _Forming()


@kernel
def find_forming(t_s: Floats, contact: Bools, load: Floats, border: Bools, forms: Floats, forming: Bools) -> None:
    """Fill forming (scans, pads): whether a contact forms; also where there is none.

    Where a border cuts the contact it forms once: an object that slides in over it grows as it moves. t_s: (scans,).
    contact, load: (scans, pads). border: (scans, pads, 2). forms: (pads, 4), sum of the contact's loads, their number,
    since when its load has been steady, s, and whether it has formed; updated.
    """
    for scan in range(contact.shape[0]):
        for pad in range(contact.shape[1]):
            own, now = forms[pad], load[scan, pad]
            if not contact[scan, pad]:
                own[:] = 0.0
            elif now > 0.0:
                _follow_load(t_s[scan], now, border[scan, pad, 0] or border[scan, pad, 1], own)
            forming[scan, pad] = not own[3]


@kernel
def _follow_load(t_s: float, load: float, is_cut: bool, own: Floats) -> None:
    """Follow whether a contact has formed, by the load of one more scan. own: (4,), see `find_forming`."""
    if own[3] and not is_cut and load * own[1] > _FORMING.again * own[0]:
        own[:] = 0.0
    if not own[3]:
        if own[1] == 0.0 or own[0] < _FORMING.level * load * own[1]:
            own[2] = t_s
        own[3] = t_s - own[2] > BIN_S - SAME_S
    own[0] += load
    own[1] += 1.0
