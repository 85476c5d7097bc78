"""The load of the live bench: a hand all of whose pads are touched, and let go every few seconds."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow.messages import RawScans
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.simulation.scenario import SCENARIOS, Contact, Motion, Scenario
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from taxelflow.sensors.layout import Layout
    from taxelflow.sensors.sensor import Sensor
    from taxelflow.simulation.scenario import Sensing

_STROKE = SCENARIOS["stroke"]
BASELINE_PA = _STROKE.sensing.baseline_pa[1]
"""Readings without load."""


def loaded_hand(
    seconds: float, rate_hz: float, *, idle_s: float = 0.3, every_s: float = 5.0, lift_s: float = 0.5
) -> tuple[Sensor, RawScans]:
    """Scans of the paper's hand, 162 taxels: on each of 7 pads an object slides to and fro. All begin after `idle_s`,
    and lift off for `lift_s` at the end of every `every_s`. Without groups, whose slips would be counted beside their
    pads'.
    """
    sensor = msgspec.structs.replace(load_sensor(_STROKE.sensor), groups=())
    layout, count = sensor.layout, round(seconds * rate_hz)
    touch = np.zeros((count, layout.taxels))
    sensing = replace(_STROKE.sensing, rate_hz=rate_hz, baseline_pa=(BASELINE_PA, BASELINE_PA), noise_pa=0.0, bits=16)
    for pad in range(len(layout.pads)):
        scenario = to_and_fro(layout, pad, sensing, seconds=seconds, radius_pitches=1.2)
        own = layout.of_pad(pad)
        touch[:, own] = simulate(scenario).load().values[:count, own]
    t_s = np.arange(count) / rate_hz
    baseline, noise = BASELINE_PA / sensor.to_si, _STROKE.sensing.noise_pa / sensor.to_si
    touched = (t_s > idle_s) & (t_s % every_s < every_s - lift_s)
    values = baseline + (touch - baseline) * touched[:, np.newaxis]
    return sensor, RawScans(t_s, values + np.random.default_rng(0).normal(0, noise, values.shape))


def to_and_fro(
    layout: Layout, pad: int, sensing: Sensing, *, seconds: float, radius_pitches: float, speed_m_s: float = 0.01
) -> Scenario:
    """An object that slides by a pitch to and fro on one pad, for as long at least."""
    pitch_m = float(layout.pitch_m[pad].min())
    motion = Motion(
        speed_m_s=speed_m_s,
        direction_rad=0.7,
        travel_m=pitch_m,
        strokes=int(np.ceil(seconds * speed_m_s / pitch_m)) + 2,
        middle_m=(0.0, 0.0),
        rest_s=0.0,
    )
    contact = Contact("elongated", radius_m=radius_pitches * pitch_m, aspect=1.5)
    return replace(_STROKE, pad=layout.pads[pad], seed=pad, contact=contact, motion=motion, sensing=sensing)
