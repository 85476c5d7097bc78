"""The rates of reading: of any recording, whatever its source sends."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.acquire.base import Recording
from taxelflow.evaluation.bench_effort import Effort
from taxelflow.evaluation.bench_reading import reading_rates
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor

if TYPE_CHECKING:
    from pathlib import Path


def test_a_sensor_in_an_order_of_its_own_is_read_from_every_format(tmp_path: Path) -> None:
    pad = Pad("pad", 2, 3, (0.004, 0.004), order="column-major", start=2)
    sensor = Sensor("own", "count", (pad,), channels=10, offset=3.0)
    recording = Recording.of_arrays(np.arange(20) / 100, np.random.default_rng(0).integers(0, 9, (20, 6)), sensor)
    rates = reading_rates(recording, tmp_path, Effort(readings=1))
    assert {"npz", "csv", "mcap", "bag"} <= {rate.format for rate in rates}
    assert all(rate.scans_per_s > 0 for rate in rates)
