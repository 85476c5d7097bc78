"""A rigid object with three rounded feet on an elastic skin of 10 x 10 taxels: it sinks, tilts, slides and turns.

The skin's pressure is its depth; a taxel reads the mean over its area. Lengths are in pitches.
"""

from __future__ import annotations

import numpy as np

from synthetic import grid_sensor, recorded
from taxelflow.acquire.base import Recording
from taxelflow.messages import Floats

_SIDE, _FINE = 10, 5
_line = np.arange(_SIDE) - (_SIDE - 1) / 2
PLACES = np.column_stack([np.tile(_line, _SIDE), np.repeat(-_line, _SIDE)])
"""(taxels, 2), row by row from the top left."""
_inside = (np.arange(_FINE) + 0.5) / _FINE - 0.5
_points = PLACES[:, np.newaxis, np.newaxis] + np.stack(np.meshgrid(_inside, _inside), axis=-1)
_FEET = ((-1.8, -1.2), (1.6, -1.5), (0.3, 2.0))
_RADIUS = 1.5
PITCH_M = 0.003
SENSOR = grid_sensor(_SIDE, _SIDE, pitch_m=(PITCH_M, PITCH_M))
RATE_HZ = 50.0
_FULL = 2e4


def pressed(
    *, depth: float = 1.0, tilt: tuple[float, float] = (0.0, 0.0), x: float = 0.0, y: float = 0.0, turn: float = 0.0
) -> Floats:
    """(taxels,), largest about 1. depth: of the feet's lowest points. tilt: slopes along x and y."""
    cos, sin = np.cos(turn), np.sin(turn)
    off = _points - np.array([x, y])
    body = np.stack([cos * off[..., 0] + sin * off[..., 1], cos * off[..., 1] - sin * off[..., 0]], axis=-1)
    height = np.min([((body - np.array(foot)) ** 2).sum(axis=-1) / (2 * _RADIUS) for foot in _FEET], axis=0)
    mean: Floats = np.maximum(depth + _points @ np.array(tilt) - height, 0.0).mean(axis=(1, 2))
    return mean


def on_skin(x: Floats, tilt: Floats, *, noise: float = 100.0, seed: int = 0) -> Recording:
    """An object in contact at places x and with a tilt along x and, half as much and later, along y, (scans,) each.

    A second without contact comes before, and half a second after.
    """
    later = np.roll(tilt, round(0.2 * RATE_HZ))
    touched = [pressed(x=place, tilt=(a, 0.5 * b)) for place, a, b in zip(x, tilt, later, strict=True)]
    idle = np.zeros((round(RATE_HZ), _SIDE**2))
    values = _FULL * np.concatenate([idle, touched, idle[: len(idle) // 2]])
    noisy = values + np.random.default_rng(seed).normal(0.0, noise, values.shape)
    return recorded(noisy, SENSOR, np.arange(len(noisy)) / RATE_HZ)
