"""The unit of a message's readings, where it is not that of the built-in sensor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from taxelflow.sensors.catalogue import builtin_sensors, load_sensor

if TYPE_CHECKING:
    from taxelflow.acquire.ros.kinds import Kind
    from taxelflow.sensors.sensor import Sensor


def in_unit_of(kind: Kind, sensor: Sensor) -> Sensor:
    """The built-in sensor of this message in the message's unit, however it was named; any other sensor as it is, for
    a sensor file states the unit itself.
    """
    if kind.unit in ("", sensor.unit) or sensor.name not in kind.sensors:
        return sensor
    if sensor.name not in builtin_sensors() or sensor != load_sensor(sensor.name):
        return sensor
    full = None if sensor.full_scale is None else sensor.full_scale * sensor.to_si
    return msgspec.structs.replace(sensor, unit=kind.unit, scale_pa=None, full_scale=full)
