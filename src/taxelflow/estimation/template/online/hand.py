"""A hand as the kernels of a stream read it: its taxels, a scan, its maps, and rows of estimates; with workspace."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from taxelflow.estimation.template.levenberg_marquardt import ROOM
from taxelflow.estimation.template.linearization import PACKED, lanes_for
from taxelflow.estimation.template.observations import delays_of
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.bspline import STATE
from taxelflow.numerics.cut import open_sides

if TYPE_CHECKING:
    from taxelflow.messages import Scans
    from taxelflow.sensors.layout import Layout


class Room(NamedTuple):
    """To work in, for one pad at a time; made once, because memory takes time. lanes: (`PACKED` + 6, taxels of the
    largest pad in whole vector registers); states: (19, 5); squares: (2, 3, 3).
    """

    lanes: Floats
    states: Floats
    squares: Floats


class Hand(NamedTuple):
    """Taxels of all pads. places: (pads, 2, taxels of the largest) in pitches; delay: (entries,) or (0,); edge:
    (entries,), at a border of the pad; sides: (pads, 4, taxels of the largest), see `open_sides`; starts: (pads + 1,);
    pitch_m: (pads,); lead_s: (pads,), see `observations.delays_of`; floor: share of a contact's largest reading
    that the sensor may be wrong by unseen.
    """

    places: Floats
    delay: Floats
    edge: Bools
    sides: Floats
    starts: NDArray[np.int64]
    pitch_m: Floats
    lead_s: Floats
    floor: float
    room: Room


class Scan(NamedTuple):
    """One scan: reading, variance (0 where a reading does not count) and ceiling (entries,), divided by taxels' gains;
    raw: (entries,), the reading as it is; contact: (pads,).
    """

    t: float
    reading: Floats
    variance: Floats
    ceiling: Floats
    raw: Floats
    contact: Bools


class PadScan(NamedTuple):
    """One pad's part of a scan, (taxels,) each, where its taxels are, and which sides (4, taxels) are open."""

    reading: Floats
    variance: Floats
    ceiling: Floats
    raw: Floats
    places: Floats
    edge: Bools
    sides: Floats


class Patterns(NamedTuple):
    """Patterns and their variance (pads, rows, cols), NaN beyond a pad's own; rests (4, entries), see
    `residual_process`.
    """

    patterns: Floats
    doubts: Floats
    rests: Floats


POSE, STEP = range(2)
SPAN, LAG, DISTURBANCE = range(3)
"""Parts of rows."""


class Rows(NamedTuple):
    """What the stream gives out, see `messages.Estimates`, in few arrays, for a kernel's call takes time for each.

    vectors: (2, scans, pads, 3), pose and displacement. matrices: (2, scans, pads, 3, 3), their covariances. scalars:
    (3, scans, pads), span, lag and disturbance. quality: (scans, pads).
    """

    vectors: Floats
    matrices: Floats
    scalars: Floats
    quality: NDArray[np.uint8]


def hand_of(layout: Layout) -> Hand:
    """A layout as kernels read it."""
    pitch_m = np.sqrt(layout.pitch_m.prod(axis=1))
    pads, most = len(layout.pads), int(np.diff(layout.starts).max())
    places, sides = np.zeros((pads, 2, most)), np.zeros((pads, 4, most))
    for pad in range(pads):
        own = layout.of_pad(pad)
        here = np.stack([layout.x_m[own], layout.y_m[own]]) / pitch_m[pad]
        places[pad, :, : here.shape[1]], sides[pad, :, : here.shape[1]] = here, open_sides(here)
    late, lead_s = delays_of(layout)
    edge: Bools = np.asarray(layout.border.any(axis=1), dtype=np.bool_)
    room = Room(np.zeros((PACKED + 6, lanes_for(most))), np.zeros((10 + ROOM, STATE)), np.zeros((2, 3, 3)))
    delay = late if late.any() else np.zeros(0)
    return Hand(places, delay, edge, sides, layout.starts, pitch_m, lead_s, layout.unseen_error, room)


def places_of(hand: Hand, pad: int) -> Floats:
    """(2, taxels), places of a pad's taxels in pitches."""
    count = hand.starts[pad + 1] - hand.starts[pad]
    return np.ascontiguousarray(hand.places[pad, :, :count])


def room_for(scans: Scans) -> Rows:
    """Rows to be filled in."""
    shape = scans.contact.shape
    return Rows(np.empty((2, *shape, 3)), np.empty((2, *shape, 3, 3)), np.empty((3, *shape)), np.empty(shape, np.uint8))
