"""Diagnosis of a recording in which no contact is found, or whose readings fall under load."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from taxelflow.condition.baseline import Baseline
    from taxelflow.messages import Floats
    from taxelflow.sensors.sensor import Sensor


@dataclass(frozen=True, slots=True)
class _Touched:
    """When taxels were touched."""

    sigmas: float = 20.0
    """Taxels whose readings span more than this many standard deviations of their noise were touched."""
    share: float = 0.25
    """Share of the taxels with the smallest, and with the largest, span of readings."""
    clearly: float = 4.0
    """Factor by which the latter must span more than the former, and fall more below the idle level than rise above
    it."""
    scans: int = 5
    """Scans from which the noise is known."""


_TOUCHED = _Touched()
_FEWEST = round(1.0 / _TOUCHED.share)
"""Taxels that this test needs: one in each share."""


def no_contact(windows: Floats, learned: Baseline, sensor: Sensor, contact_on: float) -> str:
    """Why no pad was in contact: the readings seen, the noise, and the threshold.

    windows: (windows, scans, taxels) in SI, a sample of the recording. contact_on: in standard deviations.
    """
    what = "no contact: no pad was touched in this recording"
    live = ~learned.masked & np.isfinite(windows).any(axis=(0, 1))
    if not live.any():
        return f"{what}: no taxel has readings"
    readings = windows[:, :, live]
    known = np.isfinite(readings)
    above = readings - learned.offset[live]
    to_unit = 1.0 / sensor.to_si
    lowest = to_unit * float(np.min(readings, initial=np.inf, where=known))
    highest = to_unit * float(np.max(readings, initial=-np.inf, where=known))
    if highest == lowest:
        return f"{what}: all readings are {lowest + 0.0:.4g} {sensor.unit}"  # never -0
    seen = f"{what}: readings range from {lowest:.4g} to {highest:.4g} {sensor.unit}"
    if np.count_nonzero(known.any(axis=2)) < _TOUCHED.scans:
        return f"{seen}; the noise, and so the level at which contact begins, is unknown from so short a recording"
    most = to_unit * float(np.max(above, initial=-np.inf, where=known))
    noise = to_unit * float(np.median(learned.noise[live]))
    limit = f"{contact_on:g} times the noise of {noise:.3g} = {contact_on * noise:.3g} {sensor.unit}"
    middle = to_unit * float(np.median(readings[known]))
    if most > contact_on * noise and middle < -contact_on * noise:
        return (
            f"{seen}, most are near {middle:.4g}; contact begins where a pad's sum is above 0, too: if that is read "
            f"without load, add offset = {middle:.4g} to the sensor file, or --condition.tare start"
        )
    seen = f"{seen}, at most {most:.4g} above idle"
    below = -to_unit * float(np.min(above, initial=0.0, where=known))
    if min(most, below) > contact_on * noise:
        return (
            f"{seen}, but as much as {below:.4g} below it, and contact begins where a pad's sum is above 0, too: if an "
            "object lay on the pad at the start, its load is missing; start without it, or declare full_scale in the "
            "sensor file"
        )
    spread = to_unit * _spread(learned, sensor)
    hidden = f"; a load at rest from first to last scan would be part of the offsets, which differ by {spread:.4g}"
    return f"{seen}; contact begins at {limit}{hidden if spread > contact_on * noise else ''}"


def _spread(learned: Baseline, sensor: Sensor) -> float:
    """From the lowest to the largest offset of a pad, at most."""
    pads = [sensor.layout.of_pad(pad) for pad in range(sensor.layout.pad_count)]
    offsets = [learned.offset[own][~learned.masked[own]] for own in pads]
    return max(float(np.ptp(one)) for one in offsets if one.size)


def falls_under_load(windows: Floats, learned: Baseline, polarity: int) -> str:
    """A note if readings fall where the sensor is touched; empty otherwise. windows: as in `no_contact`. polarity: of
    the sensor.

    The taxels that change least show the idle level. Those that change most deviate from it to one side.
    """
    live = ~learned.masked & np.isfinite(windows).any(axis=(0, 1))
    if live.sum() < _FEWEST:
        return ""
    readings = windows[:, :, live].reshape(-1, int(live.sum()))
    known = np.isfinite(readings)
    lowest = np.min(readings, axis=0, initial=np.inf, where=known)
    highest = np.max(readings, axis=0, initial=-np.inf, where=known)
    span = highest - lowest
    order = np.argsort(span, kind="stable")
    count = max(1, int(_TOUCHED.share * len(span)))
    quiet, active = order[:count], order[-count:]
    moved = float(np.median(span[active]))
    if moved <= _TOUCHED.sigmas * float(np.median(learned.noise[live])):
        return ""
    if moved < _TOUCHED.clearly * np.median(span[quiet]):
        return ""
    idle = float(np.nanmedian(np.where(known, readings, np.nan)[:, quiet]))
    down, up = float(np.sum(idle - lowest[active])), float(np.sum(highest[active] - idle))
    if down <= _TOUCHED.clearly * max(up, 0.0):
        return ""
    if polarity < 0:
        return "readings fall where the sensor is touched: leave polarity = -1 out of the sensor file"
    return (
        "readings fall where the sensor is touched: if its numbers decrease under load, add polarity = -1 and offset "
        "(the number without load) to the sensor file"
    )
