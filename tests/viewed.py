"""A history with a slip of known direction, made without the pipeline."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import OK, Event, Motions, Slips
from taxelflow.publish.view.history import History, Results

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.sensors.layout import Layout
    from taxelflow.sensors.sensor import Sensor

RATE_HZ = 20.0
SPEED_M_S = 0.03


def slips_of(layout: Layout, t_s: Floats, pad: int, direction_rad: float, slipping: Floats) -> Results:
    """Results in which one pad is touched, and slips where told."""
    scans, pads = len(t_s), len(layout.pads)
    contact = np.zeros((scans, pads), dtype=np.bool_)
    contact[:, pad] = True
    unknown = np.full((scans, pads, 3), np.nan)
    displacement, pose = unknown.copy(), unknown.copy()
    step = SPEED_M_S / RATE_HZ * np.array([np.cos(direction_rad), np.sin(direction_rad)])
    displacement[:, pad] = np.column_stack([slipping[:, np.newaxis] * step, np.zeros(scans)])
    pose[:, pad] = 0.0
    covariance = np.tile(1e-12 * np.eye(3), (scans, pads, 1, 1))
    flags = contact & (slipping > 0)[:, np.newaxis]
    slips = Slips(
        t_s,
        contact,
        np.zeros((scans, pads, 2), dtype=np.bool_),
        displacement,
        pose,
        covariance,
        covariance,
        np.full((scans, pads), 1 / RATE_HZ),
        np.zeros((scans, pads)),
        np.where(contact, 1e4, 0.0),
        np.full((scans, pads), np.nan),
        np.where(contact, OK, 0).astype(np.uint8),
    )
    nothing, pair = np.full(scans, np.nan), np.full((scans, 2), np.nan)
    three, square = np.full((scans, 3), np.nan), np.full((scans, 3, 3), np.nan)
    motions = Motions(t_s, three, square, nothing, nothing, pair, pair, three, square, flags.sum(axis=1))
    return Results(slips, flags, motions, np.where(flags, 2.0, -2.0))


def viewed(sensor: Sensor, pad: str, direction_rad: float, scans: int = 60) -> History:
    """3 s of a recording at 20 Hz: the middle of a pad is loaded, and slips from 1 s to 2 s."""
    layout = sensor.layout
    number, t_s = layout.pads.index(pad), 10.0 + np.arange(scans) / RATE_HZ
    own = layout.of_pad(number)
    pressure = np.zeros((scans, layout.taxels))
    here = np.hypot(layout.x_m[own] - layout.x_m[own].mean(), layout.y_m[own] - layout.y_m[own].mean())
    pressure[:, own] = 2e4 * np.exp(-0.5 * (here / (1.2 * layout.pitch_m[number].max())) ** 2)
    slipping = np.where((t_s >= 11.0) & (t_s < 12.0), 1.0, 0.0)
    history = History()
    history.see(t_s, pressure)
    events = [Event(10.0, pad, "contact"), Event(11.05, pad, "slip_start", 11.0), Event(12.0, pad, "slip_stop", 12.0)]
    history.add(slips_of(layout, t_s, number, direction_rad, slipping), events)
    history.complete = True
    return history
