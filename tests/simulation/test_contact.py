from __future__ import annotations

import numpy as np
import pytest

from taxelflow.messages import Floats
from taxelflow.simulation.contact import taxel_pressure
from taxelflow.simulation.load import State
from taxelflow.simulation.parameters import Contact, Load
from taxelflow.simulation.pattern import Analytic, Pattern

STATE = State(*(np.array([[number]]) for number in (1.0, 0.0, 0.0, 0.0, 0.0)))
SIZE_M = (0.004, 0.003)
X, Y = np.array([-0.004, 0.0, 0.006]), np.array([0.002, 0.0, -0.005])


def mean_on_a_fine_grid(pattern: Pattern, pose: Floats) -> Floats:
    """Midpoint rule with 200 x 200 points a taxel."""
    steps = (np.arange(200) - 99.5) / 200
    dx, dy = (grid.ravel() for grid in np.meshgrid(steps * SIZE_M[0], steps * SIZE_M[1]))
    x, y = X[:, np.newaxis] + dx - pose[0], Y[:, np.newaxis] + dy - pose[1]
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return pattern(cos * x + sin * y, cos * y - sin * x, STATE).mean(axis=1)


@pytest.mark.parametrize(("shape", "tolerance"), [("airbag", 1e-6), ("bulb", 1e-6), ("feet", 1e-6), ("hertz", 1e-2)])
def test_a_taxel_reads_the_mean_over_its_area(shape: str, tolerance: float) -> None:
    pattern = Analytic(Contact(shape, radius_m=0.009), Load(), 0)  # type: ignore[arg-type]
    pose = np.array([0.001, -0.002, 0.4])
    seen = taxel_pressure(pattern, pose[np.newaxis, np.newaxis], STATE, X, Y, SIZE_M)
    np.testing.assert_allclose(seen[0], mean_on_a_fine_grid(pattern, pose), rtol=tolerance, atol=tolerance * 80e3)


def test_each_taxel_may_be_read_at_its_own_pose() -> None:
    pattern = Analytic(Contact(radius_m=0.009), Load(), 0)
    poses = np.array([[[0.0, 0.0, 0.0], [0.001, 0.0, 0.2], [0.002, 0.001, 0.4]]])
    state = State(*(np.repeat(field, 3, axis=1) for field in (STATE.force, *[np.zeros((1, 1))] * 4)))
    together = taxel_pressure(pattern, poses, state, X, Y, SIZE_M)
    alone = [taxel_pressure(pattern, poses[:, k : k + 1], STATE, X, Y, SIZE_M)[0, k] for k in range(3)]
    np.testing.assert_allclose(together[0], alone)
