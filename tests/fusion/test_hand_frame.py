from __future__ import annotations

import numpy as np

from taxelflow.fusion.hand_frame import Carrier, Home
from taxelflow.fusion.session import nothing
from taxelflow.numerics.geometry import rotation


def test_nothing_is_carried_to_nothing() -> None:
    home = Home(rotation(np.zeros(2)), np.zeros((2, 2)), np.ones((2, 2)), np.ones(2, dtype=np.bool_), 0.3)
    found, *_ = Carrier(home).step(nothing(2), np.zeros((0, 2, 2)), np.zeros((0, 2), dtype=np.bool_), None)
    assert all(not len(part) for part in found)
