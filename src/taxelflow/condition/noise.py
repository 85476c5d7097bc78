"""Noise of each taxel, estimated from the scans themselves, with a floor.

Many sensors clip idle taxels to 0, so that the noise of an idle pad is 0; what counts is how much a *loaded* taxel
differs from scan to scan. Second differences within a window remove what changes linearly (load, slow motion), and the
quietest fifth of a taxel's windows leaves out those in which the object moved.
"""

from __future__ import annotations

import numpy as np

from taxelflow.messages import Bools, Floats

_QUIET_QUANTILE = 0.2
"""A window's noise is taken at this quantile of all windows: an object rests in a fifth of them."""
_QUIET_NORMAL_STD = 0.706
"""That quantile for normal noise of standard deviation 1 in windows of 12 scans."""
_SECOND_DIFFERENCE_VARIANCE = 6.0
"""Variance of a - 2 b + c over that of one reading."""
_MIN_WINDOWS = 8
"""Fewer usable windows of a taxel are pooled with those of all taxels."""
_MIN_DIFFERENCES = 8
"""Second differences that a window needs, if any window has as many."""
_MAX_CLIPPED_SHARE = 0.1
"""A window in which a taxel reads its lowest value, or saturates, in a larger share of scans shows clipping, not noise.
"""
_MIN_UNSATURATED_SHARE = 0.25
"""A taxel with a smaller share of unsaturated windows is not judged: what is left leads up to saturation."""
_MAX_READINGS = 200_000
"""Readings that are searched for the quantisation step, at most: sorting takes time."""
_MIN_LEVELS = 16
"""With fewer distinct readings the smallest step may be that of an image of few values, not the converter's."""
_RANGE_QUANTILE = 0.995
"""Quantile of the distinct readings that stands for the largest: one glitch is not the sensor's range."""
MIN_NOISE_SHARE = 1e-4
"""Smallest noise as a share of the largest reading: no tactile sensor resolves more than 13 bits."""
_MIN_NOISE = 1e-150
"""Noise is above 0, and so is its square."""


def estimate_noise(
    windows: Floats, masked: Bools, step: float = 0.0, unknown: float = 0.0, ceiling: Floats | float = np.inf
) -> Floats:
    """(windows, scans, taxels) of raw pressure, NaN where missing -> (taxels,) standard deviation; 0 where masked.

    step: quantisation step of the sensor, if declared. unknown: the noise to assume while all readings are alike.
    ceiling: (taxels,), where readings saturate: there they are as quiet as where they clip.
    """
    live = windows[:, :, ~masked]
    noise = np.zeros(len(masked))
    if not live.size:
        return noise
    with np.errstate(over="ignore", invalid="ignore"):  # a reading beyond all range makes its window unusable, no more
        difference = (live[:, :-2] - 2 * live[:, 1:-1] + live[:, 2:]) ** 2
    known = np.isfinite(difference)
    count = known.sum(axis=1)
    enough = min(_MIN_DIFFERENCES, int(count.max(initial=1)))
    std = np.sqrt(np.sum(difference, axis=1, where=known) / np.maximum(count, 1) / _SECOND_DIFFERENCE_VARIANCE)
    bottom = np.min(live, axis=(0, 1), initial=np.inf, where=np.isfinite(live))
    top = np.broadcast_to(ceiling, masked.shape)[~masked]
    unclipped = (count >= max(enough, 1)) & ((live <= bottom).mean(axis=1) < _MAX_CLIPPED_SHARE)
    usable = unclipped & ((live >= top).mean(axis=1) < _MAX_CLIPPED_SHARE)
    usable &= usable.sum(axis=0) > _MIN_UNSATURATED_SHARE * unclipped.sum(axis=0)
    floor = max(noise_floor(live), step / 12**0.5)
    floor = floor if floor > _MIN_NOISE else max(unknown, _MIN_NOISE)
    pooled = _quiet_std(std[usable]) if usable.sum() >= _MIN_WINDOWS else floor
    own = [
        _quiet_std(std[usable[:, taxel], taxel]) if usable[:, taxel].sum() >= _MIN_WINDOWS else pooled
        for taxel in range(live.shape[2])
    ]
    noise[~masked] = np.maximum(own, floor)
    return noise


def noise_floor(readings: Floats) -> float:
    """Standard deviation of the quantisation step found in any array of readings, at least a share of the largest."""
    some = readings.reshape(-1)[:: 1 + readings.size // _MAX_READINGS]
    levels = np.unique(some[np.isfinite(some)])
    if not len(levels):
        return _MIN_NOISE
    largest = float(np.quantile(np.abs(levels), _RANGE_QUANTILE))
    step = 0.0
    if len(levels) >= _MIN_LEVELS:
        with np.errstate(over="ignore"):
            steps = np.diff(levels)
        step = float(steps[steps > 1e-9 * largest].min(initial=largest))  # smaller ones are rounding errors
    return max(step / 12**0.5 if step < largest / _MIN_LEVELS else 0.0, MIN_NOISE_SHARE * largest, _MIN_NOISE)


def _quiet_std(stds: Floats) -> float:
    return float(np.quantile(stds, _QUIET_QUANTILE)) / _QUIET_NORMAL_STD
