"""When a stream gives a map up: a map that is still to learn from scans which it does not explain is kept."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.template.test_residual_process import track
from synthetic import grid_sensor, recorded
from taxelflow.estimation.template.online.explained import UNEXPLAINED
from taxelflow.estimation.template.online.output import is_given_up
from taxelflow.estimation.template.online.track_state import Track
from taxelflow.messages import LOST, OK, Floats
from taxelflow.numerics.records import record
from taxelflow.pipeline import api

PITCH_M = 0.004
SENSOR = grid_sensor(12, 16, pitch_m=(PITCH_M, PITCH_M))
BARS_M = ((-0.012, -0.003, -0.006, 0.006), (-0.003, 0.014, -0.002, 0.002), (0.0085, 0.0105, -0.005, -0.002))
"""A key's bow, shaft and bit: left, right, lower and upper end."""


def covered(place_m: Floats, low_m: float, high_m: float) -> Floats:
    """Share of each taxel between two ends."""
    above, below = np.maximum(place_m - PITCH_M / 2, low_m), np.minimum(place_m + PITCH_M / 2, high_m)
    share: Floats = np.maximum(below - above, 0.0) / PITCH_M
    return share


def key(x_m: float, y_m: float = -0.0013) -> Floats:
    """(taxels,), share of each that a key covers."""
    layout = SENSOR.layout
    parts = [
        covered(layout.x_m, x_m + left, x_m + right) * covered(layout.y_m, y_m + low, y_m + high)
        for left, right, low, high in BARS_M
    ]
    whole: Floats = np.sum(parts, axis=0)
    return whole


@pytest.mark.parametrize("rate_hz", [200.0, 500.0])
def test_a_key_that_slides_soon_after_touch_down_is_not_lost_at_high_rates(rate_hz: float) -> None:
    """Taxels differ by 20 %, so that the map of the key at rest does not explain the key elsewhere."""
    random = np.random.default_rng(2)
    gains = np.clip(1.0 + 0.2 * random.normal(size=len(SENSOR.layout.x_m)), 0.5, 1.6)
    t_s = np.arange(round(0.8 * rate_hz)) / rate_hz
    x_m = 0.01 * (np.clip((t_s - 0.25) / 0.2, 0.0, 1.0) - 0.5)
    load = 2e4 * np.clip((t_s - 0.08) / 0.03, 0.0, 1.0)
    values = load[:, np.newaxis] * gains * np.stack([key(x) for x in x_m])
    values += random.normal(0.0, 100.0, values.shape)
    slips = api.estimate(recorded(values, SENSOR, t_s), "template", mode="stream").slips
    assert LOST not in slips.quality
    known = np.flatnonzero(slips.quality[:, 0] == OK)
    assert len(known)
    error = slips.pose[known, 0, 0] - x_m[known]
    std = np.sqrt(slips.covariance[known, 0, 0, 0] + slips.covariance[known[0], 0, 0, 0])
    assert (np.abs(error - error[0]) < 3.0 * std + 1e-4).all()


@pytest.mark.parametrize(
    ("learned_s", "left", "probation", "given_up"),
    [
        (0.9, 0.2, 0.0, False),
        (1.0, 0.2, 0.0, True),
        (1.0, 0.05, 0.0, False),
        (0.9, 1.1 * UNEXPLAINED.most, 0.0, True),
        (0.9, 0.2, 1.0, True),
    ],
)
def test_a_map_learns_before_it_is_given_up(learned_s: float, left: float, probation: float, given_up: bool) -> None:
    """left: share of the readings that it leaves. Of another object, or if it was just recognised, it does not wait."""
    m = record(Track, track(), 0)
    m.poor, m.poor_s, m.learned_s, m.unexplained, m.probation = 20.0, 1.0, learned_s, left, probation
    assert is_given_up(m) == given_up
