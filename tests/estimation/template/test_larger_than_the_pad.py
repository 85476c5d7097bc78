"""A textured plate that is larger than the pad: its centre of pressure stays while it slides through."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from synthetic import grid_sensor, recorded
from taxelflow.estimation.template.centre_of_pressure import Anchor
from taxelflow.messages import OK
from taxelflow.pipeline import api

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.pipeline.result import Result

RATE_HZ = 50.0
X_M = np.concatenate([np.zeros(50), 0.015 * np.arange(1, 101) / RATE_HZ, np.full(25, 0.03)])
"""Places: at rest, 15 mm/s over the length of the pad, at rest."""


@cache
def slid(unseen_error: float) -> tuple[Result, Floats, Floats]:
    """A stream of it; the error of its poses in contact, m, and whether the object moves."""
    sensor, random = grid_sensor(10, 10, pitch_m=(0.003, 0.003), unseen_error=unseen_error), np.random.default_rng(0)
    layout, plate = sensor.layout, np.zeros((len(X_M), 100))
    for (x, y), height in zip(random.uniform(-0.06, 0.06, (150, 2)), random.uniform(0.3, 1, 150), strict=True):
        squared = (layout.x_m - x - X_M[:, np.newaxis]) ** 2 + (layout.y_m - y) ** 2
        plate += height * 20e3 * np.exp(-squared / (2 * 0.004**2))
    values = np.concatenate([np.zeros((40, 100)), plate]) + np.random.default_rng(1).normal(
        0, 100, (40 + len(X_M), 100)
    )
    result = api.estimate(recorded(values, sensor, np.arange(len(values)) / RATE_HZ), "template", mode="stream")
    touched = result.slips.contact[:, 0]
    true = X_M[-int(touched.sum()) :]
    error = result.slips.pose[touched, 0, 0] - true
    return result, error - np.median(error[:30]), np.diff(true, prepend=true[0]) > 0


@pytest.mark.long
@pytest.mark.parametrize("unseen_error", [0.0, 0.05])
def test_a_stream_follows_it_over_the_length_of_the_pad(unseen_error: float) -> None:
    result, error, _ = slid(unseen_error)
    assert abs(error[-1]) < 3e-4
    settled = np.abs(error[-120:])  # once the map is known
    assert settled.max() < 1.5e-3
    touched = result.slips.contact[:, 0]
    ok = result.slips.quality[touched, 0] == OK
    assert ok.mean() > 0.5
    deviation = np.sqrt(result.slips.covariance[touched, 0, 0, 0])
    wrong = ok & (np.abs(error) > 3 * deviation) & (np.abs(error) > 3e-4)
    assert wrong.mean() < 0.02


def test_what_was_found_for_a_scan_is_held_by_its_time() -> None:
    anchor = Anchor(np.zeros(2), 1.0, np.zeros(2), np.array([0.1, 0.2, 0.4]), np.arange(6.0).reshape(3, 2))
    held = anchor.held(np.array([0.2, 0.3, 0.4]))
    np.testing.assert_array_equal(held, [[2.0, 3.0], [np.nan, np.nan], [4.0, 5.0]])
