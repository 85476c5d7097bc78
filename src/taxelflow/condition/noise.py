"""Noise of each taxel, learned from the scans themselves, with a floor.

Many sensors clip idle taxels to 0, so that the noise of a tare is zero; what counts is how much a *loaded*
taxel differs from scan to scan. Second differences within a window remove whatever changes linearly (load,
slow motion), and the quietest fifth of a taxel's windows forgets those in which the object moved.
"""

from __future__ import annotations

import numpy as np

from taxelflow.messages import Bools, Floats

_QUIETEST = 0.2
_QUIETEST_OF_NORMAL = 0.706
"""That quantile of a 12-scan window's figure for normal noise of standard deviation 1."""
_SECOND_DIFFERENCE = 6.0
"""Variance of a - 2 b + c over that of one reading."""
_ENOUGH_WINDOWS = 8
_CLIPPED = 0.1
"""A window in which a taxel reads its lowest value more often than this tells of clipping, not of noise."""
_READINGS = 200_000
_LEVELS = 16
_RANGE_FLOOR = 1e-4
"""No sensor is taken to be finer than this share of its largest reading."""


def learn_noise(windows: Floats, masked: Bools) -> Floats:
    """(windows, scans, taxels) of raw pressure -> (taxels,) standard deviation; 0 for masked taxels."""
    live = windows[:, :, ~masked]
    noise = np.zeros(len(masked))
    if not live.size:
        return noise
    change = live[:, :-2] - 2 * live[:, 1:-1] + live[:, 2:]
    figure = np.sqrt(np.mean(change**2, axis=1) / _SECOND_DIFFERENCE)  # (windows, live taxels), NaN if one is missing
    bottom = np.min(live, axis=(0, 1), initial=np.inf, where=np.isfinite(live))
    usable = np.isfinite(figure) & ((live <= bottom).mean(axis=1) < _CLIPPED)
    floor = noise_floor(live)
    pooled = _quietest(figure[usable]) if usable.sum() >= _ENOUGH_WINDOWS else floor
    own = [
        _quietest(figure[usable[:, taxel], taxel]) if usable[:, taxel].sum() >= _ENOUGH_WINDOWS else pooled
        for taxel in range(live.shape[2])
    ]
    noise[~masked] = np.maximum(own, floor)
    return noise


def noise_floor(readings: Floats) -> float:
    """Standard deviation of the quantisation step seen in any array of readings, at least a share of the largest."""
    some = readings.reshape(-1)[:: 1 + readings.size // _READINGS]
    levels = np.unique(some[np.isfinite(some)])
    if len(levels) < _LEVELS:  # too few to tell a converter's step from an image of few values
        largest = float(np.abs(levels).max(initial=0.0))
        return max(_RANGE_FLOOR * largest, float(np.finfo(np.float64).tiny))
    largest = float(np.abs(levels).max())
    steps = np.diff(levels)
    step = float(steps[steps > 1e-9 * largest].min(initial=largest))
    return max(step / 12**0.5 if step < largest / _LEVELS else 0.0, _RANGE_FLOOR * largest)


def _quietest(figures: Floats) -> float:
    return float(np.quantile(figures, _QUIETEST)) / _QUIETEST_OF_NORMAL
