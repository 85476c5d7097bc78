"""The load of the live bench: a hand all of whose pads are touched, and let go every few seconds."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow.messages import RawScans
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.simulation.scenario import SCENARIOS, Contact, Motion
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from taxelflow.sensors.sensor import Sensor

_IDLE_S, _LIFT_S, _SPEED_M_S, _BASELINE_PA = 0.3, 0.5, 0.01, 4e3
"""Time without contact at the start; duration of a lift; speed of the object; readings without load."""


def loaded_hand(seconds: float, rate_hz: float, every_s: float = 5.0, seed: int = 0) -> tuple[Sensor, RawScans]:
    """Scans of the paper's hand, 162 taxels: on each of 7 pads an object slides to and fro; all lift off for 0.5 s at
    the end of every `every_s`. Without groups, whose slips would be counted beside their pads'.
    """
    stroke = SCENARIOS["stroke"]
    sensor = msgspec.structs.replace(load_sensor(stroke.sensor), groups=())
    layout, count = sensor.layout, round(seconds * rate_hz)
    touch = np.zeros((count, layout.taxels))
    for pad, name in enumerate(layout.pads):
        pitch_m = float(layout.pitch_m[pad].min())
        scenario = replace(
            stroke,
            pad=name,
            seed=seed + pad,
            contact=Contact("elongated", radius_m=1.2 * pitch_m, aspect=1.5),
            motion=Motion(
                speed_m_s=_SPEED_M_S,
                direction_rad=0.7,
                travel_m=pitch_m,
                strokes=int(np.ceil(seconds * _SPEED_M_S / pitch_m)) + 2,
                middle_m=(0.0, 0.0),
                rest_s=0.0,
            ),
            sensing=replace(
                stroke.sensing, rate_hz=rate_hz, baseline_pa=(_BASELINE_PA, _BASELINE_PA), noise_pa=0.0, bits=16
            ),
        )
        own = layout.of_pad(pad)
        touch[:, own] = simulate(scenario).load().values[:count, own]
    t_s = np.arange(count) / rate_hz
    baseline, noise = _BASELINE_PA / sensor.to_si, stroke.sensing.noise_pa / sensor.to_si
    touched = (t_s > _IDLE_S) & (t_s % every_s < every_s - _LIFT_S)
    values = baseline + (touch - baseline) * touched[:, np.newaxis]
    return sensor, RawScans(t_s, values + np.random.default_rng(seed).normal(0, noise, values.shape))
