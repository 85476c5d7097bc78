from __future__ import annotations

from typing import Any

import numpy as np

from taxelflow.simulation.load import State
from taxelflow.simulation.parameters import Contact, Load
from taxelflow.simulation.pattern import Analytic
from taxelflow.simulation.texture import feet_of


def contact(shape: Any, **fields: Any) -> Contact:
    return Contact(shape, **{"radius_m": 0.005 if shape == "feet" else 0.009, "aspect": 1.5, **fields})


def state(force: float = 1.0, tilt: float = 0.0, roll_m: float = 0.0, deformed: float = 0.0) -> State:
    return State(*(np.array([[number]]) for number in (force, tilt, roll_m, deformed, 0.0)))


def test_feet_lie_at_given_positions_or_all_over_a_disc() -> None:
    given = contact("feet", feet_at_m=((-0.02, 0.0), (0.02, 0.01)))
    np.testing.assert_array_equal(feet_of(given)[0], [[-0.02, 0.0], [0.02, 0.01]])
    spread, _ = feet_of(contact("feet", feet_on="disc", feet=100, ring_m=0.1))
    apart = np.hypot(*(spread[:, np.newaxis] - spread).T) + np.eye(100)
    assert np.hypot(*spread.T).max() <= 0.1
    assert apart.min() > 0.014  # a square lattice of that density has 17.7 mm


def test_textures_are_drawn_from_the_seed() -> None:
    points = np.linspace(-0.01, 0.01, 50), np.zeros(50)
    one, same, other = (Analytic(contact("textured"), Load(), seed)(*points, state()) for seed in (0, 0, 1))
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 1e4
