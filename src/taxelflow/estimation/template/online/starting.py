"""The map that a contact begins with: a former one that explains its first scan, or a new one from that scan."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from taxelflow.estimation.template.online.map_update import first_pattern
from taxelflow.estimation.template.online.relocalization import relocalise

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.estimation.template.online.hand import PadScan
    from taxelflow.estimation.template.online.local_map import LocalMap
    from taxelflow.messages import Bools, Floats


class FirstScan(NamedTuple):
    """The scan that a pattern begins with. part: as_read, divided by the taxels' gains (taxels,). alive: (taxels,),
    those known to work. unseen_error: see `Layout`. delay_s: (taxels,), see `observations.delays_of`. middle: (2,),
    centroid of the contact.
    """

    t_s: float
    part: PadScan
    as_read: PadScan
    gains: Floats
    alive: Bools
    unseen_error: float
    delay_s: Floats
    middle: Floats


class Begun(NamedTuple):
    """The pattern, and the state (5,) of the scan on it. again: whether it is known from before. middle: see
    `FirstScan`.
    """

    learned: LocalMap
    state: Floats
    middle: Floats
    again: bool


def begun(first: FirstScan, library: Sequence[LocalMap]) -> Begun:
    """A pattern of the library that explains the scan, the latest first, else a new one."""
    for known in reversed(library):
        found = relocalise(known, first.middle, first.part)
        if found is not None:
            return Begun(known, found.state, first.middle, again=True)
    return begun_anew(first, None)


def begun_anew(first: FirstScan, at: Floats | None) -> Begun:
    """A new pattern, with its origin at the place `at` (2,), else at the contact's centroid."""
    gains, alive = first.gains, first.alive
    learned = first_pattern(first.t_s, first.as_read, first.delay_s, gains, first.unseen_error, at, alive=alive)
    return Begun(learned, learned.keyframes.states[0], first.middle, again=False)
