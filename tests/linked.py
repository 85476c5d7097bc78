"""A hand whose two pads ride on a sliding link, and recordings of it with the joint's position."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from synthetic import dome
from taxelflow.messages import Joints
from taxelflow.pipeline.api import convert, recording
from taxelflow.sensors.catalogue import load_sensor

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.sensors.sensor import Sensor

SPEED_M_S = 0.01
"""Of the link along x."""
_SLIDE = """<robot name="slide"><link name="base"/><link name="finger"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="finger"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
_PAD = """[[pads]]
name = "{name}"
rows = 8
cols = 8
pitch_m = [0.004, 0.004]
link = "finger"
pose = [0, {y}, 0, 0, 0, 0, 1]
"""
_IDLE, _SCANS, _RATE_HZ = 20, 70, 50.0


def linked_hand(folder: Path) -> Sensor:
    """Two pads beside each other on a link that slides along x; its sensor file and model lie in the folder."""
    (folder / "slide.urdf").write_text(_SLIDE)
    pads = "".join(_PAD.format(name=name, y=y) for name, y in (("left", -0.03), ("right", 0.03)))
    path = folder / "hand.toml"
    path.write_text(f'name = "sliding"\nunit = "Pa"\n[hand]\nurdf = "slide.urdf"\nbase = "base"\n{pads}')
    return load_sensor(str(path))


def carried(folder: Path, name: str, *, stays: bool) -> Path:
    """A recording in which the link slides; its object rides on the pads, or stays where it is, so that it slips."""
    sensor = linked_hand(folder)
    t_s = np.arange(_SCANS) / _RATE_HZ
    slid_m = SPEED_M_S * np.clip(t_s - _IDLE / _RATE_HZ, 0.0, None)
    values = np.random.default_rng(3).normal(0.0, 100.0, (_SCANS, sensor.layout.taxels))
    for scan in range(_IDLE, _SCANS):
        at_m = 0.005 - slid_m[scan] if stays else 0.0
        values[scan] += sum(dome(sensor, at_m, radius_m=0.004, pad=pad) for pad in (0, 1))
    held = replace(recording(t_s, values, sensor), joints=Joints(("slide",), t_s, slid_m[:, np.newaxis]))
    convert(held, folder / name)
    return folder / name
