"""Work on many pads at once, spread over scans that come quickly: none of them may take long."""

from __future__ import annotations

from math import ceil, inf
from typing import TYPE_CHECKING, NamedTuple

from taxelflow.numerics.clock import SAME_S

if TYPE_CHECKING:
    from collections.abc import Iterable


class _Turn(NamedTuple):
    """Turns that pads have."""

    every_s: float = 0.01
    """Each pad has a turn in this time: at 100 Hz all have one in each scan."""
    share: float = 0.9
    """Share of it after which a pad's next turn may come: scans of 100 Hz do not come quite evenly."""


TURN = _Turn()


def most_at_once(pads: int, step_s: float) -> int:
    """How many of these pads have a turn in a scan. step_s: time since the scan before."""
    return max(ceil(pads * min((step_s - SAME_S) / TURN.every_s, 1.0)), 1)


class Turns:
    """When each pad had its last turn."""

    def __init__(self, pads: int) -> None:
        self._last_s = [-inf] * pads

    def taken(self, asking: Iterable[int], now_s: float, most: int) -> list[int]:
        """Which of the pads that ask have their turn now, in order: those that have waited longest, up to this many."""
        last = self._last_s
        least_s = TURN.share * TURN.every_s
        due = sorted((pad for pad in asking if now_s - last[pad] >= least_s - SAME_S), key=lambda pad: last[pad])
        chosen = sorted(due[:most])
        for pad in chosen:
            last[pad] = now_s
        return chosen
