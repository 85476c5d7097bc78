"""The converter behind readings: its step and its range, as far as the readings themselves show them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taxelflow.messages import Floats
from taxelflow.numerics.rounding import ROUNDING


@dataclass(frozen=True, slots=True)
class _Converter:
    """Search for the quantisation step, and for the range."""

    readings: int = 200_000
    """Readings that are searched for the quantisation step, at most: sorting takes time."""
    levels: int = 16
    """With fewer distinct readings the smallest step may be that of an image of few values, not the converter's."""
    quantile: float = 0.995
    """Quantile of the distinct readings that stands for the largest: one glitch is not the sensor's range."""


_CONVERTER = _Converter()
MIN_NOISE_SHARE = 1e-4
"""Smallest noise as a share of the range of the readings: no tactile sensor resolves more than 13 bits."""
UNKNOWN_NOISE = 1e-150
"""Noise of a sensor whose readings are all alike, without a declared step: above 0, and so is its square."""


def noise_floor(readings: Floats) -> float:
    """Standard deviation of the quantisation step found in any array of readings, at least a share of their range."""
    levels = levels_of(readings)
    return floor_of(step_of(levels), range_of(levels)) if len(levels) else UNKNOWN_NOISE


def lowest_reading(windows: Floats) -> float:
    """Half a quantisation step above the lowest reading: what would read less is clipped, or rounded, to it."""
    levels = levels_of(windows)
    return float(levels[0]) + 0.5 * step_of(levels) if len(levels) else 0.0


def are_whole(numbers: Floats) -> bool:
    """Whether all numbers that are known are whole, to rounding: a converter's counts.

    Readings that are scaled to 0..1 are declared as counts, too; their quantisation step is found from the readings.
    """
    some = numbers[np.isfinite(numbers)]
    whole = np.round(some)
    return bool((np.abs(some - whole) <= ROUNDING * np.maximum(1.0, np.abs(some))).all())


def levels_of(readings: Floats) -> Floats:
    """The distinct readings (..., taxels), in order, of some scans: of all taxels, whichever is listed first."""
    scans = readings.reshape(-1, readings.shape[-1])
    some = scans[:: 1 + readings.size // _CONVERTER.readings]
    levels: Floats = np.unique(some[np.isfinite(some)])
    return levels


def range_of(levels: Floats) -> float:
    """From the lowest reading to the largest, glitches left out."""
    with np.errstate(over="ignore"):
        return float(np.quantile(levels - levels[0], _CONVERTER.quantile))


def step_of(levels: Floats) -> float:
    """The converter's step; 0 if it is unknown."""
    largest = range_of(levels)
    if len(levels) < _CONVERTER.levels:
        return 0.0
    with np.errstate(over="ignore"):
        steps = np.diff(levels)
    tiny = ROUNDING * max(largest, float(np.abs(levels).max()))  # smaller ones are rounding errors
    step = float(steps[steps > tiny].min(initial=largest))
    return step if step < largest / _CONVERTER.levels else 0.0


def floor_of(step: float, reach: float) -> float:
    """Noise at least, of readings with this step and range."""
    return max(step / 12**0.5, MIN_NOISE_SHARE * reach, UNKNOWN_NOISE)
