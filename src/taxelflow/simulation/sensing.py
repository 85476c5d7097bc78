"""Model of the sensor: gains, offsets, noise, drift, time stamps, rolling scan."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.simulation.seeds import DRIFT, JITTER, WOBBLE

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.simulation.parameters import Sensing

_DRIFT_SPREAD = 0.3
"""Standard deviation of the taxels' drift rates over their mean."""
_MOST_JITTER = 0.45
"""Largest error of a time stamp in scan periods: below 0.5, so that time stamps increase."""


def clock(sensing: Sensing, duration_s: float, random: np.random.Generator) -> Floats:
    """True times (scans,) of the scans, s; the motion starts at a random phase of the first scan period."""
    rate_hz = sensing.rate_hz
    t_s = (np.arange(int(duration_s * rate_hz), dtype=np.float64) + random.uniform()) / rate_hz
    return np.asarray(t_s, dtype=np.float64)


def reported(sensing: Sensing, t_s: Floats, seed: int) -> Floats:
    """Time stamps (scans,) in s: the true times with jitter, still increasing."""
    if not sensing.jitter_s:
        return t_s
    most = _MOST_JITTER / sensing.rate_hz
    jitter = sensing.jitter_s * np.random.default_rng([seed, JITTER]).standard_normal(len(t_s))
    times: Floats = np.asarray(t_s + np.clip(jitter, -most, most), dtype=np.float64)
    return times


def delays(sensing: Sensing, taxels: int) -> Floats:
    """Time (taxels,) from the start of the scan to the reading of each taxel, s."""
    delay_s: Floats = sensing.scan_share / sensing.rate_hz * np.arange(taxels) / taxels
    return delay_s


def sense(sensing: Sensing, pressure_pa: Floats, t_s: Floats, random: np.random.Generator, seed: int = 0) -> Floats:
    """Readings (scans, taxels) in Pa of pressures (scans, taxels) in Pa at times (scans,) in s.

    With gain, offset, noise, drift, saturation and quantisation.
    """
    scans, taxels = pressure_pa.shape
    gain = np.ones(taxels) + sensing.gain_spread * random.standard_normal(taxels)
    gain[list(sensing.dead)] = 0.0
    offset: Floats = np.asarray(random.uniform(*sensing.baseline_pa, taxels), dtype=np.float64)
    noise = sensing.noise_pa * random.standard_normal(pressure_pa.shape)
    if sensing.gain_wobble:
        wobble = np.random.default_rng([seed, WOBBLE]).standard_normal((scans, 1))
        pressure_pa = pressure_pa * (1.0 + sensing.gain_wobble * wobble)
    if sensing.drift_pa_s:
        spread = np.random.default_rng([seed, DRIFT]).standard_normal(taxels)
        rate_pa_s = sensing.drift_pa_s * (1.0 + _DRIFT_SPREAD * spread)
        offset = offset + rate_pa_s * t_s[:, np.newaxis]
    step = sensing.full_scale_pa / (2**sensing.bits - 1)
    clipped = np.clip(gain * pressure_pa + offset + noise, 0.0, sensing.full_scale_pa)
    readings: Floats = np.round(clipped / step) * step
    return readings
