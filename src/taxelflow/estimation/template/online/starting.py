"""The map that a contact begins with: a former one that explains its first scan, or a new one from that scan."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.template.map import covering
from taxelflow.estimation.template.observations import Scanned
from taxelflow.estimation.template.online.keyframes import Keyframes, most_whole
from taxelflow.estimation.template.online.local_map import SLACK, LocalMap
from taxelflow.estimation.template.online.map_update import learn
from taxelflow.estimation.template.online.relocalization import relocalise

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.estimation.template.online.hand import PadScan
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
    learned = first_pattern(first, at)
    return Begun(learned, learned.keyframes.states[0], first.middle, again=False)


def first_pattern(first: FirstScan, at: Floats | None = None) -> LocalMap:
    """The pattern of `begun_anew`, from the scan as it was read."""
    scan, unseen_error = first.as_read, first.unseen_error
    one = scan.reading[np.newaxis], scan.variance[np.newaxis], scan.ceiling, first.delay_s, unseen_error, first.alive
    scanned = Scanned.of(np.array([first.t_s]), scan.places, *one)
    state = np.array([[*(scanned.centroids()[0] if at is None else at), 0.0, 1.0, 0.0]])
    keyframes = Keyframes(scanned, state, state)
    learned = learn(LocalMap(covering(scanned, state), keyframes, 1.0, first.gains, unseen_error=unseen_error))
    learned.slack[0] += SLACK.cut * most_whole(keyframes)[1]
    return learned
