"""A textured object on a soft skin: while it rests, the arm redistributes the load over the pad."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from synthetic import grid_sensor, recorded

if TYPE_CHECKING:
    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Floats

SENSOR = grid_sensor(6, 6, pitch_m=(0.005, 0.005))
_BUMPS = (((-0.004, 0.003), 1.0), ((0.005, 0.001), 0.8), ((0.0, -0.005), 0.9), ((0.009, 0.008), 0.5))
"""Places, m, and heights of the object's bumps."""


def texture(x_m: Floats, peak: float = 40e3) -> Floats:
    """(scans, taxels), the pattern of the object at these places along x."""
    layout = SENSOR.layout
    pattern = np.zeros((len(x_m), layout.taxels))
    for (bump_x, bump_y), height in _BUMPS:
        squared = (layout.x_m - bump_x - x_m[:, np.newaxis]) ** 2 + (layout.y_m - bump_y) ** 2
        pattern += peak * height * np.exp(-squared / (2 * 0.004**2))
    return pattern


def tilt(t_s: Floats, size: float) -> Floats:
    """(scans, taxels), factor on the pattern: a slow redistribution and change of the load."""
    layout = SENSOR.layout
    x, y = layout.x_m / 0.015, layout.y_m / 0.015
    along, across = np.sin(2.1 * t_s)[:, np.newaxis], np.cos(1.3 * t_s)[:, np.newaxis]
    return (1 + 0.5 * size * across) * (1 + size * (along * x + across * y))


def held(x_m: Floats, tilted: float = 0.2, rate_hz: float = 10.0, noise: float = 100.0, seed: int = 0) -> Recording:
    """An object at these places in contact, after 2 s and before 1 s without."""
    before, after = round(2 * rate_hz), round(rate_hz)
    t_s = np.arange(len(x_m)) / rate_hz
    touched = texture(x_m) * tilt(t_s, tilted)
    values = np.concatenate([np.zeros((before, 36)), touched, np.zeros((after, 36))])
    noisy = values + np.random.default_rng(seed).normal(0, noise, values.shape)
    return recorded(noisy, SENSOR, np.arange(len(values)) / rate_hz)


def slide(rate_hz: float = 10.0, speed_m_s: float = 0.01) -> Floats:
    """Places: 8 s at rest, 1.5 s along x, 5 s at rest."""
    way = speed_m_s * np.arange(1, round(1.5 * rate_hz) + 1) / rate_hz
    return np.concatenate([np.zeros(round(8 * rate_hz)), way, np.full(round(5 * rate_hz), way[-1])])


def smooth(x_m: Floats, tilted: float = 0.0, rate_hz: float = 25.0) -> Recording:
    """A smooth dome at these places in contact, after 2 s and before 1 s without; its load is redistributed along x."""
    layout, t_s = SENSOR.layout, np.arange(len(x_m)) / rate_hz
    squared = (layout.x_m - x_m[:, np.newaxis]) ** 2 + layout.y_m**2
    touched = 40e3 * np.exp(-squared / (2 * 0.008**2))
    touched *= 1 + tilted * np.sin(1.5 * t_s)[:, np.newaxis] * layout.x_m / 0.015
    values = np.concatenate([np.zeros((round(2 * rate_hz), 36)), touched, np.zeros((round(rate_hz), 36))])
    noisy = values + np.random.default_rng(0).normal(0, 100.0, values.shape)
    return recorded(noisy, SENSOR, np.arange(len(values)) / rate_hz)
