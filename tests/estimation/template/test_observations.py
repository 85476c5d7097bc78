from __future__ import annotations

import numpy as np

from taxelflow.estimation.template.observations import strength


def test_readings_almost_without_noise_stand_out_infinitely() -> None:
    """Constant readings have a variance by rounding; pytest makes the overflow's warning an error."""
    assert strength(np.array([5e3, 0.0]), np.full(2, 1e-310)) == np.inf
    assert strength(np.array([5e3, 0.0]), np.zeros(2)) == 0.0
    assert strength(np.full(2, 1e3), np.full(2, 1e-302)) == np.inf
