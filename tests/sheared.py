"""A textured object on a soft three-axis skin that is pulled while it rests, and what its shear does when it slides."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from restless import SENSOR, texture, tilt
from taxelflow.pipeline import api

if TYPE_CHECKING:
    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Floats

IDLE_S = 2.0
"""Time without contact before and after the object."""


def pull(t_s: Floats) -> Floats:
    """(scans, 1, 2), shear over pressure of an object that is pulled about and sticks."""
    return 0.3 * np.stack([np.sin(1.1 * t_s), np.cos(0.7 * t_s)], axis=1)[:, np.newaxis]


def let_go(scans: int, seed: int = 1) -> Floats:
    """(scans, taxels, 2), shear over pressure, another in each taxel and scan."""
    return np.random.default_rng(seed).normal(0, 0.15, (scans, SENSOR.layout.taxels, 2))


def sheared(
    x_m: Floats, slides: Floats, *, creep: float = 0.02, rate_hz: float = 10.0, noise: float = 100.0
) -> Recording:
    """An object at these places, between 2 s without contact; noise: of both. slides: (scans,), where its skin lets go.

    creep: shear over pressure that comes and goes at rest in each taxel.
    """
    random, t_s, count = np.random.default_rng(0), np.arange(len(x_m)) / rate_hz, round(IDLE_S * rate_hz)
    pressure = texture(x_m) * tilt(t_s, 0.2)
    steps = let_go(len(x_m)) * np.asarray(slides)[:, np.newaxis, np.newaxis]
    own = let_go(len(x_m), 2) * creep + np.cumsum(steps, axis=0)
    shear = pressure[..., np.newaxis] * (pull(t_s) + own)
    idle = np.zeros((count, SENSOR.layout.taxels, 2))
    whole = np.concatenate([idle, shear, idle]) + random.normal(500.0, noise, (len(x_m) + 2 * count, 36, 2))
    values = np.concatenate([idle[..., 0], pressure, idle[..., 0]]) + random.normal(0, noise, whole.shape[:2])
    return api.recording(np.arange(len(values)) / rate_hz, values, SENSOR, shear=whole)
