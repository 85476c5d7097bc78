"""From scans of two facing pads to what a controller is told: all stages of a stream, scan by scan.

`TwoPads` runs a pipeline of its own. A loop around `taxelflow.Live` gives each scan and its output to `Facing`.
"""

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
    from taxelflow.pipeline import Output
    from taxelflow.sensors.sensor import Sensor

_MIRRORED = np.array([[1.0, 1.0, 1.0], [-1.0, 1.0, -1.0]])
"""Signs of x, y, theta: the pads face each other, so the second sees x and turns mirrored."""


class Facing:
    """What the output of a stream says of two pads. They face each other, with their y axes parallel."""

    def __init__(self, sensor: Sensor) -> None:
        """Raises ParameterInvalid for a sensor that has not two pads alike."""
        layout = sensor.layout
        if len(layout.pads) != 2 or layout.shapes[0] != layout.shapes[1]:
            raise ParameterInvalid("sensor", sensor.name, "have two pads of the same shape, without groups")
        self._to_si, self._last_s = sensor.to_si, np.nan
        self._area_m2 = layout.area_m2[: len(layout.area_m2) // 2]

    def touch(self, t_s: float, readings: Floats, out: Output | None) -> Touch:
        """readings: (2, taxels), in the sensor's unit. out: of this scan; None without an estimator."""
        pressure = readings * self._to_si
        dt_s, self._last_s = (0.0 if np.isnan(self._last_s) else t_s - self._last_s), t_s
        force_n = float((pressure @ self._area_m2).mean())
        slipping, velocity, ready = np.zeros(2, dtype=np.bool_), np.full((2, 3), np.nan), out is None
        covariance, detail_m = np.full((2, 3, 3), np.nan), np.full(2, np.nan)
        if out is not None and len(out):
            slipping, velocity, ready = out.slipping[-1], _MIRRORED * out.slips.velocity[-1], True
            square_s2 = out.slips.span_s[-1][:, None, None] ** 2
            signs = _MIRRORED[:, :, None] * _MIRRORED[:, None, :]
            covariance = signs * out.slips.displacement_covariance[-1] / square_s2
            detail_m = _detail_m(out)
        return Touch(t_s, dt_s, pressure, force_n, slipping, velocity, covariance, detail_m, ready)


def _detail_m(out: Output) -> Floats:
    """(2,): the noise of a displacement, between two scans, over that of the force, as a share of the force."""
    variance = out.slips.displacement_covariance[-1]
    xx, xy, yy = variance[:, 0, 0], variance[:, 0, 1], variance[:, 1, 1]
    least = (xx + yy) / 2 - np.hypot((xx - yy) / 2, xy)  # eigenvalue
    detail_m: Floats = np.sqrt(least.clip(0.0) / 2) * out.contacts.force[-1] / out.contacts.force_std[-1]
    return detail_m


class TwoPads:
    """The estimator in the loop."""

    def __init__(self, sensor: Sensor, estimator: Estimator | str | None) -> None:
        """estimator: None for pressures only. Raises ParameterInvalid for a sensor that has not two pads alike."""
        self._facing, self._run = Facing(sensor), None
        if estimator is not None:
            part = registry.find("estimator", estimator)() if isinstance(estimator, str) else estimator
            pipeline = Pipeline(part, "stream", Conditioner(tare="none"))
            self._run = pipeline.start(Recording.live(sensor))

    def step(self, t_s: float, readings: Floats) -> Touch:
        """readings: (2, taxels), in the sensor's unit."""
        out = None if self._run is None else self._run.step(RawScans(np.array([t_s]), readings.reshape(1, -1)))
        return self._facing.touch(t_s, readings, out)
