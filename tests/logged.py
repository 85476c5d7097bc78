"""Recordings of a sensor behind a logger, made up for tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from synthetic import dome, grid_sensor
from taxelflow.condition.deduplicate import Deduplicator

if TYPE_CHECKING:
    from taxelflow.messages import Floats

PALM = grid_sensor(4, 7, full_scale=140e3)
WIDE = grid_sensor(9, 21, full_scale=140e3)


def noisy_grasp(scans: int = 300, sigma: float = 100.0, *, clipped: bool = True, step: float = 10.0) -> Floats:
    """A third idle, then a dome; idle taxels read exactly 0 if the sensor clips. Quantised."""
    random = np.random.default_rng(0)
    load = np.where(np.arange(scans) < scans // 3, 0.0, 1.0)[:, np.newaxis] * dome(PALM)
    values: Floats = step * np.round((load + random.normal(0, sigma, load.shape)) / step)
    return np.where(load > 5 * sigma, np.maximum(values, 0), 0) if clipped else values


def logged(values: Floats, times: int, rate_hz: float = 30.0) -> tuple[Floats, Floats]:
    """What a logger writes that is so many times as fast as the sensor: stamps and scans."""
    stamps: Floats = np.arange(times * len(values)) / (times * rate_hz)
    return stamps, np.repeat(values, times, axis=0)


def deduplicated(t_s: Floats, values: Floats, *, passes: int = 2, **more: bool) -> tuple[Deduplicator, Floats]:
    deduplicator = Deduplicator(values.shape[1], np.full(values.shape[1], np.inf), **{"drop": True, **more})
    kept = np.zeros(0)
    for _ in range(passes):
        deduplicator.restart()
        kept = deduplicator.step(t_s, values).t_s
    return deduplicator, kept
