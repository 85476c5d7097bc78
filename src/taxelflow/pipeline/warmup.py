"""A made-up recording that leads a stream through all of its kernels, so that none is compiled while scans go by."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import replace

from taxelflow.acquire.base import Recording
from taxelflow.messages import Floats, RawScans
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor
from taxelflow.simulation.parameters import Sensing

if TYPE_CHECKING:
    from collections.abc import Iterator

_PAD = Pad(name="one", rows=8, cols=8, pitch_m=(0.004, 0.004))
_SENSING = Sensing(rate_hz=50.0, noise_pa=100.0, full_scale_pa=200e3)
_PEAK_PA = 30e3
"""Of the object at full load."""
_ALONE = np.arange(45, 112)
"""Scans that come alone."""


def made_up(*, split: bool, space: bool = False) -> Recording:
    """Two pads that touch nothing, then an object that rests, slips and rests on both; lift-off, a gap in time, another
    touch that slips, two objects that part on one pad, a scan with a missing and one with a saturated taxel, lift-off.

    split: separate the contacts of one of the pads. space: give the pads places in space.
    """
    pads = tuple(
        replace(_PAD, name=name, origin_m=(x, 0.0), pose=(x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0) if space else None)
        for name, x in (("one", -0.03), ("other", 0.03))
    )
    sensor = Sensor(name="made-up", unit="Pa", pads=pads, full_scale=_SENSING.full_scale_pa)
    recording = Recording("made up", "memory", sensor, _read)
    return recording.with_contacts({"other": 2}) if split else recording


def _read() -> Iterator[RawScans]:
    """A block of scans, then scan by scan through rest, slip and rest, as kernels of streams and of blocks are
    others, then the other scans; compiling takes the same for any sensor.
    """
    idle = [(0.0, 0.0, 0.0)] * 30
    still, slip = [(1.0, 0.0, 0.0)] * 30, [(1.0, 0.3 * k, 0.0) for k in range(20)]
    rest = [(1.0, 6.0, 0.0)] * 25
    parting = [(1.0, 0.0, 3.0 + 0.2 * k) for k in range(20)]
    steps = idle + still + slip + rest + idle[:10] + still + slip + idle[:10] + parting + idle[:15]
    values = np.stack([np.tile(_reading(*step), 2) for step in steps])
    values += np.random.default_rng(0).normal(0.0, _SENSING.noise_pa, values.shape)
    values[45, 27], values[46, 27] = np.nan, _SENSING.full_scale_pa
    t_s = np.arange(len(values)) / _SENSING.rate_hz
    t_s[120:] += 2.0
    for block in np.split(np.arange(len(values)), _ALONE):
        yield RawScans(t_s[block], values[block])


def _reading(load: float, moved: float, apart: float) -> Floats:
    """(taxels,) of a dome that has moved by this many pitches, or of two of them this many pitches apart."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(float(_PAD.cols)), np.arange(float(_PAD.rows))))
    middle = 0.5 * (_PAD.cols - 1)
    places = [middle - 3.0 + moved] if not apart else [middle - 0.5 * apart, middle + 0.5 * apart]
    width = 1.2 if not apart else 0.6
    domes = [np.exp(-0.5 * ((x - at) ** 2 + (y - middle) ** 2) / width**2) for at in places]
    reading: Floats = load * _PEAK_PA * np.sum(domes, axis=0)
    return reading
