"""Conversion of readings from the sensor's own unit to SI units; no other module converts readings."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import Floats

if TYPE_CHECKING:
    from taxelflow.sensors.sensor import Sensor

SATURATED_SHARE = 0.9995
"""A reading above this share of full scale is saturated: converters stop a step short of it."""

_SMALL = 1e150
"""A factor below this and a number whose square is finite have a finite product."""


def in_si(values: Floats, sensor: Sensor) -> Floats:
    """Readings (scans, taxels) in Pa (counts for a sensor without a scale); what is not finite is missing: NaN."""
    power = float(np.vdot(values, values))  # finite only if all are; in a stream far sooner than a look at each
    if isfinite(power) and sensor.to_si < _SMALL:
        usual: Floats = values * sensor.to_si
        return usual
    with np.errstate(over="ignore"):
        si = values * sensor.to_si
    finite = np.isfinite(si)
    if not finite.all():
        si[~finite] = np.nan
    return si


def full_scale(sensor: Sensor) -> Floats:
    """(taxels,) in the same unit, where each taxel's reading saturates; inf if unknown."""
    gain = sensor.channel_map.gain  # a gain is in the readings, but not in what the sensor file calls full scale
    return (sensor.full_scale or np.inf) * gain * sensor.to_si
