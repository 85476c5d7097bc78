"""Scans that are registered to the map of a stream: an object that begins to turn where it has rested."""

from __future__ import annotations

import numpy as np
import pytest

from elastic_skin import RATE_HZ, SENSOR, pressed
from synthetic import recorded
from taxelflow.pipeline import api

REST_S, TURN_S = 2.0, 2.0
"""A second without contact, one at rest; then it turns."""


@pytest.mark.parametrize("turn_deg", [40.0, 60.0])
def test_a_turn_in_place_is_known_before_it_has_gone_far(turn_deg: float) -> None:
    t_s = np.arange(round((REST_S + TURN_S + 1.0) * RATE_HZ)) / RATE_HZ
    turn = np.radians(turn_deg) * np.clip((t_s - REST_S) / TURN_S, 0.0, 1.0)
    values = np.stack(
        [2e4 * pressed(turn=angle) if t >= 1.0 else np.zeros(100) for t, angle in zip(t_s, turn, strict=True)]
    )
    values += np.random.default_rng(0).normal(0.0, 100.0, values.shape)
    found = api.estimate(recorded(values, SENSOR, t_s), method="template", mode="stream")["pad0"]
    theta, truth = found.pose[:, 2], np.interp(found.t_s, t_s, turn)
    known = np.flatnonzero(np.isfinite(theta))
    assert truth[known[0]] < np.radians(15.0)
    assert np.isfinite(theta[known[0] :]).all()
    np.testing.assert_allclose(theta[known], truth[known], atol=np.radians(3.0))
