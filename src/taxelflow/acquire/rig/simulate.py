"""A scenario carried out: scans with known faults of a known motion."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow.acquire.base import BLOCK_SCANS, Recording, Truth
from taxelflow.acquire.rig.contact import taxel_pressure
from taxelflow.errors import NameUnknown, ParameterInvalid
from taxelflow.layout import load_sensor
from taxelflow.messages import RawScans, cut

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from taxelflow.acquire.rig.scenario import Motion, Scenario, Sensing
    from taxelflow.layout import Layout
    from taxelflow.messages import Floats


def simulate(scenario: Scenario) -> Recording:
    """The scenario's recording, with truth, in memory. Raises NameUnknown, ParameterInvalid."""
    sensor = load_sensor(scenario.sensor)
    layout = sensor.layout
    if scenario.pad not in layout.pads:
        raise NameUnknown("pad", scenario.pad, layout.pads)
    for taxel in scenario.sensing.dead:
        if not 0 <= taxel < layout.taxels:
            raise ParameterInvalid("sensing dead", taxel, f"taxels run from 0 to {layout.taxels - 1}")
    random = np.random.default_rng(scenario.seed)
    t_s = _clock(scenario, random)
    pose = trajectory(scenario.motion, t_s)
    pressure = _pressure(scenario, layout, pose)
    values = sense(scenario.sensing, pressure, random) / sensor.to_si
    scans = RawScans(t_s, values)

    def read() -> Iterator[RawScans]:
        for start in range(0, len(scans), BLOCK_SCANS):
            yield cut(scans, start, min(start + BLOCK_SCANS, len(scans)))

    name = f"simulated, seed {scenario.seed}"
    return Recording(name, "rig", sensor, read, scans=len(scans), truth=Truth(scenario.pad, t_s, pose))


def save(scenario: Scenario, path: Path) -> Recording:
    """Simulate and write an `.npz` recording with truth and every parameter in it; whole or not at all."""
    recording = simulate(scenario)
    scans, truth = recording.load(), recording.truth
    if truth is None:
        raise RuntimeError("the rig always knows the truth")
    part = path.with_name(path.name + ".part")
    with part.open("wb") as file:
        np.savez(
            file,
            t=scans.t_s,
            pressure=scans.values,
            sensor=np.array(msgspec.json.encode(recording.sensor).decode()),
            truth_pad=np.array(truth.pad),
            truth_t_s=truth.t_s,
            truth_pose=truth.pose,
            parameters=np.array(json.dumps(asdict(scenario))),
        )
    part.replace(path)
    return recording


def trajectory(motion: Motion, t_s: Floats) -> Floats:
    """Pose (times, 3) of the object in the pad's frame: rest, strokes to and fro, rest."""
    stroke_s = motion.stroke_s
    strokes = np.clip((t_s - motion.rest_s) / stroke_s, 0.0, motion.strokes)
    there_and_back = 1.0 - np.abs(strokes % 2.0 - 1.0)  # 0, up to 1 after one stroke, 0 again after two
    along = (there_and_back - 0.5) * motion.travel_m
    pose = np.empty((len(t_s), 3))
    pose[:, 0] = motion.middle_m[0] + along * np.cos(motion.direction_rad)
    pose[:, 1] = motion.middle_m[1] + along * np.sin(motion.direction_rad)
    pose[:, 2] = motion.angle_rad + there_and_back * stroke_s * motion.turn_rad_s
    return pose


def sense(sensing: Sensing, pressure_pa: Floats, random: np.random.Generator) -> Floats:
    """Readings in Pa of pressures (scans, taxels): gain, offset, noise, saturation, quantisation."""
    taxels = pressure_pa.shape[1]
    gain = np.ones(taxels) + sensing.gain_spread * random.standard_normal(taxels)
    gain[list(sensing.dead)] = 0.0
    offset = random.uniform(*sensing.baseline_pa, taxels)
    noise = sensing.noise_pa * random.standard_normal(pressure_pa.shape)
    step = sensing.full_scale_pa / (2**sensing.bits - 1)
    clipped = np.clip(gain * pressure_pa + offset + noise, 0.0, sensing.full_scale_pa)
    readings: Floats = np.round(clipped / step) * step
    return readings


def _clock(scenario: Scenario, random: np.random.Generator) -> Floats:
    """Scan times from 0; where in a scan the robot starts is chance."""
    rate_hz = scenario.sensing.rate_hz
    t_s = (np.arange(int(scenario.motion.duration_s * rate_hz), dtype=np.float64) + random.uniform()) / rate_hz
    return np.asarray(t_s, dtype=np.float64)


def _pressure(scenario: Scenario, layout: Layout, pose: Floats) -> Floats:
    pad = layout.pads.index(scenario.pad)
    own = layout.of_pad(pad)
    size = tuple(scenario.sensing.active_share * layout.pitch_m[pad])
    pressure = np.zeros((len(pose), layout.taxels))
    pressure[:, own] = taxel_pressure(scenario.contact, pose, layout.x_m[own], layout.y_m[own], size)
    return pressure
