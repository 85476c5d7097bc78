"""Simulation of a scenario: scans of a known motion with known sensor errors."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, fields, replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow.acquire.base import HAND, Recording, Truth
from taxelflow.acquire.blocks import cut_up
from taxelflow.acquire.npz import write_npz
from taxelflow.errors import NameUnknown, ParameterInvalid
from taxelflow.messages import RawScans
from taxelflow.numerics.geometry import inverse_transform
from taxelflow.runtime.whole_file import whole_file
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.simulation.contact import taxel_pressure
from taxelflow.simulation.load import State, state_at
from taxelflow.simulation.motion import move
from taxelflow.simulation.parameters import Second
from taxelflow.simulation.pattern import Analytic
from taxelflow.simulation.scenario import SCENARIOS, Scenario
from taxelflow.simulation.sensing import clock, delays, reported, sense

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats
    from taxelflow.sensors.layout import Layout
    from taxelflow.simulation.pattern import Pattern


def simulate(scenario: Scenario | str) -> Recording:
    """The scenario's recording, with truth, in memory. Raises NameUnknown, ParameterInvalid, ExtraMissing.

    scenario: parameters, or a name of `SCENARIOS`, such as `stroke`.
    Times of the truth are the true times of the scans' starts; times of the scans are the sensor's time stamps.
    """
    if isinstance(scenario, str):
        if scenario not in SCENARIOS:
            raise NameUnknown("scenario", scenario, SCENARIOS)
        scenario = SCENARIOS[scenario]
    sensor = load_sensor(scenario.sensor)
    layout = sensor.layout
    touched = _touched(scenario, layout)
    for taxel in scenario.sensing.dead:
        if not 0 <= taxel < layout.taxels:
            raise ParameterInvalid("sensing.dead", taxel, f"list taxels between 0 and {layout.taxels - 1}")
    _check_size(scenario, layout)
    random = np.random.default_rng(scenario.seed)
    t_s = clock(scenario.sensing, scenario.motion.duration_s, random)
    pressure = pressures(scenario, layout, touched, t_s)
    if scenario.second.there:
        pressure = pressure + pressures(of_second(scenario), layout, touched, t_s)
    values = sense(scenario.sensing, pressure, t_s, random, scenario.seed) / sensor.to_si
    scans = RawScans(reported(scenario.sensing, t_s, scenario.seed), sensor.channel_map.to_source(values))

    sensor = msgspec.structs.replace(sensor, unseen_error=0.0)  # the rig's sensor has no such faults
    if scenario.sensing.scan_share:
        sensor = msgspec.structs.replace(sensor, delay_s=tuple(delays(scenario.sensing, layout.taxels).tolist()))
    name = f"simulated, seed {scenario.seed}"
    path = move(scenario.motion, t_s, scenario.seed)
    second = move(scenario.second.motion, t_s, scenario.seed + 1).pose if scenario.second.there else None
    truth = Truth(scenario.pad, t_s, path.pose, path.slipping, second)
    return Recording(name, "rig", sensor, lambda: cut_up(scans), scans=len(scans), truth=truth)


def of_second(scenario: Scenario) -> Scenario:
    """The scenario of the second object alone, with a seed of its own."""
    second = scenario.second
    alone = replace(scenario, contact=second.contact, motion=second.motion, load=second.load, second=Second())
    return replace(alone, seed=scenario.seed + 1)


def save(scenario: Scenario, path: Path) -> Recording:
    """Simulate, and write an `.npz` recording with truth and all parameters; atomically."""
    recording = simulate(scenario)
    with whole_file(path) as part:
        write_npz(recording, part, recording.source_blocks(), parameters=json.dumps(asdict(scenario)))
    return recording


def pressures(
    scenario: Scenario, layout: Layout, touched: list[int], t_s: Floats, shift: Floats | None = None
) -> Floats:
    """Pressure in Pa (scans, taxels) on the touched pads, of each taxel at the time at which it is read.

    touched: numbers of pads. t_s: (scans,), true times of the scans' starts. shift: (3,), added to the object's pose in
    every scan, for derivatives.
    """
    delay_s = delays(scenario.sensing, layout.taxels) if scenario.sensing.scan_share else None
    pressure = np.zeros((len(t_s), layout.taxels))
    pattern = _pattern(scenario, layout, touched)
    for pad in touched:
        own = layout.of_pad(pad)
        read_s = t_s[:, np.newaxis] if delay_s is None else t_s[:, np.newaxis] + delay_s[own]
        path = move(scenario.motion, read_s, scenario.seed, scenario.contact.reach_m)
        state = state_at(scenario.load, scenario.motion, read_s, scenario.contact.deform_1_m * path.travelled_m)
        pose = _in_pad(path.pose, layout.T_hand[pad]) if _on_hand(scenario, layout) else path.pose
        pose = pose if shift is None else pose + shift
        size = scenario.sensing.active_share * layout.pitch_m[pad]
        new, which = _distinct(pose, state)
        distinct = taxel_pressure(
            pattern,
            pose[new],
            State(*(getattr(state, item.name)[new] for item in fields(state))),
            layout.x_m[own],
            layout.y_m[own],
            (float(size[0]), float(size[1])),
        )
        pressure[:, own] = distinct[which]
    return pressure


def _check_size(scenario: Scenario, layout: Layout, copies: int = 5) -> None:
    """Raises ParameterInvalid for a recording whose copies at work do not fit into the machine's memory."""
    most_bytes = _memory_bytes() / copies
    most_hz = most_bytes / (layout.taxels * np.dtype(np.float64).itemsize) / scenario.motion.duration_s
    if scenario.sensing.rate_hz > most_hz:
        lasts = f"{layout.taxels} taxels over {scenario.motion.duration_s:.3g} s"
        duty = f"be at most {most_hz:.3g} Hz, or the motion shorter: {lasts} are more than {most_bytes / 1e9:.1f} GB"
        raise ParameterInvalid("sensing.rate_hz", scenario.sensing.rate_hz, f"{duty}, a fifth of this machine's memory")


def _memory_bytes() -> float:
    """Of the machine; infinite where the system does not report it."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):
        return float("inf")


def _distinct(pose: Floats, state: State) -> tuple[Bools, NDArray[np.int64]]:
    """Whether a scan (scans,) differs from the previous one, and the number (scans,) of the last one that did."""
    numbers = [pose.reshape(len(pose), -1), *(getattr(state, item.name) for item in fields(state))]
    new = np.ones(len(pose), dtype=np.bool_)
    new[1:] = np.any([np.any(values[1:] != values[:-1], axis=1) for values in numbers], axis=0)
    return new, np.cumsum(new) - 1


def _touched(scenario: Scenario, layout: Layout) -> list[int]:
    """Numbers of the pads that the object may touch."""
    pads = layout.pads[: layout.pad_count]
    if _on_hand(scenario, layout):
        placed = [number for number in range(len(pads)) if np.isfinite(layout.T_hand[number]).all()]
        if not placed:
            duty = f"name a pad: no pad of {scenario.sensor} has a position in the hand, origin_m = [x, y]"
            raise ParameterInvalid("pad", HAND, duty)
        return placed
    if scenario.pad not in pads:
        raise NameUnknown("pad", scenario.pad, [*pads, HAND])
    return [pads.index(scenario.pad)]


def _on_hand(scenario: Scenario, layout: Layout) -> bool:
    """Whether the object moves over the whole hand; a pad of that name takes precedence."""
    return scenario.pad == HAND and HAND not in layout.pads


def _pattern(scenario: Scenario, layout: Layout, touched: list[int]) -> Pattern:
    if scenario.solver == "analytic":
        return Analytic(scenario.contact, scenario.load, scenario.seed)
    from taxelflow.simulation.elastic import Elastic

    return Elastic(scenario.contact, scenario.load, scenario.seed, float(layout.pitch_m[touched].min()))


def _in_pad(pose: Floats, T_hand_pad: Floats) -> Floats:
    """Poses (..., 3) of the object in the hand frame, mapped to the frame of a pad."""
    moved: Floats = np.concatenate(
        [inverse_transform(T_hand_pad, pose[..., :2]), pose[..., 2:] - T_hand_pad[2]], axis=-1
    )
    return moved
