"""From scans of two facing pads to what a controller is told: all stages of a stream, scan by scan."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow import registry
from taxelflow.acquire.base import Recording
from taxelflow.condition.parameters import Conditioner
from taxelflow.control.base import Touch
from taxelflow.errors import ParameterInvalid
from taxelflow.messages import RawScans
from taxelflow.pipeline import Pipeline

if TYPE_CHECKING:
    from taxelflow.estimation.base import Estimator
    from taxelflow.messages import Floats
    from taxelflow.sensors.sensor import Sensor

_MIRRORED = np.array([[1.0, 1.0, 1.0], [-1.0, 1.0, -1.0]])
"""Signs of x, y, theta: the pads face each other, so the second sees x and turns mirrored."""


class TwoPads:
    """The estimator in the loop. The sensor has two pads alike, which face each other with their y axes parallel."""

    def __init__(self, sensor: Sensor, estimator: Estimator | str | None) -> None:
        """estimator: None for pressures only. Raises ParameterInvalid for a sensor that has not two pads alike."""
        layout = sensor.layout
        if len(layout.pads) != 2 or layout.shapes[0] != layout.shapes[1]:
            raise ParameterInvalid("sensor", sensor.name, "have two pads of the same shape, without groups")
        self._sensor, self._last_s = sensor, np.nan
        self._area_m2 = layout.area_m2[: len(layout.area_m2) // 2]
        self._run = None
        if estimator is not None:
            part = registry.find("estimator", estimator)() if isinstance(estimator, str) else estimator
            pipeline = Pipeline(part, "stream", Conditioner(tare="none"))
            self._run = pipeline.start(Recording.live(sensor))

    def step(self, t_s: float, readings: Floats) -> Touch:
        """readings: (2, taxels), in the sensor's unit."""
        pressure = readings * self._sensor.to_si
        dt_s, self._last_s = (0.0 if np.isnan(self._last_s) else t_s - self._last_s), t_s
        force_n = float((pressure @ self._area_m2).mean())
        slipping, velocity, ready = np.zeros(2, dtype=np.bool_), np.full((2, 3), np.nan), self._run is None
        covariance = np.full((2, 3, 3), np.nan)
        if self._run is not None:
            out = self._run.step(RawScans(np.array([t_s]), readings.reshape(1, -1)))
            if len(out):
                slipping, velocity, ready = out.slipping[-1], _MIRRORED * out.slips.velocity[-1], True
                square_s2 = out.slips.span_s[-1][:, None, None] ** 2
                signs = _MIRRORED[:, :, None] * _MIRRORED[:, None, :]
                covariance = signs * out.slips.displacement_covariance[-1] / square_s2
        return Touch(t_s, dt_s, pressure, force_n, slipping, velocity, covariance, ready)
