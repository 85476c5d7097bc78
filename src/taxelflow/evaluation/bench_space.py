"""A step of the fusion in space: the whole of it, and its kernel, on scans of a grasp by three spread fingers."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.acquire.joints import asked_joints
from taxelflow.errors import ExtraMissing
from taxelflow.evaluation.bench_peers import RATE_HZ
from taxelflow.fusion.spatial.parameters import SpatialField
from taxelflow.fusion.spatial.session import SpatialSession
from taxelflow.messages import cut
from taxelflow.pipeline import api
from taxelflow.simulation.grasp import Grasp, simulate_grasp

if TYPE_CHECKING:
    from collections.abc import Callable

    from taxelflow.messages import Floats, Slips
    from taxelflow.sensors.sensor import Sensor

_HAND = "barretthand-162"
"""That of the grasp."""
_WARM = 60
"""Scans until the window is full, and all contacts are anchored."""


def space_steps(sensor: Sensor) -> dict[str, Callable[[int], object]]:
    """Steps by name, of six pads in contact whose fingers rest; none without MuJoCo, or for another hand."""
    if sensor.name != _HAND:
        return {}
    try:
        recording = simulate_grasp(Grasp(strokes=2, fingers_rad=0.0)).recording
    except ExtraMissing:
        return {}
    result = api.estimate(recording, "convolution", mode="stream")
    held = np.flatnonzero(result.slips.contact.sum(axis=1) >= 6).tolist()
    there_and_back = [*held, *held[-2:0:-1]]

    def scan(number: int) -> tuple[Slips, Floats]:
        k = there_and_back[number % len(there_and_back)]
        slips = replace(cut(result.slips, k, k + 1), t_s=np.array([number / RATE_HZ]))
        return slips, result.contacts.centroid[k : k + 1]

    joints = asked_joints("spread", recording.sensor)
    whole, alone = (SpatialField().start(recording.sensor, joints) for _ in range(2))
    if not (isinstance(whole, SpatialSession) and isinstance(alone, SpatialSession)):
        raise TypeError("a hand on links with joint angles has a motion in space")
    for number in range(_WARM):
        whole.step(*scan(number))
        alone.step(*scan(number))
    prepared = alone.prepare(*scan(_WARM))
    return {"stage space": lambda k: whole.step(*scan(_WARM + k)), "space kernel": lambda _: alone.fuse(prepared)}
