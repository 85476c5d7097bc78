"""A layout as the kernels of a stream read it, with workspace."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.levenberg_marquardt import ROOM
from taxelflow.estimation.template.linearization import lanes_for
from taxelflow.estimation.template.observations import delays_of
from taxelflow.estimation.template.online.track_state import Hand, Room
from taxelflow.numerics.bspline import STATE
from taxelflow.numerics.cut import open_sides

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats
    from taxelflow.sensors.layout import Layout


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
    room = Room(np.zeros((18, lanes_for(most))), np.zeros((10 + ROOM, STATE)), np.zeros((2, 3, 3)))
    delay = late if late.any() else np.zeros(0)
    return Hand(places, delay, edge, sides, layout.starts, pitch_m, lead_s, layout.unseen_error, room)


def places_of(hand: Hand, pad: int) -> Floats:
    """(2, taxels), places of a pad's taxels in pitches."""
    count = hand.starts[pad + 1] - hand.starts[pad]
    return np.ascontiguousarray(hand.places[pad, :, :count])
