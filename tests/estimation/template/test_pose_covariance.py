"""The covariance of a registered pose, from the information on the state."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from compiled import compiled
from taxelflow.estimation.template.levenberg_marquardt import HELD
from taxelflow.estimation.template.online.output import _invert

SCALE = 0.003
UNITS = np.array([SCALE, SCALE, 1.0])
invert = compiled(_invert)


@given(seed=st.integers(0, 2**32 - 1), held=st.sets(st.sampled_from([0, 1, 2, 4])))
def test_it_is_the_pose_block_of_the_inverse(seed: int, held: set[int]) -> None:
    root = np.random.default_rng(seed).normal(0, 1, (5, 7))
    information = root @ root.T
    for part in held:
        information[part], information[:, part] = 0.0, 0.0
        information[part, part] = HELD
    found = np.empty((3, 3))
    invert(information, SCALE, found)
    expected = np.linalg.inv(information + 1e-12 * np.eye(5))[:3, :3] * np.outer(UNITS, UNITS)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-15)


def test_without_information_it_is_a_unit_matrix() -> None:
    found = np.empty((3, 3))
    invert(np.diag([1.0, 1.0, -1.0, 1.0, 1.0]), SCALE, found)
    np.testing.assert_allclose(found, np.diag(UNITS**2))
