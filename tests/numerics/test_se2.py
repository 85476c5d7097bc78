from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from taxelflow.messages import Floats
from taxelflow.numerics.geometry import rotation
from taxelflow.numerics.se2 import rotate, rotate_back
from taxelflow.runtime.compiling import kernel


@kernel
def both(theta: float, point: Floats, out: Floats) -> None:
    cos, sin = np.cos(theta), np.sin(theta)
    out[0, 0], out[0, 1] = rotate(cos, sin, point[0], point[1])
    out[1, 0], out[1, 1] = rotate_back(cos, sin, point[0], point[1])


@given(theta=st.floats(-4, 4), x=st.floats(-1, 1), y=st.floats(-1, 1))
def test_rotations_are_those_of_geometry(theta: float, x: float, y: float) -> None:
    point, out = np.array([x, y]), np.empty((2, 2))
    both(theta, point, out)
    np.testing.assert_allclose(out, [rotation(theta) @ point, rotation(theta).T @ point], atol=1e-15)
