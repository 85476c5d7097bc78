"""Results do not depend on the origin of the clock: comparisons of times hold beyond rounding."""

from __future__ import annotations

import numpy as np
import pytest

from costly import mostly_long
from synthetic import grid_sensor, recorded
from taxelflow.estimation.base import Mode
from taxelflow.pipeline import api
from taxelflow.pipeline.result import Result

PITCH_M, SECONDS, TAXELS = 0.003, 6.0, 8
SINCE_1970 = 1.7e9
"""Times since 1970 are rounded to a quarter of a microsecond."""
LIMITS = 1e-5, 1e-5, 1e-3
"""m, m, rad; of `template`, whose maps are adjusted until steps are small: rounding decides when."""
ONE_MAP = 0.02
"""Share of the scans until the next map: a turn is reported once fits agree within a limit, by one map or the next."""


def slid(rate_hz: float, unseen_error: float, method: str, mode: Mode, origin_s: float) -> Result:
    """An object with texture that slides twice, in a grasp whose load wanders."""
    sensor = grid_sensor(TAXELS, TAXELS, pitch_m=(PITCH_M, PITCH_M), unseen_error=unseen_error)
    t_s, random = np.arange(round(SECONDS * rate_hz)) / rate_hz, np.random.default_rng(1)
    load = np.clip((t_s - 0.5) / 0.3, 0.0, 1.0) * (t_s < 5.5)
    way = np.interp(t_s, [2.0, 2.4, 3.5, 4.2], [0.0, 0.003, 0.003, 0.006])
    x, y = sensor.layout.x_m - way[:, np.newaxis], sensor.layout.y_m
    dome = np.maximum(1.0 - (x**2 + y**2) / 0.009**2, 0.0)
    pressure = 4e4 * dome * (1.0 + 0.3 * np.sin(x / 0.0015) * np.sin(y / 0.0018))
    tilt = 1.0 + 3.0 * np.sin(2.0 * np.pi * t_s / 0.9)[:, np.newaxis] * x
    values = load[:, np.newaxis] * pressure * tilt + random.normal(0.0, 100.0, (len(t_s), TAXELS**2))
    return api.estimate(recorded(values, sensor, t_s + origin_s), method, mode=mode)


@pytest.mark.parametrize("mode", ["batch", "stream"])
@pytest.mark.parametrize("unseen_error", [0.0, 0.05])
@pytest.mark.parametrize("method", mostly_long(["convolution", "registration", "template"], "convolution"))
@pytest.mark.parametrize("rate_hz", [25.0, 100.0, 125.0])  # 0.1 s are a whole or a half number of scans
def test_results_do_not_depend_on_the_origin_of_the_clock(
    rate_hz: float, unseen_error: float, method: str, mode: Mode
) -> None:
    own, later = (slid(rate_hz, unseen_error, method, mode, origin_s) for origin_s in (0.0, SINCE_1970))
    np.testing.assert_array_equal(own.slipping, later.slipping)
    np.testing.assert_array_equal(own.slips.quality, later.slips.quality)
    for axis, limit in enumerate(LIMITS):
        places = np.array([result.slips.pose[..., axis] for result in (own, later)])
        known = np.isfinite(places)
        np.testing.assert_allclose(*places[:, known.all(axis=0)], rtol=0.0, atol=limit)
        assert np.mean(known[0] != known[1]) <= (ONE_MAP if axis == 2 else 0.0)
    assert [event.event for event in own.events] == [event.event for event in later.events]
    onsets = np.array([[one.onset_s for one in result.events] for result in (own, later)])
    np.testing.assert_allclose(onsets[0], onsets[1] - SINCE_1970, atol=1e-5)
